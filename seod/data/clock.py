"""Time stamps looked at block by block: which rows are usable, and what is wrong with the others."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.data.problems import Problem

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from seod.data.source import Floats, Rows

GAP = 1.5
"""An interval longer than so many usual ones is a gap."""
SLOW_S = 1.0
"""Steps from which on times without a unit may be in ms or us: few rigs are sampled so slowly [s]."""
QUICK_S = 0.02
"""Shorter steps than that are in s: in ms they would be of more than 50 kHz [s]."""
LONG_S = 3000.0
"""Recordings in steps between both that are longer may be in ms: 50 min are seldom, 3 s are not [s]."""
_ROUNDED = 0.999
"""Part of such a step that a file's digits leave."""
_FEW_ROWS = 30
"""Rows from which on that is asked."""
UNEVEN = 0.05
"""Sampling is uneven if intervals scatter by more than this part of the usual one."""
LATEST_S = 1e16
"""A time beyond is none: a double tells no seconds apart there."""
_SAID = {
    "missing": "has no time in {n} rows: left out",
    "duplicate": "has the same time as the row before in {n} rows: left out",
    "decreasing": "goes back in time, by up to {worst:g} s: {n} rows left out",
}


def _question(usual: float, count: int) -> str:
    """Whether so many times of so slow a rate may be in another unit."""
    hours = usual * count / 3600.0
    return (
        f"has no unit, and its usual step of {usual:g} is {1.0 / usual:.3g} Hz for {hours:.2g} h in s, "
        f"as which it is taken: `--units t=ms` says ms ({1e3 / usual:.4g} Hz), `--units t=us` us "
        f"({1e6 / usual:.4g} Hz)"
    )


class Clock:
    """Takes the times of a recording in the order of the file.

    Args:
        file: For messages.
        column: The times' column, likewise.
        has_unit: The file, or the user, tells the unit of its times.

    Attributes:
        count: Usable rows so far.
        first, last: Their ends [s].
        usual: Median interval of the first rows [s]; nan until two are usable.
        shortest, longest: Intervals between usable rows [s].
    """

    def __init__(self, file: Path, column: str, has_unit: bool = True) -> None:
        self._file, self._column, self._has_unit = file, column, has_unit
        self._bad: dict[str, list[Rows]] = {kind: [] for kind in _SAID}
        self._gaps: list[Rows] = []
        self._lost = self._back = self._scatter = 0.0
        self._even = 0
        self.count = 0
        self.first = self.last = self.usual = math.nan
        self.shortest, self.longest = math.inf, 0.0

    def add(self, t: Floats, rows: Rows) -> NDArray[np.bool_]:
        """Look at some more rows.

        Returns:
            Which of them are usable: later than all before.
        """
        before = -math.inf if math.isnan(self.last) else self.last
        finite = np.abs(t) < LATEST_S  # and no nan
        newest = np.maximum.accumulate(np.concatenate(([before], np.where(finite, t, -math.inf))))[:-1]
        usable = finite & (t > newest)
        decreasing = finite & (t < newest)
        kinds = {"missing": ~finite, "duplicate": finite & (t == newest), "decreasing": decreasing}
        for kind, bad in kinds.items():
            if bad.any():
                self._bad[kind].append(rows[bad])
        if decreasing.any():
            self._back = max(self._back, float((newest - t)[decreasing].max()))
        self._take(t[usable], rows[usable])
        return usable

    @property
    def rate_hz(self) -> float:
        """By the usual interval; nan where there is none."""
        return 1.0 / self.usual

    @property
    def gaps(self) -> int:
        """How many there are."""
        return sum(map(len, self._gaps))

    @property
    def _may_be_ms(self) -> bool:
        """Whether times in s would be of a rate, or of a length, that is seldom."""
        slow = SLOW_S if self.usual * self.count < LONG_S else QUICK_S
        return self.usual >= _ROUNDED * slow and self.count >= _FEW_ROWS

    def problems(self) -> Iterator[Problem]:
        """What is wrong, all in all."""
        for kind, found in self._bad.items():
            if found:
                rows = np.concatenate(found)
                yield self._problem(kind, rows, _SAID[kind].format(n=len(rows), worst=self._back))
        if self._gaps:
            gaps = np.concatenate(self._gaps)
            message = (
                f"{len(gaps)} gaps, the longest of {self.longest:g} s; {self._lost:g} s are missing in all"
            )
            yield self._problem("gap", gaps, message)
        if not self._has_unit and self._may_be_ms:
            yield self._problem("unit", np.array([], np.int64), _question(self.usual, self.count))
        scatter = math.sqrt(self._scatter / self._even) if self._even else 0.0
        if scatter > UNEVEN:
            message = f"is sampled unevenly: intervals of {self.usual:g} s scatter by {100 * scatter:.2g} %"
            yield self._problem("uneven", np.array([], np.int64), message)

    def _take(self, t: Floats, rows: Rows) -> None:
        if not len(t):
            return
        steps = np.diff(t, prepend=self.last) if self.count else np.diff(t)
        rows = rows[len(rows) - len(steps) :]
        self.first = self.first if self.count else float(t[0])
        self.last = float(t[-1])
        self.count += len(t)
        if not len(steps):
            return
        if math.isnan(self.usual):
            self.usual = float(np.median(steps))
        self.shortest = min(self.shortest, float(steps.min()))
        self.longest = max(self.longest, float(steps.max()))
        gap = steps > GAP * self.usual
        if gap.any():
            self._gaps.append(rows[gap])
            self._lost += float((steps[gap] - self.usual).sum())
        self._scatter += float(((steps[~gap] / self.usual - 1.0) ** 2).sum())
        self._even += int((~gap).sum())

    def _problem(self, kind: str, rows: Rows, message: str) -> Problem:
        return Problem(kind, self._file, self._column, rows, message)
