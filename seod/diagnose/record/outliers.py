"""Single samples that are far off, by the pattern that each leaves in fourth differences.

A corner or a jump of the signal leaves nearly the same pattern, and of two errors near each other neither
leaves its own. Neighbours tell: beside a cubic through them an error saves most, or two, or a bend does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr, ndtr

from seod.diagnose.record.cubic_neighbours import Neighbours
from seod.diagnose.record.fourth_differences import NORM, PATTERN
from seod.diagnose.result import SD_OF_95
from seod.diagnose.tuning.record import OUTLIERS

if TYPE_CHECKING:
    from seod.diagnose.record.fourth_differences import Stencils
    from seod.diagnose.result import Array, Mask, Rows

_IMPOSSIBLE: Final = 1e-300


@dataclass(frozen=True, slots=True)
class Outliers:
    """Rows that are off, and the law behind them: a part `rate` with normal errors of deviation `size`."""

    rows: Rows
    values: dict[str, float] = field(default_factory=dict)
    ci95: dict[str, tuple[float, float]] = field(default_factory=dict)
    p_value: float = 1.0


def outliers(stencils: Stencils, noise: Array) -> Outliers:
    """Of a recording's stencils; `noise` is the deviation of the sample in the middle of each, shape (m,)."""
    error = stencils.difference / PATTERN[2]
    beyond = stencils.usable & (np.abs(error) > OUTLIERS.beyond * noise)
    far = _unbent(stencils, np.flatnonzero(beyond & _alone(stencils, noise)))
    rows, sizes = stencils.middle[far], np.abs(error[far])
    if not OUTLIERS.fewest <= len(rows) <= OUTLIERS.most * len(error):
        return Outliers(rows if len(rows) < OUTLIERS.fewest else rows[:0])
    every = dict(zip(far.tolist(), sizes.tolist(), strict=True)) | _pairs(stencils, beyond, noise)
    rows, sizes = stencils.middle[sorted(every)], np.array([every[k] for k in sorted(every)])
    count = len(stencils.usable)
    threshold = min(OUTLIERS.beyond * float(np.median(noise)), float(np.min(sizes)))
    size, sd = _size(sizes, threshold)
    seen = 2.0 * float(ndtr(-threshold / size))
    rate = len(sizes) / count / seen
    if rate > OUTLIERS.most:
        return Outliers(rows[:0])
    width = SD_OF_95 * rate * math.sqrt(1.0 / len(sizes) + (sd / size) ** 2)
    ends = {
        "rate": (max(0.0, rate - width), min(1.0, rate + width)),
        "size": (max(0.0, size - SD_OF_95 * sd), size + SD_OF_95 * sd),
    }
    return Outliers(rows, {"rate": rate, "size": size}, ends, _IMPOSSIBLE)


def remaining_outliers(seen: Stencils, rest: Stencils, off: Rows) -> float:
    """Part of the outliers in the rows `off` that is in what a model leaves, too; 1 where it was not asked.

    Both stencils are of the same rows: of the readings, and of these less the model's.
    """
    there = np.isin(seen.middle, off) & seen.usable
    errors, left = seen.difference[there], rest.difference[there]
    square = float(errors @ errors)
    return float(errors @ left) / square if square > 0.0 else 1.0


def _unbent(stencils: Stencils, far: Rows) -> Rows:
    """Of samples far off those that an error of their own explains better than a corner or a jump."""
    kept = [far[:0]]
    for some in _at_once(far):
        near = Neighbours.of(stencils, some)
        kept.append(some if near is None else some[near.beside_errors()[0] < near.beside_a_bend()])
    return np.concatenate(kept)


def _at_once(rows: Rows) -> list[Rows]:
    """Rows of which all neighbours fit into little memory."""
    return np.array_split(rows, math.ceil(len(rows) / OUTLIERS.at_once)) if len(rows) else []


def _pairs(stencils: Stencils, beyond: Mask, noise: Array) -> dict[int, float]:
    """Of samples beyond noise, those that with another one near leave noise but for both errors, by number.

    Each hides the other's pattern.
    """
    found: list[tuple[float, list[int], Array]] = []
    some = np.flatnonzero(beyond)
    for gap in range(1, len(PATTERN)):
        every = np.unique(np.concatenate([some, some - gap]))
        for first in _at_once(every[(every >= 0) & (every + gap < len(beyond))]):
            found += _pairs_apart(stencils, first, gap, noise[first])
    taken: dict[int, float] = {}
    for _, pair, sizes in sorted(found, key=lambda one: one[:2]):
        if taken.keys().isdisjoint(pair):
            taken |= dict(zip(pair, sizes.tolist(), strict=True))
    return taken


def _pairs_apart(
    stencils: Stencils, first: Rows, gap: int, noise: Array
) -> list[tuple[float, list[int], Array]]:
    """Pairs so many rows apart: what they leave, both samples, and their errors' sizes; `noise` is (k,)."""
    near = Neighbours.of(stencils, first, gap)
    if near is None:
        return []
    left, errors = near.beside_errors()
    most = OUTLIERS.rest_by_noise * noise**2 * near.ticks.shape[1]
    good = left < np.minimum(most, (1.0 - OUTLIERS.likeness) * near.beside_a_bend())
    good &= np.min(np.abs(errors), axis=1) > OUTLIERS.beyond * noise
    both = np.stack([first, first + gap], axis=1)
    return [(left[k], both[k].tolist(), np.abs(errors[k])) for k in np.flatnonzero(good)]


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
