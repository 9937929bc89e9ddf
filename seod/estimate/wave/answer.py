"""What a fit of the window says, and how far that is to be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.estimate.limit_cycle.closed_form import ZETA_MAX, ZETA_MIN
from seod.estimate.wave.fit import NAMES
from seod.estimate.wave.misfit import Misfit, misfit

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.wave.fit import Fit
    from seod.estimate.wave.phases import PhaseSegment
    from seod.estimate.wave.window import Window

FLOOR: Final = 1e-5
"""No sensor, clock or output is better than this part of the amplitude."""
CHANGED: Final = 18.0
"""Chi-square of two degrees above which the plant has changed within the window: once in 8000 of noise."""
DRIFTS: Final = 6.0
"""The same, above which it may have, once in ten of noise: a fit of both parts is less sure than it says."""
SUSPECT: Final = 0.01
"""Chance below which what repeats is believed, and widens the standard deviations."""
SURE: Final = 1e-4
"""Chance below which what repeats, if it is large as well, makes the answer `nonlinear`."""
MISFIT_MAX: Final = 5e-4
"""Part of the motion that may repeat beside the linear plant's."""
SURE_ZETA: Final = 0.1
SURE_OMEGA_N: Final = 0.03
"""Relative standard deviations of an answer that is worth having."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A fit, and what repeats in its residual.

    Attributes:
        window: What was fitted.
        fit: The most likely plant.
        newest: Samples of the newest cycle, shape (n,).
        repeats: What is not noise.
        widened: Factor on the noise of the fit's standard deviations: what repeats does not average.
        step: Of the sensor, as told or as its samples show it [unit]; 0: fine.
        covariance: Of the fit's `NAMES`, widened, and by a drift of the plant as well, shape (4, 4).
    """

    window: Window
    fit: Fit
    newest: slice
    repeats: Misfit
    widened: float
    step: float
    covariance: Array

    @classmethod
    def of(cls, window: Window, fit: Fit, period: float, alike: PhaseSegment | None = None) -> Answer:
        """Judge a fit's residual by the limit cycle's period [s], or where it is not one, cycles `alike`."""
        newest = slice(int(np.searchsorted(window.t, window.t[-1] - period)), None)
        among = slice(None) if alike is None else slice(*np.searchsorted(window.t, alike[:2]))
        repeats = misfit(window.t[among], fit.residual[among], period if alike is None else alike.period)
        motion = (window.y - fit.residual)[newest]
        finest = FLOOR * float(np.ptp(motion)) / max(fit.noise * fit.colour, 1e-300)
        step = max(window.resolution, steps_of(window.y))
        cycles = float(window.t[-1] - window.t[0]) / period
        # counts that repeat do so mirrored in the other half cycle: no more independent than half of one
        counts = math.sqrt(1.0 + max(2.0 * cycles - 1.0, 0.0) * repeating_counts(step, fit.noise))
        seen = math.sqrt(repeats.excess) if repeats.chance < SUSPECT else 1.0
        widened = max(1.0, finest, seen, counts)
        drift = math.sqrt(max(1.0, fit.changed / (DRIFTS * widened**2)))
        return cls(window, fit, newest, repeats, widened, step, fit.covariance(widened * drift))

    @property
    def noise(self) -> float:
        """White noise that would make deviations as wide as they are [unit]: what priors are weighed by."""
        return self.widened * self.fit.noise * self.fit.colour

    @property
    def model(self) -> Array:
        """The position, or the speed, of the newest cycle as the fit says it."""
        return np.asarray((self.window.y - self.fit.residual)[self.newest])

    @property
    def amplitude(self) -> float:
        """Half the peak-to-peak position of the newest cycle [unit]."""
        model = self.model
        if self.window.voltage.speed and len(model) > 1:
            swing = model - np.linspace(model[0], model[-1], len(model))  # about a speed that may change
            means = 0.5 * (swing[1:] + swing[:-1]) - np.mean(swing)
            model = np.cumsum(means * np.diff(self.window.t[self.newest]))
        return 0.5 * float(np.ptp(model))

    @property
    def mean_speed(self) -> float:
        """Over the newest cycle [unit/s]."""
        t, model = self.window.t[self.newest], self.model
        if self.window.voltage.speed:
            return float(np.mean(model))
        return float((model[-1] - model[0]) / (t[-1] - t[0])) if len(t) > 1 else 0.0

    @property
    def fitness(self) -> float | None:
        """1 - NRMSE of the newest cycle; 0 where the model is no better than the mean."""
        spread = float(np.var(self.window.y[self.newest]))
        if spread <= 0.0:
            return None
        return max(0.0, 1.0 - math.sqrt(float(np.var(self.fit.residual[self.newest])) / spread))

    @property
    def misfit(self) -> float:
        """What repeats, as a part of the motion (effective values)."""
        return self.repeats.size / max(float(np.std(self.model)), 1e-300)

    @property
    def is_nonlinear(self) -> bool:
        """Whether what repeats is too large, and no chance or coarse sensor's work."""
        coarse = self.repeats.size < self.step / math.sqrt(12.0)
        return self.repeats.chance < SURE and self.misfit > MISFIT_MAX and not coarse

    @property
    def has_changed(self) -> bool:
        """Whether the plant changed within the window."""
        return self.fit.changed > CHANGED * self.widened**2

    @property
    def is_in_range(self) -> bool:
        """Whether any limit cycle would tell such a zeta."""
        return ZETA_MIN <= self.fit.zeta <= ZETA_MAX

    @property
    def is_sure(self) -> bool:
        """Whether the standard deviations are small enough to be worth an answer."""
        sure_zeta = self.sd("zeta") < SURE_ZETA * self.fit.zeta
        return sure_zeta and self.sd("omega_n") < SURE_OMEGA_N * self.fit.omega_n

    def sd(self, name: str) -> float:
        """Standard deviation of one of `NAMES`."""
        k = NAMES.index(name)
        return math.sqrt(self.covariance[k, k])

    @property
    def correlation(self) -> dict[str, float]:
        """Of each pair of unknowns that was estimated."""
        sd = np.sqrt(self.covariance.diagonal())
        free = [k for k in range(len(NAMES)) if sd[k] > 0.0]
        return {
            f"{NAMES[a]},{NAMES[b]}": round(float(self.covariance[a, b] / (sd[a] * sd[b])), 4)
            for a, b in combinations(free, 2)
        }


def steps_of(y: Array) -> float:
    """The step of a coarse sensor as its samples show it [unit]; 0 where they seldom repeat."""
    values = np.unique(y)
    return float(np.median(np.diff(values))) if 2 < len(values) < 0.5 * len(y) else 0.0


def repeating_counts(step: float, noise: float) -> float:
    """Part of a residual's variance that is the error of counts which noise does not dither.

    It repeats from cycle to cycle where the period is locked to the ticks, as it often is.

    Args:
        step: Of the sensor [unit].
        noise: Standard deviation of the residual, the counts' own error included [unit].
    """
    if not step * noise > 0.0:
        return 0.0
    counts = step * step / 12.0
    dither = max(noise * noise - counts, 0.0)
    left = counts * math.exp(-min(4.0 * math.pi**2 * dither / step**2, 700.0))
    return min(left / noise**2, 1.0)
