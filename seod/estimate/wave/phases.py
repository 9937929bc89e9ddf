"""Which cycles of a window are alike, where the relay's phase alternates."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.estimate.limit_cycle.switches import Switch

FEWEST: Final = 5
"""Switches of one phase that hold two whole cycles of it."""
KEPT: Final = 100
"""Turns that are remembered; a window holds a few."""


class PhaseSegment(NamedTuple):
    """Cycles of one phase, from `begin` to `end` [s], and their period [s]."""

    begin: float
    end: float
    period: float


class Phases:
    """When the phase turned."""

    def __init__(self) -> None:
        self._second = False
        self._turns: list[float] = []

    def note(self, t: float, second: bool) -> None:
        """Take a row whose command left at `t` [s]."""
        if second is not self._second:
            self._second = second
            self._turns.append(t)
            del self._turns[:-KEPT]

    def alike(self, since: float, switches: Iterable[Switch]) -> PhaseSegment | None:
        """The newest cycles of one phase that are at least two, the first half cycle left out.

        Args:
            since: When the window begins [s].
            switches: Of the window, in order.

        Returns:
            None where the whole window is of one phase; a segment of no length where there are no two cycles.
        """
        turns = [turn for turn in self._turns if turn > since]
        if not turns:
            return None
        times = [switch.t for switch in switches]
        for begin, end in reversed(list(pairwise([since, *turns, float("inf")]))):
            of_phase = [t for t in times if begin < t <= end][1:]
            if len(of_phase) >= FEWEST:
                return PhaseSegment(
                    of_phase[0], of_phase[-1], 2.0 * (of_phase[-1] - of_phase[0]) / (len(of_phase) - 1)
                )
        return PhaseSegment(since, since, 0.0)
