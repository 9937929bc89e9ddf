"""The relay's switches as they were really applied; they part the record into half cycles."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from typing import NamedTuple

CHATTER = 0.25
"""A relay that stays for less than this part of a half cycle chatters: noise moved it, not the plant."""


class Switch(NamedTuple):
    """One switch of the relay, all its chatter taken together.

    `t` is when u changed at the actuator [s]: with chatter, the single switch of equal mean voltage. `seen`
    is the time of the sample that made it [s]; `merged` the number of switches that it stands for.
    """

    t: float
    seen: float
    up: bool
    merged: int


class SwitchTracker:
    """Finds the switches of u, one by one; a switch is told when the next one begins."""

    def __init__(self) -> None:
        self._up: bool | None = None
        self._group: list[tuple[float, float]] = []
        self._recent: deque[float] = deque(maxlen=4)
        self._last = 0.0

    def update(self, seen: float, applied: float, up: bool) -> Switch | None:
        """Take one row: the relay's side `up`, computed at `seen`, in force from `applied` [s].

        Returns:
            The switch before, complete now that the half cycle after it has ended.
        """
        if up == self._up:
            return None
        first = self._up is None
        before, self._up = self._up, up
        if first:
            return None
        complete = self._close(applied, bool(before)) if self._is_long(applied) else None
        self._group.append((applied, seen))
        return complete

    def _is_long(self, applied: float) -> bool:
        """Whether the relay stayed long enough, before this switch, for a half cycle."""
        if not self._group:
            return False
        half = max(self._recent, default=0.0)
        if applied - self._group[-1][0] >= CHATTER * half:
            return True
        if applied - self._group[0][0] > half:
            self._begin_anew()
        return False

    def _begin_anew(self) -> None:
        """No chatter takes so long: the half cycles before were of another kind."""
        times = [t for t, _ in self._group]
        self._recent.clear()
        self._recent.append(max((b - a for a, b in pairwise(times)), default=0.0))
        del self._group[:-1]

    def _close(self, applied: float, up: bool) -> Switch | None:
        group, self._group = self._group, []
        if len(group) % 2 == 0:
            return None
        t = group[0][0] + sum(b[0] - a[0] for a, b in zip(group[1::2], group[2::2], strict=True))
        self._recent.append(applied - t)
        return Switch(t, 0.5 * (group[0][1] + group[-1][1]), up, len(group))
