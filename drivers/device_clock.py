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

from drivers.stamp_jitter import Jitter

WRAP, HALF = 1 << 32, 1 << 31
STRETCH_S = 0.25
"""Each keeps its tightest bound."""
FITTED, KEPT = 4, 120
"""Stretches that a drift needs, and that are remembered."""
LARGEST_DRIFT = 0.02
"""A quartz keeps 1e-4, a ceramic resonator 5e-3: more is a fault of the line."""
STEP_S = 0.01
"""A clock that goes back by more, or ahead of the arrivals by more, was set anew: no timer is as wrong."""
OLDEST_S = 10.0
"""No sample is taken for older: a bound that says so is of another clock."""


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
        """One more point; one from before its stretch counts as at the stretch's beginning."""
        x = max(x, self._begun)
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
        jitter: Of its stamps.
    """

    def __init__(self) -> None:
        self.resets = 0
        self.restart()

    def restart(self) -> None:
        """The board begins anew: nothing is known of its clock."""
        self.jitter = Jitter()
        self._latest: int | None = None
        self._now = self._put_right = 0.0
        self._arrived = -math.inf
        self._above, self._below = Bound(), Bound()

    def heard(self, time_us: int, arrived: float) -> float:
        """The time of a sample.

        Args:
            time_us: The board's clock at sampling [us], 0 to 2**32 - 1.
            arrived: When it can have arrived at the earliest [s]: reading less its time on the line; not
                before that of the call before.

        Returns:
            When it was taken [s]: not after it arrived, and at most `OLDEST_S` before.
        """
        passed = 0.0 if self._latest is None else _passed_s(self._latest, time_us)
        if self._was_set(passed, arrived):
            self.resets += 1
            self.restart()
            passed = 0.0
        self._latest, self._arrived = time_us, arrived
        self._now = x = self._now + passed
        jitter = self.jitter
        jitter.add(x, arrived - x, self._above.drift)
        if jitter.share:
            x += jitter.correction(x, arrived - x)
        self._put_right = x
        self._above.add(x, arrived - x)
        return min(max(x + self._difference(x), arrived - OLDEST_S), arrived)

    def _was_set(self, passed: float, arrived: float) -> bool:
        """Whether the board's clock was set anew since the last sample, `passed` seconds ago by itself.

        What was lost while the reader slept makes it go ahead, but no sample come before all that were heard.
        """
        if self._latest is None:
            return False
        x = self._now + passed
        early = self._above.at(x) - (arrived - x)
        if -OLDEST_S <= early <= STEP_S:
            return passed < -STEP_S
        return early < 0.0 or passed - (arrived - self._arrived) > STEP_S or passed < -STEP_S

    def acknowledged(self, time_us: int, written: float) -> float:
        """A command was set at a time of the board's clock, shortly before the last sample heard.

        Args:
            time_us: The board's clock then [us].
            written: When the line can have carried it at the earliest [s].

        Returns:
            When it was set [s]: not before it was written, and not after that sample arrived.
        """
        if self._latest is None:
            return written  # of a clock of which nothing is known
        x = self._put_right - (self._latest - time_us) % WRAP * 1e-6
        self._below.add(x, x - written)
        return max(min(x + self._difference(x), self._arrived), written)

    def _difference(self, x: float) -> float:
        """Loop's time less board's time at the board's time `x` [s]."""
        above, below = self._above.at(x), -self._below.at(x)
        bound = 0.5 * (above + below) if -math.inf < below < above else above
        share = self.jitter.share
        return bound + share * (self.jitter.level(x) - bound) if share else bound

    @property
    def drift(self) -> float:
        """By which the loop's clock is faster than the board's [s/s]."""
        return self._above.drift


def _passed_s(before_us: int, after_us: int) -> float:
    """From one time of a clock that wraps to another, back or ahead, whichever is less [s]."""
    return ((after_us - before_us + HALF) % WRAP - HALF) * 1e-6
