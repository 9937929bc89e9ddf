"""The last minute of rows of each axis, and what of it fits on a screen: lowest and highest in intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

HISTORY_S: Final = 65.0
"""How much is kept: the minute that the page scrolls in, and some more."""
FIELDS: Final = ("t", "y", "reference", "u", "t_u", "e_a", "signal", "ps", "temperature")
"""What is kept of a row beside the time of its tick; see `seod.processes.ring.AXIS_FIELDS`."""
SIGNALS: Final = ("u", "y", "signal")
"""What the scope shows: command, measured, and the relay's input."""


class AxisHistory:
    """Rows of one axis, the newest last; each array is one piece of memory, whatever has passed.

    Args:
        rows: How many are kept at least.
    """

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._end = 0
        self._time = np.full(2 * rows, np.nan)  # written to, so that its memory is there from the begin
        self._values = {name: np.full(2 * rows, np.nan) for name in FIELDS}
        self._fresh = np.full(2 * rows, False)
        self.state = 0
        """The newest row's, one of `seod.processes.ring.AxisState`."""

    def add(self, tick_t: Floats, block: NDArray[np.void], fresh: NDArray[np.bool_]) -> None:
        """Append rows: times of their ticks [s], the axis' record in each, and whether a sample came."""
        count = len(tick_t)
        if self._end and tick_t[0] <= self._time[self._end - 1]:
            self._end = 0  # time has jumped back: a recording is replayed from its begin
        if self._end + count > len(self._time):
            kept = slice(self._end - self._rows, self._end)
            for array in self._arrays():
                array[: self._rows] = array[kept].copy()
            self._end = self._rows
        place = slice(self._end, self._end + count)
        self._time[place] = tick_t
        self._fresh[place] = fresh
        for name, array in self._values.items():
            array[place] = block[name]
        self._end += count
        self.state = int(block["state"][-1])

    def _arrays(self) -> list[NDArray[np.generic]]:
        return [self._time, self._fresh, *self._values.values()]

    @property
    def time(self) -> Floats:
        """Times of the ticks [s], shape (n,)."""
        return self._time[max(0, self._end - self._rows) : self._end]

    @property
    def newest_t(self) -> float:
        """Time of the newest tick [s]; 0 before the first."""
        return float(self._time[self._end - 1]) if self._end else 0.0

    @property
    def fresh(self) -> NDArray[np.bool_]:
        """Whether a sample came for the tick, shape (n,)."""
        return self._fresh[max(0, self._end - self._rows) : self._end]

    def field(self, name: str) -> Floats:
        """One of `FIELDS`, shape (n,)."""
        return self._values[name][max(0, self._end - self._rows) : self._end]

    def newest(self, name: str) -> float | None:
        """The newest value of a field; None before the first row, or where it is not finite."""
        value = self._values[name][self._end - 1] if self._end else np.nan
        return float(value) if np.isfinite(value) else None

    def intervals(
        self, first: int, last: int, step: float, names: Sequence[str] = SIGNALS, holds: float = 0.0
    ) -> NDArray[np.float32]:
        """Lowest and highest of each signal in the intervals [k step, (k + 1) step) for k from first to last.

        Args:
            first: Number of the first interval.
            last: Number of the last one, not counted in.
            step: Length of an interval [s].
            names: The signals.
            holds: A row stands for intervals without one that begin within this time after it as well [s]:
                where an interval is about as long as a tick, some have two rows and some none.

        Returns:
            Shape (2 len(names), last - first), lowest before highest; nan where an interval has no row.
        """
        edges = np.arange(first, last + 1) * step
        bounds = np.searchsorted(self.time, edges)
        starts, empty = bounds[:-1], bounds[:-1] == bounds[1:]
        out = np.full((2 * len(names), max(0, last - first)), np.nan, np.float32)
        if len(self.time) == 0 or bool(empty.all()):
            return out
        used = starts[~empty]
        for place, name in enumerate(names):
            values = self.field(name)[: bounds[-1]]
            out[2 * place, ~empty] = np.fmin.reduceat(values, used)
            out[2 * place + 1, ~empty] = np.fmax.reduceat(values, used)
        before = bounds[:-1] - 1
        held = empty & (before >= 0) & (edges[:-1] - self.time[before] < holds)
        for place, name in enumerate(names):
            out[2 * place : 2 * place + 2, held] = self.field(name)[before[held]]
        return out

    def switches(self, after: float, before: float) -> Floats:
        """When the relay has switched upwards, at ticks with after <= t < before, shape (m,) [s]."""
        time = self.time
        start, end = np.searchsorted(time, [after, before])
        start = max(1, int(start))
        if end <= start:
            return np.empty(0)
        amplitude = 0.5 * np.maximum(self.field("e_a")[start:end], 1e-12)
        rise = np.diff(self.field("u")[start - 1 : end])
        return time[start:end][rise > amplitude]
