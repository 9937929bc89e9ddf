"""`wave`: maximum likelihood of the plant on a sliding window of voltages applied and positions measured."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from seod.estimate.exact import ExactEstimator
from seod.estimate.inversion import Plant
from seod.estimate.plant_response import StepwiseVoltage
from seod.estimate.wave_fit import Known, Window, fit

if TYPE_CHECKING:
    from seod.estimate.base import Estimate, Row
    from seod.estimate.cycle import Solution
    from seod.estimate.wave_fit import Fit

START = Plant(omega_n=math.nan, zeta=0.5)


class WaveEstimator(ExactEstimator):
    """`exact` tells when there is a limit cycle and where to begin; the fit takes it from there."""

    method: ClassVar[str] = "wave"

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self.samples: list[tuple[float, float]] = []
        self.voltages: list[tuple[float, float]] = []
        self.fit: Fit | None = None

    def update(self, row: Row) -> Estimate | None:
        """Take one row; an estimate when a half cycle has just ended or the state of the answer changed."""
        if row.exciting and (not self.voltages or row.u != self.voltages[-1][1]):
            self.voltages.append((row.t_u, row.u))
        return super().update(row)

    def listen(self, row: Row) -> None:
        """Take a row with a new sample."""
        self.samples.append((row.t, row.y))

    def solve(self) -> Solution | None:
        """Fit the window, from the fit before or from the exact inversion of its means."""
        rough = super().solve()
        if rough is None:
            return None
        self.forget(self.record.switches[0].t)
        start = rough.plant or (self.fit and Plant(self.fit.omega_n, self.fit.zeta))
        self.fit = None if start is None else fit(self._window(), start.omega_n, start.zeta)
        if self.fit is None:
            return replace(rough, plant=None, sd=None)
        plant = Plant(self.fit.omega_n, self.fit.zeta)
        return replace(rough, plant=plant, sd=Plant(self.fit.sd("omega_n"), self.fit.sd("zeta")))

    def forget(self, t: float) -> None:
        """Drop what lies before `t` [s], but for the voltage that was in force then."""
        del self.samples[: bisect_left(self.samples, (t, -math.inf))]
        count = bisect_left(self.voltages, (t, -math.inf))
        del self.voltages[: max(count - 1, 0)]

    def _window(self) -> Window:
        t, y = np.array(self.samples).T
        t_u, u = np.array(self.voltages).T
        inside = t >= t_u[0]
        t, y = t[inside], y[inside]
        K_L = Known(self.record.K_L, self.settings.K_L_sd)
        delay = Known(self.settings.delay_s, self.settings.delay_sd)
        return Window(
            t, y, StepwiseVoltage(t_u, u, t), K_L, delay, self.settings.lag_s, self.settings.resolution
        )
