"""How much the stamps of a board's clock jitter, told apart from how much their arrival does.

The board's times and the times of their arrival are two readings of the same moments. What both show is the
board's own timer, which they tell truly; what arrivals do not confirm is an error of the stamps, what stamps
do not confirm is latency. Within a segment, less straight lines in the number of the sample, of which neither
error knows (x: stamp, y: arrival less stamp):

    variance of the stamps' error = -cov(x, y),  variance of the latency = var(y) + cov(x, y)

The difference of the clocks then lies where the mean of the arrivals says, not where their least does: that
belongs to the stamp that was wrong by most.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median

SEGMENT_S, FEWEST = 0.25, 32
"""A segment lasts for so long, and has so many samples at least."""
ENOUGH = 125
"""Of faster samples each second, third or so is looked at: so many tell enough, and cost time in the tick."""
JUDGED = 3
"""Segments whose median counts: one in which the reader slept tells nothing."""
LEAST_S = 2e-5
"""Less is the rounding of a clock that counts us, and chance."""
SURE = 3.0
"""Standard errors above which a covariance is no chance."""
LATE = 2.5
"""An arrival later by more of the stamps' standard deviations was late, and says nothing of its stamp."""


class _Segment:
    """Sums of one segment, from its first sample (x, y) [s]."""

    def __init__(self, x: float, y: float) -> None:
        self.begun, self._y0 = x, y
        self.count = 0
        self._x = self._y = self._kx = self._ky = self._xx = self._xy = self._yy = 0.0

    def add(self, x: float, y: float) -> None:
        k, x, y = self.count, x - self.begun, y - self._y0
        self.count = k + 1
        self._x += x
        self._y += y
        self._kx += k * x
        self._ky += k * y
        self._xx += x * x
        self._xy += x * y
        self._yy += y * y

    def mean(self) -> tuple[float, float]:
        """Of x and y."""
        return self.begun + self._x / self.count, self._y0 + self._y / self.count

    def variances(self) -> tuple[float, float, float]:
        """Of x, of y, and of the two together, less straight lines in the number of the sample [s^2]."""
        n = self.count
        middle, spread = 0.5 * (n - 1), n * (n * n - 1) / 12.0
        kx, ky = self._kx - middle * self._x, self._ky - middle * self._y
        xx = self._xx - self._x * self._x / n - kx * kx / spread
        xy = self._xy - self._x * self._y / n - kx * ky / spread
        yy = self._yy - self._y * self._y / n - ky * ky / spread
        return max(xx / n, 0.0), max(yy / n, 0.0), xy / n


class Jitter:
    """Of one board's stamps.

    Attributes:
        sd: Standard deviation of the stamps' error [s]; 0 where it is less than can be told, nan before the
            first segments.
        arrival_sd: Of the latency [s]; nan likewise.
        share: Part of the scatter of arrival less stamp that is the stamps'.
    """

    def __init__(self) -> None:
        self.sd = self.arrival_sd = math.nan
        self.share = 0.0
        self._open: _Segment | None = None
        self._every = self._turn = 1
        self._closed: deque[tuple[float, ...]] = deque(maxlen=JUDGED)
        self._level = 0.0
        self._drift = 0.0

    def add(self, x: float, y: float, drift: float) -> None:
        """One more sample.

        Args:
            x: Its stamp [s].
            y: Its arrival less its stamp [s].
            drift: Of y over x, as far as it is known.
        """
        self._turn -= 1
        if self._turn:
            return
        self._turn, segment = self._every, self._open
        if segment is None or (x - segment.begun >= SEGMENT_S and segment.count >= FEWEST):
            if segment is not None:
                self._close(segment, drift)
            self._open = segment = _Segment(x, y)
        segment.add(x, y)

    def _close(self, segment: _Segment, drift: float) -> None:
        self._every = max(segment.count * self._every // ENOUGH, 1)
        self._closed.append((*segment.variances(), *segment.mean()))
        xx, yy, xy = (median(each) for each in list(zip(*self._closed, strict=True))[:3])
        stamps = min(max(-xy, 0.0), yy)
        if stamps < LEAST_S**2:
            stamps = 0.0
        self.sd, self.arrival_sd = math.sqrt(stamps), math.sqrt(yy - stamps)
        self.share = stamps / yy if stamps > SURE * math.sqrt(xx * yy / segment.count) else 0.0
        self._drift = drift
        self._level = median(y - drift * x for *_, x, y in self._closed)

    def level(self, x: float) -> float:
        """The clocks' difference at the stamp `x` by the mean of the arrivals [s]."""
        return self._level + self._drift * x

    def correction(self, x: float, y: float) -> float:
        """What to add to a stamp: that part of its deviation that is the stamps' share [s]."""
        away = y - self.level(x)
        return self.share * away if away < LATE * self.sd else 0.0
