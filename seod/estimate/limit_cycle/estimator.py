"""What all limit cycle estimators share: when to listen, when to answer, how far to trust the answer."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from seod.estimate import quality
from seod.estimate.base import Estimate, EstimatorSettings, Row, finite_or_none
from seod.estimate.limit_cycle.fitness import fitness
from seod.estimate.limit_cycle.record import Record, sound
from seod.estimate.limit_cycle.sensor_lag import first_order

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.base import Estimator
    from seod.estimate.limit_cycle.inversion import Plant
    from seod.estimate.limit_cycle.switches import Switch


@dataclass(frozen=True, slots=True)
class Solution:
    """What an estimator makes of its window. Units as in `Estimate`."""

    repeats: list[list[float]]
    """Logarithms of what has to repeat from cycle to cycle, one value for each half cycle."""
    frequency: float
    amplitude: float
    plant: Plant | None
    sd: Plant | None
    mean_speed: float
    delay_s: float | None = None


class CycleEstimator(ABC):
    """Fed row by row; a subclass measures each half cycle and solves for the plant."""

    method: ClassVar[str]
    takes_second_phase: ClassVar[bool] = False
    """Whether switches that come late on purpose tell it something."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self.settings = settings
        self.window = 2 * max(settings.cycles, 2)
        """Half cycles that are averaged and have to agree."""
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.record = Record(self.settings, self.window)
        self._clips: deque[bool] = deque(maxlen=2)
        self._saturated = False
        self._quality = ""
        self._was_settled = False

    def update(self, row: Row) -> Estimate | None:
        """Take one row; an estimate when a half cycle has just ended or the state of the answer changed."""
        if not row.exciting:
            if self.record.has_begun:
                self.reset()
            return None
        if row.second and not self.takes_second_phase:
            return self._pause(row)
        good = sound(row)
        if good is None:
            return None
        if self.record.breaks(good):
            self.reset()
        if self.record.is_new(good):
            self.listen(good)
        self._saturated |= good.saturated
        switch = self.record.take(good)
        return self._look() if switch is None else self._answer(switch)

    def _pause(self, row: Row) -> Estimate | None:
        """The relay is in its second phase: nothing can be said until the first is back and has settled."""
        if not self.record.has_begun:
            return None
        self.reset()
        return Estimate(row.t_u, self.method, "settling", advice=quality.SECOND_PHASE)

    def inherit(self, before: Estimator) -> None:  # noqa: B027 (only some estimators learn of the rig)
        """Take over what an estimator of other settings has learnt of the rig itself."""

    def listen(self, row: Row) -> None:  # noqa: B027 (only some estimators look at each sample)
        """Take a row with a new sample."""

    @abstractmethod
    def measure(self, switch: Switch, t: Array, y: Array) -> None:
        """Take the half cycle after `switch`, which the record has already, with the samples around it."""

    @abstractmethod
    def solve(self) -> Solution | None:
        """The plant by the window; None before there is a whole cycle."""

    def _look(self) -> Estimate | None:
        """Between half cycles: an estimate where the state of the answer changed."""
        word = self._state()
        if word == self._quality:
            return None
        self._quality = word
        advice = self._why_still() if word == "no_oscillation" else quality.ADVICE[word]
        return self._without_numbers(advice)

    def _without_numbers(self, advice: str) -> Estimate:
        K_L = None if math.isinf(self.settings.K_L_sd) else finite_or_none(self.record.K_L)
        return Estimate(self.record.now, self.method, self._quality, K_L=K_L, advice=advice)

    def _state(self) -> str:
        if self.record.is_stale:
            return "stale"
        if self.record.is_still:
            return "no_oscillation"
        return "settling" if self._quality in {"", "stale"} else self._quality

    def _why_still(self) -> str:
        """Why the relay does not switch: the actuator stands, or runs one way."""
        record = self.record
        run = record.samples[record.since(record.switched) :]
        moved = abs(run[-1] - run[0]) if run else 0.0
        possible = self.record.K_L * record.e_a * (record.now - record.switched)
        return quality.STANDS if moved < 0.02 * possible else quality.DRIFTS

    def _answer(self, switch: Switch) -> Estimate | None:
        record = self.record
        t, y = np.array(record.times), np.array(record.samples)
        self.measure(switch, t, y)
        half_cycle = record.samples[record.since(switch.seen) :]
        self._clips.append(self._saturated or quality.clipped(half_cycle))
        self._saturated = False
        solution = self.solve() if len(record.switches) > 2 else None
        self._quality = self._judge(solution, len(half_cycle))
        if solution is None:
            return self._without_numbers(quality.ADVICE[self._quality])
        fit = self._fitness(solution, t, y)
        record.forget(record.switches[-2].t - record.durations[-2])
        return self._estimate(solution, fit)

    def _fitness(self, solution: Solution, t: Array, y: Array) -> float | None:
        lag = first_order(self.settings.lag_s, solution.frequency)
        gain = self.record.K_L * self.record.e_a / lag.ratio
        return fitness(solution.plant, list(self.record.switches)[-3:], gain, t - lag.delay, y)

    def _judge(self, solution: Solution | None, count: int) -> str:
        """The quality word for `count` samples in the half cycle: the first that applies, worst first."""
        if len(self.record.switches) <= self.window:
            return "settling"
        if solution is None or count < quality.SAMPLES_MIN or self._is_lost(solution.amplitude):
            return "no_oscillation"
        asymmetric = abs(self._asymmetry()) > quality.ASYMMETRY_MAX
        words = (
            ("saturated", any(self._clips)),
            ("noisy", self._is_noisy(solution.amplitude)),
            ("settling", not self._is_settled(solution)),
            ("asymmetric", asymmetric),
            ("out_of_range", solution.plant is None),
        )
        return next((word for word, applies in words if applies), "ok")

    def _is_lost(self, amplitude: float) -> bool:
        lost_in_noise = self.record.noise.sd > quality.NO_OSCILLATION_NOISE * amplitude
        return lost_in_noise or amplitude <= self.settings.hysteresis

    def _is_noisy(self, amplitude: float) -> bool:
        switches = self.record.switches
        chatter = sum(s.merged > 1 for s in switches) / len(switches)
        return chatter > quality.CHATTER_MAX or self.record.noise.sd > quality.NOISE_MAX * amplitude

    def _is_settled(self, solution: Solution) -> bool:
        if any(len(x) < self.window - 1 for x in solution.repeats):
            return False
        slack, allowed = 1.0, quality.AGREEMENT
        if self._was_settled:
            slack = quality.ONCE_SETTLED
            allowed += self.settings.period_s * solution.frequency / (2.0 * math.pi)
        self._was_settled = all(quality.agree(x, allowed, slack) for x in solution.repeats)
        return self._was_settled

    def _asymmetry(self) -> float:
        """Duty of the upper half of the relay minus 1/2, over whole cycles."""
        switches, durations = list(self.record.switches), self.record.durations
        first = len(durations) % 2
        up = sum(d for s, d in zip(switches[first:], durations[first:], strict=False) if s.up)
        return up / sum(durations[first:]) - 0.5

    def _estimate(self, solution: Solution, fit: float | None) -> Estimate:
        plant, sd = solution.plant, solution.sd
        if self._quality == "no_oscillation":
            plant = sd = fit = None
        return Estimate(
            t=self.record.now,
            method=self.method,
            quality=self._quality,
            zeta=plant and finite_or_none(plant.zeta),
            zeta_sd=sd and finite_or_none(sd.zeta),
            omega_n=plant and finite_or_none(plant.omega_n),
            omega_n_sd=sd and finite_or_none(sd.omega_n),
            K_L=self.record.K_L,
            delay_s=solution.delay_s,
            frequency=finite_or_none(solution.frequency),
            amplitude=finite_or_none(solution.amplitude),
            asymmetry=finite_or_none(self._asymmetry()),
            mean_speed=finite_or_none(solution.mean_speed),
            fitness=fit,
            advice=quality.ADVICE.get(self._quality),
        )
