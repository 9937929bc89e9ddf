"""`wave`: maximum likelihood of the plant on a sliding window of voltages applied and positions measured."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from seod.estimate import quality
from seod.estimate.base import finite_or_none
from seod.estimate.known import Known
from seod.estimate.limit_cycle.estimator import CycleEstimator, Solution
from seod.estimate.limit_cycle.inversion import Measured, Plant, describing_function
from seod.estimate.plant.response import StepwiseVoltage
from seod.estimate.wave.answer import Answer
from seod.estimate.wave.delay_memory import WANDER, DelayMemory
from seod.estimate.wave.fit import fit, fit_late
from seod.estimate.wave.gain_course import under_one_gain
from seod.estimate.wave.phases import Phases
from seod.estimate.wave.window import Window

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.base import Estimate, Estimator, EstimatorSettings, Row
    from seod.estimate.limit_cycle.switches import Switch
    from seod.estimate.wave.fit import Fit

SHORTEST: Final = 2
"""Half cycles in the shortest window, besides the one that has just ended."""
SAME_VOLTAGE: Final = 1e-4
"""Part of e_a by which a voltage must differ from the one before to count as another."""
STARTS: Final = (0.2, 0.8)
"""Values of zeta from which the search begins where nothing better is known."""
ALL_STARTS: Final = 8
"""Of so many answers that nothing makes good, one tries all starts, the others the first: they take time."""
MOST_SAMPLES: Final = 40_000
"""Kept at most, so that a relay that never switches fills no memory."""
ASYMMETRY_MAX: Final = 0.2
"""The fit takes a load bias as it is; but one of 0.4 e_a leaves little to hold the actuator."""


class WaveEstimator(CycleEstimator):
    """The switches say when to answer and how far back to look; the fit needs no settled limit cycle."""

    method: ClassVar[str] = "wave"
    takes_second_phase: ClassVar[bool] = True

    def __init__(self, settings: EstimatorSettings) -> None:
        prior = Known(settings.delay_s, settings.delay_sd)
        self.delays = DelayMemory(prior, WANDER * settings.period_s)
        """Outlives a reset: another excitation finds the same delay."""
        super().__init__(settings)

    def inherit(self, before: Estimator) -> None:
        """Take over what `before` has learnt of the delay."""
        if isinstance(before, WaveEstimator):
            self.delays.inherit(before.delays)

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._clips = deque(maxlen=self.window)
        self._samples: list[tuple[float, float]] = []
        self._voltages: list[tuple[float, float, float]] = []
        self._phases = Phases()
        self._length = 0
        self._lost = 0
        self._newest: Answer | None = None

    def update(self, row: Row) -> Estimate | None:
        """Take one row; an estimate when a half cycle has just ended or the state of the answer changed."""
        estimate = super().update(row)
        if self.record.has_begun and row.t_u == self.record.now:
            self._apply(row)
        return estimate

    def _apply(self, row: Row) -> None:
        self._phases.note(row.t_u, row.second)
        if not self._voltages or abs(row.u - self._voltages[-1][1]) > SAME_VOLTAGE * row.e_a:
            self._voltages.append((row.t_u, row.u, self.record.gain_of(row)))

    def listen(self, row: Row) -> None:
        """Take a row with a new sample."""
        if math.isfinite(measured := row.speed if self.settings.integrated else row.y):
            self._samples.append((row.t, measured))
        if len(self._samples) > MOST_SAMPLES:
            del self._samples[: MOST_SAMPLES // 2]
            self._forget_voltages()

    def measure(self, switch: Switch, t: Array, y: Array) -> None:  # noqa: ARG002 (the fit looks at all samples)
        """A half cycle more may be in the window."""
        self._length = min(self._length + 1, self.window)

    def solve(self) -> Solution | None:
        """Fit the window, and a shorter one where the plant has changed within it."""
        answer = self._fitted()
        while answer and answer.has_changed and self._length > SHORTEST:
            self._newest = answer
            kept = round((1.0 - answer.fit.changed_at) * self._length)
            self._length = max(SHORTEST, min(kept, self._length - 1))
            answer = self._fitted()
        self._newest = answer
        if answer is None:
            return None
        if answer.is_in_range and not answer.is_nonlinear:
            self.delays.learn(answer)
        return Solution(
            repeats=[],
            frequency=2.0 * math.pi / self._period(),
            amplitude=answer.amplitude,
            plant=Plant(answer.fit.omega_n, answer.fit.zeta) if answer.is_in_range else None,
            sd=Plant(answer.sd("omega_n"), answer.sd("zeta")) if answer.is_in_range else None,
            mean_speed=answer.mean_speed,
            delay_s=answer.fit.delay,
        )

    def _fitted(self) -> Answer | None:
        """The newest window's answer; where its delay is another than before, by itself alone."""
        self._forget()
        window = self._window()
        if window is None:
            return None
        answer = self._best(window)
        if answer is not None and self.delays.contradicts(answer):
            self.delays.forget()
            answer = self._best(replace(window, delay=self.delays.prior))
        return answer

    def _best(self, window: Window) -> Answer | None:
        """From the fit before; where that leads nowhere good, the best from other places as well."""
        answer = None
        if self._newest:
            before = self._newest.fit
            answer = self._answer_from(window, Plant(before.omega_n, before.zeta), before.delay)
        if answer is not None and answer.is_in_range and not answer.is_nonlinear:
            self._lost = 0
        else:
            starts = self._starts()[: 1 if self._lost % ALL_STARTS else None]
            self._lost += 1
            others = (self._answer_from(window, start) for start in starts)
            answers = [each for each in (answer, *others) if each]
            answer = min(answers, key=lambda each: each.fit.noise, default=None)
        return answer

    def _answer_from(self, window: Window, start: Plant, delay: float | None = None) -> Answer | None:
        noise = self._newest.noise if self._newest else None
        found = fit(window, start.omega_n, start.zeta, delay, noise)
        if found is None or not found.converged:
            return None
        answer = self._judged(window, found)
        if not found.coloured or answer.is_nonlinear:
            return answer
        late = fit_late(window, found)
        return answer if late is None or not late.converged else self._judged(window, late)

    def _judged(self, window: Window, found: Fit) -> Answer:
        alike = self._phases.alike(window.t[0], self.record.switches)
        return Answer.of(window, found, self._period(), alike)

    def _starts(self) -> list[Plant]:
        """The plant by frequency and amplitude and, as these tell little at first, by frequency alone."""
        half, lag = 0.5 * self._period(), max(self.settings.delay_s, 0.5 * self.settings.period_s)
        V_s = 0.5 * float(np.ptp(self.record.samples)) if self.record.samples else 0.0
        if not half * V_s > 0.0:
            return []
        measured = Measured(half, half, lag, lag, V_s)
        known = self.settings.hysteresis, self.record.K_L, self.record.e_a
        return [describing_function(measured, *known), *(Plant(math.pi / half, zeta) for zeta in STARTS)]

    def _forget(self) -> None:
        """Drop what lies before the window, but for the voltage that was in force then."""
        switches = self.record.switches
        if self._length < len(switches):
            begin = switches[-1 - self._length].t
            del self._samples[: bisect_left(self._samples, (begin,))]
        self._forget_voltages()

    def _forget_voltages(self) -> None:
        first = self._samples[0][0] if self._samples else math.inf
        count = bisect_left(self._voltages, (first - self._longest_delay(),))
        del self._voltages[: max(count - 1, 0)]

    def _longest_delay(self) -> float:
        """What has to be reckoned with [s]."""
        value, sd = self.delays.known
        known = self._newest.fit.delay if self._newest else value
        return max(known, 0.0) + (min(3.0 * sd, 0.25 * self._period()) if sd else 0.0)

    def _period(self) -> float:
        """Of the limit cycle, by its newest two half cycles [s]."""
        newest = self.record.durations[-2:]
        return 2.0 * sum(newest) / max(len(newest), 1)

    def _window(self) -> Window | None:
        """What is to be fitted; None where it holds too little."""
        if not self._samples or not self._voltages:
            return None
        t_u, u, gains = np.array(self._voltages).T
        t, y = np.array(self._samples).T
        inside = t >= t_u[0] + self._longest_delay()
        t, y = t[inside], y[inside]
        if len(t) < 2:
            return None
        t_u, u, K_L = under_one_gain(t_u, u, gains, 0.5 * float(t[0] + t[-1]))
        known = self.settings
        return Window(
            t=t,
            y=y,
            voltage=StepwiseVoltage(t_u, u, t, known.integrated),
            K_L=Known(K_L, known.K_L_sd),
            delay=self.delays.before(float(t[0]), float(t[-1])),
            lag=known.lag_s,
            resolution=known.resolution,
        )

    def _fitness(self, solution: Solution, t: Array, y: Array) -> float | None:  # noqa: ARG002
        return self._newest.fitness if self._newest else None

    def _judge(self, solution: Solution | None, count: int) -> str:
        """The quality word for `count` samples in the half cycle: the first that applies, worst first."""
        full = self._length >= self.window
        answer = self._newest
        if solution is None or answer is None:
            return "no_oscillation" if len(self.record.switches) > self.window else "settling"
        words = (
            ("no_oscillation", count < quality.SAMPLES_MIN or self._is_lost(solution.amplitude)),
            ("saturated", any(self._clips) and answer.is_nonlinear),
            ("out_of_range", solution.plant is None and full),
            ("nonlinear", answer.is_nonlinear),
            ("noisy", not answer.is_sure and full),
            ("settling", not answer.is_sure or answer.has_changed or solution.plant is None),
            ("asymmetric", full and abs(self._asymmetry()) > ASYMMETRY_MAX),
        )
        return next((word for word, applies in words if applies), "ok")

    def _estimate(self, solution: Solution, fit: float | None) -> Estimate:
        """With what only a fit can tell."""
        estimate = super()._estimate(solution, fit)
        answer = self._newest
        if answer is None or estimate.zeta is None:
            return estimate
        return replace(
            estimate,
            K_L=answer.fit.K_L,
            K_L_sd=finite_or_none(answer.sd("K_L")),
            delay_sd_s=finite_or_none(answer.sd("delay")),
            misfit=answer.misfit,
            lag_s=self.record.now - 0.5 * float(answer.window.t[0] + answer.window.t[-1]),
            correlation=answer.correlation,
        )
