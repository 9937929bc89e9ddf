"""A board's clock on the loop's clock: offset and drift from what is known of the line.

A sample cannot have been taken after it arrived: its arrival, less its time on the line, is a bound from
above. A command cannot have been set before it was written, nor faster than the line carries it: where the
board acknowledges commands, that is a bound from below. The clocks' difference lies between, and each bound
is tight when nothing was in the way.

The drift is the slope of the lower hull of the tightest bounds of the last half minute (after S. B. Moon,
P. Skelly, D. Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999).
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

WRAP = 1 << 32
STRETCH_S = 0.25
"""Each keeps its tightest bound."""
FITTED, KEPT = 4, 120
"""Stretches that a drift needs, and that are remembered."""
LARGEST_DRIFT = 0.02
"""A quartz keeps 1e-4, a ceramic resonator 5e-3: more is a fault of the line."""
AHEAD_S, BEHIND_S = 0.1, 10.0
"""A sample that comes from so far in the future, or past, tells of a clock that was set anew."""


class Bound:
    """A line below all points (x, y) [s] that have come, as high as it can be.

    Attributes:
        drift: Its slope.
    """

    def __init__(self) -> None:
        self.drift = 0.0
        self._offset = math.inf
        self._kept: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._begun = -math.inf
        self._best = (0.0, math.inf)

    def add(self, x: float, y: float) -> None:
        """One more point."""
        if x - self._begun >= STRETCH_S:
            self._close()
            self._begun, self._best = x, (x, math.inf)
        height = y - self.drift * x
        if height < self._best[1] - self.drift * self._best[0]:
            self._best = (x, y)
        self._offset = min(self._offset, height)

    def _close(self) -> None:
        if self._best[1] == math.inf:
            return
        self._kept.append(self._best)
        if len(self._kept) >= FITTED:
            self.drift = self._slope()
        self._offset = min([y - self.drift * x for x, y in self._kept])

    def _slope(self) -> float:
        """Of the hull's edge under the middle."""
        points = list(self._kept)
        hull, middle = _lower_hull(points), 0.5 * (points[0][0] + points[-1][0])
        (x0, y0), (x1, y1) = next(pair for pair in pairwise(hull) if pair[1][0] >= middle)
        slope = (y1 - y0) / (x1 - x0)
        return slope if abs(slope) <= LARGEST_DRIFT else self.drift

    def at(self, x: float) -> float:
        """Its height; inf before the first point."""
        return self._offset + self.drift * x


def _lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Andrew's monotone chain, lower half; points ordered by x."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) >= 2:
            (x0, y0), (x1, y1) = hull[-2:]
            if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                break
            hull.pop()
        hull.append((x, y))
    return hull


class DeviceClock:
    """Times of a board's clock that wraps, in s of the loop's clock.

    Attributes:
        resets: How often the board's clock was set anew.
    """

    def __init__(self) -> None:
        self.resets = 0
        self.restart()

    def restart(self) -> None:
        """The board begins anew: nothing is known of its clock."""
        self._latest = -1
        self._wraps = 0
        self._first = 0
        self._above, self._below = Bound(), Bound()

    def heard(self, time_us: int, arrived: float) -> float:
        """The time of a sample.

        Args:
            time_us: The board's clock at sampling [us], 0 to 2**32 - 1; not before that of the call before.
            arrived: When it can have arrived at the earliest [s]: reading less its time on the line.

        Returns:
            When it was taken [s], not after it arrived.
        """
        x = self._seconds(time_us)
        apparent = arrived - x
        if abs(apparent) < math.inf and not -AHEAD_S < apparent - self._above.at(x) < BEHIND_S:
            if self._above.at(x) < math.inf:
                self.resets += 1
            self.restart()
            x = self._seconds(time_us)
            apparent = arrived - x
        self._above.add(x, apparent)
        return min(x + self._difference(x), arrived)

    def acknowledged(self, time_us: int, written: float) -> float:
        """A command was set at a time of the board's clock, shortly before the last sample heard.

        Args:
            time_us: The board's clock then [us].
            written: When the line can have carried it at the earliest [s].

        Returns:
            When it was set [s].
        """
        behind = (self._latest - time_us) % WRAP
        x = self._now - behind * 1e-6
        self._below.add(x, x - written)
        return max(x + self._difference(x), written)

    def _seconds(self, time_us: int) -> float:
        """The board's time since it was first heard, without wraps [s]."""
        if self._latest < 0:
            self._first = time_us
        elif time_us < self._latest and self._latest - time_us > WRAP // 2:
            self._wraps += 1
        self._latest = time_us
        self._now = (self._wraps * WRAP + time_us - self._first) * 1e-6
        return self._now

    def _difference(self, x: float) -> float:
        """Loop's time less board's time at the board's time `x` [s]."""
        above, below = self._above.at(x), -self._below.at(x)
        return 0.5 * (above + below) if -math.inf < below < above else above

    @property
    def drift(self) -> float:
        """By which the loop's clock is faster than the board's [s/s]."""
        return self._above.drift
