"""`exact`: the limit cycle inverted in closed form, with hysteresis and the lag of each half cycle."""

from __future__ import annotations

import math
from collections import deque
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

from scipy.special import stdtrit

from seod.estimate.limit_cycle.estimator import CycleEstimator, Solution
from seod.estimate.limit_cycle.half_cycle import HalfCycle, SwitchWindow, means, measure, without_fit_error
from seod.estimate.limit_cycle.inversion import Measured, Plant, Sensitivity, invert, sensitivity
from seod.estimate.limit_cycle.sensor_lag import first_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.estimate.arrays import Array
    from seod.estimate.limit_cycle.switches import Switch


_FIT_ERROR = 2e-4
"""What sampled fits leave at best, as a part of either unknown (measured, without noise)."""


class ExactEstimator(CycleEstimator):
    """Means of period, lag and amplitude over the window, inverted exactly."""

    method: ClassVar[str] = "exact"

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._halves: deque[HalfCycle] = deque(maxlen=self.window)

    def measure(self, switch: Switch, t: Array, y: Array) -> None:
        """Fit the crossing that caused `switch` and the peak after it."""
        durations = self.record.durations
        if not durations:
            return
        level = self.record.reference + self.settings.hysteresis * (-1.0 if switch.up else 1.0)
        after = self.record.switched + self.settings.delay_s - switch.t
        around = SwitchWindow(switch.up, switch.t, switch.seen, level, durations[-1], after)
        half = measure(around, t, y)
        if half is None or (self._halves and self._halves[-1].up == half.up):
            self._halves.clear()  # one was missed: the halves must alternate
        if half:
            self._halves.append(half)

    def solve(self) -> Solution | None:
        """Invert the means of the window."""
        halves = list(self._halves)
        seen = means(halves)
        if seen is None or seen.V_s <= 0.0:
            return None
        lag = first_order(self.settings.lag_s, 2.0 * math.pi / (seen.h_up + seen.h_down))
        measured, hysteresis = lag.removed(seen), lag.ratio * self.settings.hysteresis
        plant = self._invert(measured, hysteresis)
        by = plant and self._sensitivity(plant, measured, hysteresis)
        return Solution(
            repeats=_repeats(halves, by),
            frequency=2.0 * math.pi / (measured.h_up + measured.h_down),
            amplitude=measured.V_s,
            plant=plant,
            sd=plant and by and _deviation(plant, halves, by, lambda each: self._untold(each, measured)),
            mean_speed=_drift(halves),
            delay_s=0.5 * (measured.lag_up + measured.lag_down),
        )

    def _invert(self, measured: Measured, hysteresis: float) -> Plant | None:
        known = (hysteresis, self.record.K_L, self.record.e_a)
        plant = invert(measured, *known)
        if plant is None:
            return None
        corrected = without_fit_error(measured, plant, self.record.K_L * self.record.e_a)
        return invert(corrected, *known, start=plant)

    def _untold(self, by: Measured, measured: Measured) -> float:
        """What doubt in K_L and delay adds to the deviation of an unknown's logarithm, by its derivatives."""
        known = self.settings
        delay = (by.lag_up + by.lag_down) * known.delay_sd if known.delay_sd else 0.0
        gain = by.V_s * measured.V_s * known.K_L_sd / self.record.K_L if known.K_L_sd else 0.0
        return math.hypot(delay, gain)

    def _sensitivity(self, plant: Plant, measured: Measured, hysteresis: float) -> Sensitivity:
        return sensitivity(plant, measured, hysteresis, self.record.K_L, self.record.e_a)


def _shares(halves: Sequence[HalfCycle], by: Measured) -> list[float]:
    """What each half cycle alone says of the logarithm of an unknown, but for a constant, by its derivatives.

    A switch that came late lengthens the half cycle before it and shortens the one after it: half of each is
    taken, so that jitter of the relay, which the motion follows, hardly counts as scatter.
    """
    return [
        0.5 * (by.h_down * h.before + by.h_up * h.after - by.V_s * h.peak) + by.lag_up * h.lag
        if h.up
        else 0.5 * (by.h_up * h.before + by.h_down * h.after + by.V_s * h.peak) + by.lag_down * h.lag
        for h in halves
    ]


def _repeats(halves: Sequence[HalfCycle], by: Sensitivity | None) -> list[list[float]]:
    """What has to agree: length and amplitude of the cycles, and the omega_n and zeta of each."""
    pairs = list(pairwise(halves))
    repeats = [
        [math.log(a.before + b.before) for a, b in pairs],
        [math.log(max(abs(b.peak - a.peak), 1e-300)) for a, b in pairs],
    ]
    answers = [_shares(halves, unknown) for unknown in by or ()]
    return repeats + [[a + b for a, b in pairwise(answer)] for answer in answers]


def _deviation(
    plant: Plant, halves: Sequence[HalfCycle], by: Sensitivity, untold: Callable[[Measured], float]
) -> Plant | None:
    """Standard deviations of omega_n and zeta, from the scatter of the half cycles about their side's mean.

    With few half cycles the scatter itself is uncertain, so it is widened by Student's factor: +-1.96 sd is
    a 95 % interval. What half cycles share, as a delay that is `untold`, does not scatter.
    """
    parts = []
    for unknown in by:
        shares = _shares(halves, unknown)
        sides = [[x for x, h in zip(shares, halves, strict=True) if h.up is up] for up in (True, False)]
        if min(len(side) for side in sides) < 2:
            return None
        scatter = math.sqrt(sum(_variance(side) / len(side) for side in sides)) * _student(len(halves) - 2)
        parts.append(math.hypot(scatter, _FIT_ERROR, untold(unknown)))
    return Plant(plant.omega_n * parts[0], plant.zeta * parts[1])


def _drift(halves: Sequence[HalfCycle]) -> float:
    """Mean speed from the oldest to the newest peak of the same side."""
    first, last = halves[(len(halves) - 1) % 2], halves[-1]
    return (last.peak - first.peak) / (last.t_peak - first.t_peak) if last.t_peak > first.t_peak else 0.0


def _variance(values: Sequence[float]) -> float:
    mean = sum(values) / len(values)
    return sum((x - mean) ** 2 for x in values) / (len(values) - 1)


@cache
def _student(freedom: int) -> float:
    return float(stdtrit(freedom, 0.975)) / 1.96
