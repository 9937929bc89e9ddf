"""Fourth differences: what a smooth signal leaves of them is the samples' own error.

For times that are not even they are divided differences, scaled so that white noise of the samples has the
same deviation in them as in even ones, sqrt(70) times its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.data.pauses import INTERVALS
from seod.diagnose.result import SD_OF_MEDIAN
from seod.diagnose.tuning.record import FOURTH_DIFFERENCES

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask

PATTERN: Final = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
NORM: Final = math.sqrt(70.0)
"""Of the pattern: deviation of the difference over that of the samples."""
CORRELATED: Final = math.sqrt(2.63)
"""Neighbouring differences share samples: a mean of squares is less certain by this."""


@dataclass(frozen=True, slots=True)
class Stencils:
    """Each five neighbouring samples of a recording.

    Attributes:
        difference: Fourth difference, shape (m,).
        weights: Of the five samples in it, shape (m, 5).
        samples: The five, shape (m, 5).
        ticks: Their times, over the median interval, shape (m, 5).
        middle: Index of the middle sample, shape (m,).
        usable: No gap within, shape (m,).
    """

    difference: Array
    weights: Array
    samples: Array
    ticks: Array
    middle: np.ndarray[tuple[int], np.dtype[np.int64]]
    usable: Mask

    @property
    def noise(self) -> float:
        """Robust deviation of the samples' error."""
        if not self.usable.any():
            return 0.0
        return SD_OF_MEDIAN * float(np.median(np.abs(self.difference[self.usable]))) / NORM


def stencils(t: Array, y: Array, rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Stencils:
    """Of the samples `y` at the times `t` [s], both shape (n,), at the `rows` that count."""
    t, y = t[rows], y[rows]
    ticks = np.lib.stride_tricks.sliding_window_view(t / float(np.median(np.diff(t))), 5)
    weights = _weights(ticks)
    samples = np.lib.stride_tricks.sliding_window_view(y, 5)
    difference = np.sum(weights * samples, axis=1)
    usable = ticks[:, -1] - ticks[:, 0] < FOURTH_DIFFERENCES.too_wide
    return Stencils(difference, weights, samples, ticks, rows[2:-2], usable)


def _weights(times: Array) -> Array:
    """Of divided differences, shape (m, 5)."""
    weights = np.ones_like(times)
    for k in range(5):
        for other in range(5):
            if other != k:
                weights[:, k] /= times[:, k] - times[:, other]
    weights *= NORM / np.linalg.norm(weights, axis=1, keepdims=True)
    return weights


def slopes(t: Array, y: Array, reach: int = FOURTH_DIFFERENCES.slope_reach) -> Array:
    """Slope of `y` at each time by a cubic through the `reach` neighbours on either side, shape (n,).

    Those beyond a pause are none; where too few are left it is the one of the smallest coefficients.
    """
    count, tick = len(t), float(np.median(np.diff(t)))
    at = np.clip(np.arange(count), reach, count - 1 - reach)[:, None] + np.arange(-reach, reach + 1)
    ticks = (t[at] - t[:, None]) / tick
    near = np.abs(ticks) <= INTERVALS
    powers = np.where(near, ticks, 0.0)[..., None] ** np.arange(4) * near[..., None]
    middles = np.sum(y[at] * near, axis=1) / near.sum(axis=1)
    normal = np.einsum("nki,nkj->nij", powers, powers)
    target = np.einsum("nki,nk->ni", powers, y[at] - middles[:, None])
    paused = ~near.all(axis=1)
    cubics = np.empty_like(target)
    cubics[~paused] = np.linalg.solve(normal[~paused], target[~paused][..., None])[..., 0]
    cubics[paused] = (np.linalg.pinv(normal[paused], hermitian=True) @ target[paused][..., None])[..., 0]
    return np.asarray(cubics[:, 1] / tick)
