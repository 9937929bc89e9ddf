"""An offset of the sensor that moves slowly, as part of noise that remembers.

Within a recording such an offset goes up and down once or twice. A fit takes it for a slow movement, and
bends numbers to follow it. What is left does not show it then, nor do parts of the recording that all are
bent the same way. So numbers are told as if there were one, as large as the noise: half-waves over the
recording, each with the deviation of the noise (Bayesian linear model; Kay, Fundamentals of Statistical
Signal Processing, vol. 1, 11.6).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.least_squares import LeastSquares
from seod.diagnose.tuning.fitting import SLOW_OFFSET

if TYPE_CHECKING:
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.fitting.normal_equations import Normal
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def slow_part(noise: NoiseColour, cut: Cut) -> float:
    """Deviation of the offset that may be in such noise of windows [unit of y]; 0 where it is white.

    Or where a coarse sensor's rounding hides most of it.
    """
    return SLOW_OFFSET.part * noise.sd if noise.memory and not cut.coarse else 0.0


def half_waves(cut: Cut, first: int = 0) -> Array | None:
    """Of each recording, from the `first` on, 0: a constant; shape (n, k). None where noise has none."""
    if cut.slow == 0.0:
        return None
    columns = []
    for of in sorted({k for k, _, _ in cut.windows}):
        one = cut.series[of]
        angle = math.pi * (cut.gathered("t") - one.t[0]) / (one.t[-1] - one.t[0])
        own = np.repeat([k == of for k, _, _ in cut.windows], cut.sizes)
        columns += [
            cut.unforeseen(cut.slow * np.cos(k * angle) * own) for k in range(first, SLOW_OFFSET.most + 1)
        ]
    return np.stack(columns, axis=1)


def beside_slow_offset(fitted: Fitted, parallel: ParallelMap) -> Fitted:
    """The same set with the numbers that it has beside such an offset.

    One step: the offset is in the noise, so that it changes them by little. Where the simulation does not
    follow it in proportion they stay as they are.
    """
    beside = half_waves(fitted.cut)
    if beside is None:
        return fitted
    search = LeastSquares(fitted.model, fitted.cut, parallel, np.ones(len(fitted.x), np.bool_))
    residual, error = search.tried(fitted.x, fitted.start)
    parts = search.derivatives(fitted.x, fitted.start, residual, error, beside)
    step, states = stepped(parts, search, fitted.x)
    step[len(fitted.x) :] = 0.0  # the offset itself is no part of the model
    x = fitted.x + step[: len(fitted.x)]
    start, moved, new = search.moved(x, fitted.start, states, 1.0)
    astray = np.where(search.good, moved - residual + parts.along(step, states), 0.0)
    if float(astray @ astray) > SLOW_OFFSET.astray * float(residual[search.good] @ residual[search.good]):
        return fitted
    return replace(fitted, x=x, start=start, error=new)


def stepped(parts: Normal, search: LeastSquares, x: Array) -> tuple[Array, Array]:
    """The step to the least squares of what is searched and of what is beside it, and initial states'."""
    free = np.full(parts.unknowns - len(x), math.inf)
    low, high = np.maximum(search.low - x, -search.reach), np.minimum(search.high - x, search.reach)
    return parts.step(0.0, np.r_[low, -free], np.r_[high, free])
