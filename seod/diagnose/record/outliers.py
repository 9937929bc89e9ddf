"""Single samples that are far off, by the pattern that each leaves in fourth differences."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr, ndtr

from seod.diagnose.record.fourth_differences import NORM, PATTERN
from seod.diagnose.result import SD_OF_95
from seod.diagnose.tuning.record import OUTLIERS

if TYPE_CHECKING:
    from seod.diagnose.record.fourth_differences import Stencils
    from seod.diagnose.result import Array, Mask

_IMPOSSIBLE: Final = 1e-300


@dataclass(frozen=True, slots=True)
class Outliers:
    """Rows that are off, and the law behind them: a part `rate` with normal errors of deviation `size`."""

    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    values: dict[str, float] = field(default_factory=dict)
    ci95: dict[str, tuple[float, float]] = field(default_factory=dict)
    p_value: float = 1.0


def outliers(stencils: Stencils, noise: Array) -> Outliers:
    """Of a recording's stencils; `noise` is the deviation of the sample in the middle of each, shape (m,)."""
    error = stencils.difference / PATTERN[2]
    far = stencils.usable & (np.abs(error) > OUTLIERS.beyond * noise) & _alone(stencils, noise)
    far &= ~(_jumps(stencils, error, noise) | _corners(stencils, error))
    rows, sizes = stencils.middle[far], np.abs(error[far])
    if not OUTLIERS.fewest <= len(rows) <= OUTLIERS.most * len(error):
        return Outliers(rows if len(rows) < OUTLIERS.fewest else rows[:0])
    count = len(stencils.usable)
    threshold = min(OUTLIERS.beyond * float(np.median(noise)), float(np.min(sizes)))
    size, sd = _size(sizes, threshold)
    seen = 2.0 * float(ndtr(-threshold / size))
    rate = len(rows) / count / seen
    if rate > OUTLIERS.most:
        return Outliers(rows[:0])
    width = SD_OF_95 * rate * math.sqrt(1.0 / len(rows) + (sd / size) ** 2)
    ends = {
        "rate": (max(0.0, rate - width), min(1.0, rate + width)),
        "size": (max(0.0, size - SD_OF_95 * sd), size + SD_OF_95 * sd),
    }
    return Outliers(rows, {"rate": rate, "size": size}, ends, _IMPOSSIBLE)


def _jumps(stencils: Stencils, error: Array, noise: Array) -> Mask:
    """Whether the signal goes on from another level behind the sample than before it."""
    before, behind = (
        stencils.samples[:, 1] - stencils.samples[:, 0],
        stencils.samples[:, 4] - stencils.samples[:, 3],
    )
    across = stencils.samples[:, 3] - stencils.samples[:, 1] - before - behind
    least = np.maximum(OUTLIERS.jump_part * np.abs(error), OUTLIERS.jump_beyond * noise)
    return np.asarray(np.abs(across) > least)


def _corners(stencils: Stencils, error: Array) -> Mask:
    """Whether the signal goes on at another slope: a corner in the middle is seen as a third of its turn."""
    before, behind = (
        (stencils.samples[:, k + 1] - stencils.samples[:, k])
        / (stencils.ticks[:, k + 1] - stencils.ticks[:, k])
        for k in (0, 3)
    )
    return np.asarray((behind - before) * np.sign(-error) > OUTLIERS.corner * np.abs(error))


def _alone(stencils: Stencils, noise: Array) -> Mask:
    """Whether the differences around a sample show one error in it, not a corner of the signal."""
    near = np.pad(stencils.difference, 2)
    around = np.lib.stride_tricks.sliding_window_view(near, 5)
    explained = (around @ PATTERN / NORM) ** 2
    rest = np.sum(around**2, axis=1) - explained
    largest = np.max(np.abs(around), axis=1) <= np.abs(stencils.difference) * (1.0 + 1e-12)
    by_noise = OUTLIERS.rest_by_noise * (NORM * noise) ** 2
    return np.asarray(largest & (rest < (1.0 - OUTLIERS.likeness) * explained + by_noise))


def _size(sizes: Array, threshold: float) -> tuple[float, float]:
    """Deviation of a normal law of which only what is beyond the threshold is seen; and its own."""

    def cost(log_size: float) -> float:
        size = math.exp(log_size)
        seen = float(log_ndtr(-threshold / size))
        return float(np.sum(0.5 * (sizes / size) ** 2)) + len(sizes) * (log_size + seen)

    middle = math.log(float(np.sqrt(np.mean(sizes**2))))
    low, high = OUTLIERS.log_sizes
    best = float(minimize_scalar(cost, bounds=(middle + low, middle + high), method="bounded").x)
    step = OUTLIERS.log_step
    bend = (cost(best + step) - 2.0 * cost(best) + cost(best - step)) / step**2
    return math.exp(best), math.exp(best) / math.sqrt(max(bend, OUTLIERS.least_bend))
