"""The measurement's noise, from differences so high that nothing but noise is left of a smooth signal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.result import SD_OF_MEDIAN
from seod.diagnose.tuning.record import NOISE

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask

ORDERS: Final = range(2, 9)


def noise_sd(t: Array, y: Array, good: Mask) -> float:
    """Standard deviation of white noise on `y`, shape (n,), sampled at `t` [s].

    A signal's own differences fall with their order until only noise is left: of the orders that are near the
    least the lowest counts, which scatters least. Differences over gaps and over rows that are not `good` are
    left out; nan if there are too few.
    """
    found: list[float] = []
    for order in ORDERS:
        difference, usable = _differences(t, y, good, order)
        if np.count_nonzero(usable) < NOISE.fewest:
            break
        found.append(_spread(difference[usable]) / math.sqrt(math.comb(2 * order, order)))
    return next((each for each in found if each <= NOISE.as_low_as_least * min(found)), math.nan)


def _differences(t: Array, y: Array, good: Mask, order: int) -> tuple[Array, Mask]:
    tick = float(np.median(np.diff(t)))
    even = np.abs(np.diff(t) / tick - 1.0) < NOISE.uneven
    usable = good.copy()
    steps = np.ones(len(t) - order, np.bool_)
    for k in range(order + 1):
        steps &= usable[k : len(t) - order + k]
    for k in range(order):
        steps &= even[k : len(t) - order + k]
    return np.diff(np.where(good, y, 0.0), order), steps


def _spread(difference: Array) -> float:
    """Root mean square without what is far off."""
    limit = NOISE.event_beyond * SD_OF_MEDIAN * float(np.median(np.abs(difference)))
    near = difference[np.abs(difference) <= limit]
    return float(np.sqrt(np.mean(near**2)))
