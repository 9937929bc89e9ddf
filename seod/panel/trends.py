"""Estimates of hours, thinned: the newest as they come, older ones at growing distances."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

KEYS: Final = (
    "t",
    "zeta",
    "zeta_sd",
    "omega_n",
    "omega_n_sd",
    "K_L",
    "K_L_sd",
    "ps",
    "temperature",
    "quality",
    "amplitude",
    "frequency",
)
"""Of an `estimate`, in this order."""
RECENT: Final = 2400
"""Estimates that are kept as they came: some minutes."""
OLDER: Final = 4000
"""Estimates before that, at most; half of them go once there are more."""

Point = tuple[Any, ...]


class Trend:
    """Of one axis."""

    def __init__(self) -> None:
        self._recent: deque[Point] = deque()
        self._older: list[Point] = []
        self._every = 1
        self._passed = 0

    def add(self, estimate: Mapping[str, Any]) -> None:
        """Take one more estimate."""
        point = tuple(estimate.get(key) for key in KEYS)
        if self._recent and (point[0] or 0.0) < self._recent[-1][0]:
            return  # told again, as stale
        self._recent.append(point)
        if len(self._recent) > RECENT:
            self._age(self._recent.popleft())

    def _age(self, point: Point) -> None:
        self._passed += 1
        if self._passed % self._every == 0:
            self._older.append(point)
        if len(self._older) > OLDER:
            del self._older[::2]
            self._every *= 2

    def columns(self, since: float | None = None) -> dict[str, list[Any]]:
        """All that is kept, or what came after a time [s]: a list for each of `KEYS`."""
        points = [*self._older, *self._recent]
        if since is not None:
            points = [each for each in points if (each[0] or 0.0) > since]
        columns = zip(*points, strict=True) if points else ([] for _ in KEYS)
        return {key: list(column) for key, column in zip(KEYS, columns, strict=True)}
