"""`peaks`: the paper's own procedure (section 2.3): low-pass, three-sample peaks, Eqs. 5 to 8.

Faithful in its arithmetic: it ignores the relay's hysteresis and any lag, so it states no deviations, for
the scatter of its cycles tells nothing of these errors. One thing is added: a peak counts only once the
signal has come back from it by a part of the oscillation; else every ripple of noise would be one.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from statistics import fmean
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from seod.estimate.limit_cycle.estimator import CycleEstimator, Solution
from seod.estimate.limit_cycle.inversion import invert_eq8
from seod.estimate.limit_cycle.sensor_lag import first_order

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.base import Row
    from seod.estimate.limit_cycle.switches import Switch

RETREAT = 0.25
"""A peak is confirmed when the signal has come back from it by this part of its range."""
_RANGE_HALF_CYCLES = 4
"""The range is that of as many half cycles of the relay."""


class Peak(NamedTuple):
    """A confirmed extreme: time [s], low-passed position [axis unit], +1 or -1."""

    t: float
    y: float
    sign: int


class LowPass:
    """First-order low-pass at unequal steps; passes everything where the cut-off is None."""

    def __init__(self, cutoff_hz: float | None) -> None:
        self._rate = math.inf if cutoff_hz is None else 2.0 * math.pi * cutoff_hz
        self._t = self._y = math.nan

    def update(self, t: float, y: float) -> float:
        """The filtered value [unit of y] at `t` [s]."""
        if math.isnan(self._t):
            self._y = y
        else:
            self._y += (y - self._y) * -math.expm1(-self._rate * (t - self._t))
        self._t = t
        return self._y


class PeakFinder:
    """The test y(i-2) < y(i-1) > y(i), and its mirror image, with hysteresis; peaks alternate."""

    def __init__(self) -> None:
        self._last: deque[tuple[float, float]] = deque(maxlen=3)
        self._candidate: Peak | None = None
        self._before: Peak | None = None
        self._ranges = deque([(math.inf, -math.inf)], maxlen=_RANGE_HALF_CYCLES)

    def next_half_cycle(self) -> None:
        """The relay has switched: forget the range of the oldest half cycle."""
        self._ranges.append((math.inf, -math.inf))

    def update(self, t: float, y: float) -> Peak | None:
        """Take a sample; the peak that it confirms, if any."""
        low, high = self._ranges[-1]
        self._ranges[-1] = min(low, y), max(high, y)
        self._last.append((t, y))
        self._propose()
        c = self._candidate
        if c is None or c.sign * (c.y - y) < self._threshold():
            return None
        self._before, self._candidate = c, None
        return c

    def _propose(self) -> None:
        """Make the middle sample the candidate if it is an extreme, and more so than the one so far."""
        if len(self._last) < 3:
            return
        (_, a), (t, b), (_, c) = self._last
        sign = 1 if a <= b > c else -1 if a >= b < c else 0
        if sign == 0 or (self._before is not None and sign == self._before.sign):
            return
        if self._candidate is None or sign * (b - self._candidate.y) > 0.0 or sign != self._candidate.sign:
            self._candidate = Peak(t, b, sign)

    def _threshold(self) -> float:
        return RETREAT * (max(high for _, high in self._ranges) - min(low for low, _ in self._ranges))


class PeaksEstimator(CycleEstimator):
    """V_s and omega_s from the peaks of the window, then Eqs. 5 to 8."""

    method: ClassVar[str] = "peaks"

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._filter = LowPass(self.settings.lowpass_hz)
        self._finder = PeakFinder()
        self._peaks: deque[Peak] = deque(maxlen=self.window + 1)

    def listen(self, row: Row) -> None:
        """Filter the sample and look for a peak."""
        found = self._finder.update(row.t, self._filter.update(row.t, row.y))
        if found is None:
            return
        if len(self._peaks) >= 2 and _peak_to_peak(found, self._peaks[-1]) > 2.0 * _peak_to_peak(
            *list(self._peaks)[-2:]
        ):
            last = self._peaks[-1]
            self._peaks.clear()  # what came before was noise, or the start
            self._peaks.append(last)
        self._peaks.append(found)

    def measure(self, switch: Switch, t: Array, y: Array) -> None:  # noqa: ARG002 (peaks come by `listen`)
        """Only the range of the signal is kept by half cycles."""
        self._finder.next_half_cycle()

    def solve(self) -> Solution | None:
        """Eqs. 5 to 8 on the means of the window."""
        peaks = list(self._peaks)
        if len(peaks) < 3:
            return None
        periods = [b.t - a.t for a, b in zip(peaks, peaks[2:], strict=False)]
        amplitudes = [0.5 * abs(b.y - a.y) for a, b in pairwise(peaks)]
        frequency, amplitude = 2.0 * math.pi / fmean(periods), fmean(amplitudes)
        if amplitude <= 0.0:
            return None
        K_L, e_a = self.record.K_L, self.record.e_a
        same_side = peaks[(len(peaks) - 1) % 2]
        return Solution(
            repeats=[[math.log(x) for x in periods], [math.log(max(x, 1e-300)) for x in amplitudes]],
            frequency=frequency,
            amplitude=amplitude,
            plant=invert_eq8(frequency, amplitude, K_L, e_a),
            sd=None,
            mean_speed=(peaks[-1].y - same_side.y) / (peaks[-1].t - same_side.t),
            delay_s=self._delay(frequency),
        )

    def _delay(self, frequency: float) -> float | None:
        """How far the low-passed signal lags the motion [s]; None where nothing is known to lag."""
        cutoff, tau = self.settings.lowpass_hz, self.settings.lag_s
        lags = [tau] if cutoff is None else [tau, 1.0 / (2.0 * math.pi * cutoff)]
        return sum(first_order(each, frequency).delay for each in lags) or None


def _peak_to_peak(a: Peak, b: Peak) -> float:
    return abs(a.y - b.y)
