"""Intervals of fitted parameters, and whether an effect gains anything at all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import ttest_1samp

from seod.diagnose.answer import Parameter
from seod.diagnose.contact import contacts, jumps
from seod.diagnose.fit import Search, least_square, weighted
from seod.diagnose.model import BASE, grouped
from seod.diagnose.simulate import inside
from seod.identify.spread import correlation_time
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from seod.diagnose.answer import Array
    from seod.diagnose.fit import Fitted
    from seod.diagnose.score import HeldOut

WIDE: Final = 1.96
BLOCKS: Final = 24
"""Pieces of the held-out windows that are compared, at least."""
_STEP: Final = 1e-4


def covariance(found: Fitted) -> Array:
    """Of the searched numbers, shape (p, p): wider by the residual's correlation where it is no noise.

    Of a coarse sensor's samples those count that lie outside their interval, by their own error.
    """
    cut = found.cut
    residual = np.where(cut.good, weighted(found.model, cut, found.x, found.start), 0.0)
    curvature = _curvature(found)
    if np.any(cut.slack > 0.0):
        outside = max(int(np.count_nonzero(residual)), 1) / int(np.count_nonzero(cut.good))
        curvature = np.asarray(outside * curvature)
    size = np.sqrt(np.maximum(curvature.diagonal(), 1e-300))
    scaled = curvature / np.outer(size, size)
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) / np.outer(size, size)
    whitened = np.concatenate(
        [residual[p] / math.sqrt(e + 1e-300) for p, e in zip(cut.slices, found.error, strict=True)]
    )
    out = np.asarray(inverse * max(1.0, correlation_time(whitened)))
    for k, coordinate in enumerate(found.model.coordinates):
        if coordinate.place == "backlash.gap":
            out[k, k] += (_closing(found) / coordinate.scale) ** 2
    return out


def _closing(found: Fitted) -> float:
    """Uncertainty of a play seen closing [unit]: jumps of a regular movement lie alike between samples."""
    record = found.model.record(found.x)
    if not jumps(record):
        return 0.0
    jump = contacts(found.cut, *inside(record, found.cut, found.start)).jump
    tick = found.cut.series[found.cut.windows[0][0]].tick
    return float(np.median(np.abs(jump))) * tick / math.sqrt(12.0) if len(jump) else 0.0


def _curvature(found: Fitted) -> Array:
    """Of the fit; where jumps were ramps, with the shortest."""
    if not jumps(found.model.record(found.x)):
        return found.curvature
    search = Search(found.model, found.cut, map, np.ones(len(found.x), np.bool_))
    residual, error = search.tried(found.x, found.start)
    return search.derivatives(found.x, found.start, residual, error).curvature()


def base_sd(found: Fitted, spread: Array) -> dict[str, float]:
    """Standard deviations of K_L, omega_n and zeta, whose logarithms are searched."""
    values = found.model.values(found.x)
    return {name: abs(values[name]) * math.sqrt(max(spread[k, k], 0.0)) for k, name in enumerate(BASE)}


def effect_parameters(found: Fitted, name: str, spread: Array) -> dict[str, Parameter]:
    """Values of an effect's parameters with their 95 % intervals."""
    model, x = found.model, found.x
    values, out = grouped(model.values(x))[name], {}
    for each in EFFECTS[name].parameters:
        if each.name not in values:
            continue
        place = f"{name}.{each.name}"
        value = values[each.name]
        slope = _slope(found, name, each.name)
        sd = math.sqrt(max(float(slope @ spread @ slope), 0.0))
        logarithm = any(c.place == place and c.logarithm for c in model.coordinates)
        ends = _ends(value, sd, logarithm)
        out[each.name] = Parameter(value, each.unit, (max(ends[0], each.low), min(ends[1], each.high)))
    return out


def _slope(found: Fitted, name: str, of: str) -> Array:
    """Of a parameter by the searched numbers."""
    slope = np.zeros(len(found.x))
    for k in range(len(slope)):
        values = []
        for sign in (1.0, -1.0):
            x = found.x.copy()
            x[k] += sign * _STEP
            values.append(grouped(found.model.values(x))[name][of])
        change = values[0] - values[1]
        if of == "phase":
            change = math.remainder(change, 2.0 * math.pi)
        slope[k] = change / (2.0 * _STEP)
    return slope


def _ends(value: float, sd: float, logarithm: bool) -> tuple[float, float]:
    if logarithm and value != 0.0:
        factor = math.exp(min(WIDE * sd / abs(value), 50.0))
        return min(value / factor, value * factor), max(value / factor, value * factor)
    return value - WIDE * sd, value + WIDE * sd


def p_value(without: HeldOut, with_it: HeldOut) -> float:
    """Of no gain: a one-sided t-test of the log errors of pieces of the same windows, with and without."""
    pieces = max(1, math.ceil(BLOCKS / len(without.cut.windows)))
    difference = _block_logs(without, pieces) - _block_logs(with_it, pieces)
    if len(difference) < 3 or not np.ptp(difference) > 0.0:
        return 1.0
    return float(ttest_1samp(difference, 0.0, alternative="greater").pvalue)


def _block_logs(held: HeldOut, pieces: int) -> Array:
    counts = held.scored & held.sure
    square = np.where(counts, held.error, 0.0) ** 2
    out = []
    for p, least in zip(held.cut.slices, least_square(held.cut), strict=True):
        rows = np.array_split(np.flatnonzero(counts[p]), pieces)
        out += [float(np.mean(square[p][each])) + least for each in rows if len(each)]
    return np.asarray(np.log(out))
