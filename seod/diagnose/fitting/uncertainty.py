"""Intervals of fitted parameters, and whether an effect gains anything at all."""

from __future__ import annotations

import math
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm, t, ttest_1samp

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import CAUSES, GAPS, WHOLE_PARTS
from seod.diagnose.fitting.backlash_jumps import contacts, jumps
from seod.diagnose.fitting.beside import correlated_rows, linear
from seod.diagnose.fitting.least_squares import least_square
from seod.diagnose.fitting.model import grouped
from seod.diagnose.fitting.simulate import inside
from seod.diagnose.result import SD_OF_95, Parameter
from seod.diagnose.tuning.fitting import UNCERTAINTY
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.causes.cause import Coordinate
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.normal_equations import Normal
    from seod.diagnose.result import Array, Mask
    from sim.effects import Parameter as EffectParameter


def covariance(fitted: Fitted) -> Array:
    """Of the searched numbers, shape (p, p): wider by the residual's correlation where it is no noise.

    And at least as wide as parts of the recordings pull each number to and fro: what bends one of them
    slowly is not in the correlation. And beside what is beside the model. Of
    a coarse sensor's samples those count that lie outside their interval, by their own error. A number that
    the samples do not show at all is known to lie within its bounds.
    """
    cut = fitted.cut
    parts, left = linear(fitted)
    curvature = parts.curvature()
    if cut.coarse:
        outside = max(int(np.count_nonzero(left)), 1) / int(np.count_nonzero(cut.good))
        curvature = np.asarray(outside * curvature)
    searched, correlation = slice(len(fitted.x)), max(1.0, correlated_rows(fitted, left))
    bounds = np.full(parts.unknowns, correlation - 1.0)  # of what is beside the model, known as well as it is
    bounds[searched] = correlation * _by_bounds(fitted)
    inverse = _inverse(curvature, bounds)
    every = np.asarray(inverse * correlation)
    pulled = (_pulled(parts, inverse, left) / np.maximum(every.diagonal(), 1e-300))[searched]
    wider = np.sqrt(np.maximum(1.0, pulled))
    out = np.asarray(every[searched, searched] * np.outer(wider, wider))
    for k, coordinate in enumerate(fitted.model.coordinates):
        if coordinate.place in GAPS:
            out[k, k] += (_closing(fitted) / coordinate.scale) ** 2
    return out


def _inverse(curvature: Array, bounds: Array) -> Array:
    """Of the curvature by the samples, shape (p, p), and by bounds, shape (p,): no variance is negative.

    Initial states were eliminated: a difference of large numbers, whose rounding may bend a valley the
    wrong way or say that a correlation is beyond 1. Along such a valley only the bounds tell.
    """
    size = np.sqrt(np.maximum(curvature.diagonal() + bounds, 1e-300))
    with np.errstate(over="ignore"):
        scaled = np.clip(curvature / size[:, None] / size, -1.0, 1.0)
    bends, along = np.linalg.eigh(scaled)
    scaled = along * np.maximum(bends, 0.0) @ along.T + np.diag(bounds / size**2)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) / size[:, None] / size)


def _pulled(parts: Normal, inverse: Array, left: Array) -> Array:
    """Variance of each searched number by how parts of what is left pull it to and fro; shape (p,).

    Liang and Zeger, Biometrika 73, 1986, with Student's t of as few parts: the largest of several lengths.
    """
    rows = sum(each.stop - each.start for each in parts.slices)
    out = np.zeros(parts.unknowns)
    for count in UNCERTAINTY.pulling_parts:
        pulls = parts.pulls(rows / count, left) @ inverse
        free = len(pulls) - 1
        if free >= UNCERTAINTY.fewest_pulling:
            wider = float(t.ppf(UNCERTAINTY.upper_end, free) / SD_OF_95) ** 2 * len(pulls) / free
            out = np.maximum(out, wider * np.sum(pulls**2, axis=0))
    return out


def _by_bounds(fitted: Fitted) -> Array:
    """Curvature by each number's bounds, as if they were a standard deviation off; 0 where it is given.

    Of a wave's parts by its amplitude: where nothing tells its phase, both lie within that.
    """
    low, high = fitted.model.bounds
    wide = high - low
    for wave in (name for name in fitted.model.names if CAUSES[name].wave is not None):
        places = {f"{wave}.sine", f"{wave}.cosine"}
        parts = [k for k, each in enumerate(fitted.model.coordinates) if each.place in places]
        wide[parts] = np.minimum(wide[parts], max(2.0 * math.hypot(*fitted.x[parts]), 1e-300))
    return np.divide(1.0, wide**2, out=np.zeros_like(wide), where=wide > 0.0)


def _closing(fitted: Fitted) -> float:
    """Uncertainty of a gap seen closing [unit]: jumps of a regular movement lie alike between samples."""
    record = fitted.model.kernel_parameters(fitted.x)
    if not jumps(record):
        return 0.0
    jump = contacts(fitted.cut, *inside(record, fitted.cut, fitted.start)).jump
    tick = fitted.cut.series[fitted.cut.windows[0][0]].tick
    return float(np.median(np.abs(jump))) * tick / math.sqrt(12.0) if len(jump) else 0.0


def base_sd(fitted: Fitted, spread: Array) -> dict[str, float]:
    """Standard deviations of K_L, omega_n and zeta."""
    slopes = {name: _slope(fitted, itemgetter(name)) for name in BASE}
    return {name: math.sqrt(max(float(slope @ spread @ slope), 0.0)) for name, slope in slopes.items()}


def effect_parameters(fitted: Fitted, name: str, spread: Array) -> dict[str, Parameter]:
    """Values of an effect's parameters with their 95 % intervals; of what is not searched without width."""
    model, x = fitted.model, fitted.x
    values, out = grouped(model.values(x))[name], {}
    every = model.effects(x)[name]
    for each in EFFECTS[name].parameters:
        if each.name not in values:
            if each.name in every:
                out[each.name] = Parameter(every[each.name], each.unit, (every[each.name],) * 2)
            continue
        place = f"{name}.{each.name}"
        value = values[each.name]
        slope = _slope_of(fitted, name, each.name)
        sd = math.sqrt(max(float(slope @ spread @ slope), 0.0))
        logarithm = any(c.place == place and c.logarithm for c in model.coordinates)
        ends = _ends(value, sd, logarithm)
        out[each.name] = Parameter(value, each.unit, (max(ends[0], each.low), min(ends[1], each.high)))
    return out


def reaches_null(fitted: Fitted, name: str, spread: Array, tried: int = 1) -> bool:
    """Whether the interval of an effect's size reaches the value at which it does nothing.

    An effect's first parameter is its size, but of one that has several sizes. Wide enough that of `tried`
    causes that do nothing one in twenty searches finds one beyond it (Bonferroni).
    """
    reach = float(norm.isf((1.0 - UNCERTAINTY.upper_end) / tried))
    return all(_near_null(fitted, name, each, spread, reach) for each in _sizes(fitted, name))


def is_at_null(fitted: Fitted, name: str) -> bool:
    """Whether an effect's size is at the end of its range where it does nothing, or as good as nothing."""
    at, sizes = _limits(fitted), _sizes(fitted, name)
    return bool(sizes) and all((f"{name}.{each.name}", each.null) in at for each in sizes)


def _sizes(fitted: Fitted, name: str) -> list[EffectParameter]:
    """Of an effect's parameters those that were searched and are its size."""
    effect, values = EFFECTS[name], grouped(fitted.model.values(fitted.x))[name]
    sizes = [p for p in effect.parameters if p.name in effect.sizes] or effect.parameters[:1]
    return [each for each in sizes if each.name in values]


def _near_null(fitted: Fitted, name: str, parameter: EffectParameter, spread: Array, sds: float) -> bool:
    value = grouped(fitted.model.values(fitted.x))[name][parameter.name]
    slope = _slope_of(fitted, name, parameter.name)
    reach = sds * math.sqrt(max(float(slope @ spread @ slope), 0.0))
    off = abs(value) if math.isinf(parameter.null) else abs(value - parameter.null)
    place = f"{name}.{parameter.name}"
    if any(at == place and end == parameter.null for at, end in _limits(fitted)):
        return True
    return off <= reach or (parameter.null == 0.0 and _near_least(fitted, place, spread, sds))


def _near_least(fitted: Fitted, place: str, spread: Array, sds: float) -> bool:
    """Whether the interval of a size whose logarithm is searched reaches the least, as good as none."""
    return any(
        each.place == place
        and each.logarithm
        and fitted.x[k] - sds * math.sqrt(max(spread[k, k], 0.0)) <= each.bounds[0]
        for k, each in enumerate(fitted.model.coordinates)
    )


def at_limits(fitted: Fitted) -> list[str]:
    """Places of searched numbers that are at an end of their range, where it is none that does nothing."""
    return [place for place, end in _limits(fitted) if math.isnan(end)]


def _limits(fitted: Fitted) -> list[tuple[str, float]]:
    """Places of searched numbers at an end of their range, with the null value that lies there, else nan."""
    out = []
    for x, c in zip(fitted.x, fitted.model.coordinates, strict=True):
        low, high = c.bounds
        if not low < high or c.place in WHOLE_PARTS:  # it is known, or all is
            continue
        null = _null(c.place)
        off_below, off_above = null == 0.0 and c.low >= 0.0, null == math.inf
        if high - x < _near(c, high, off=off_above):
            out.append((c.place, math.inf if off_above else math.nan))
        elif x - low < _near(c, low, off=off_below):
            out.append((c.place, 0.0 if off_below else math.nan))
    return out


def _near(coordinate: Coordinate, end: float, *, off: bool) -> float:
    """How far from an end of its range a number counts as being there; `off`: it does nothing there."""
    low, high = coordinate.bounds
    if off:
        return UNCERTAINTY.near_null * (high - low)
    size = 1.0 if coordinate.logarithm else abs(end)
    return UNCERTAINTY.near_limit * min(high - low, size)


def _null(place: str) -> float:
    """At which a parameter does nothing; nan of Eq. 1's, and of a wave's parts."""
    name, _, of = place.partition(".")
    every = EFFECTS[name].parameters if name in EFFECTS else ()
    return next((each.null for each in every if each.name == of), math.nan)


def _slope_of(fitted: Fitted, name: str, of: str) -> Array:
    """Of an effect's parameter by the searched numbers; a phase goes round."""
    turn = 2.0 * math.pi if of == "phase" else math.inf
    return _slope(fitted, lambda values: grouped(values)[name][of], turn)


def _slope(fitted: Fitted, number: Callable[[Values], float], goes_round: float = math.inf) -> Array:
    """Of a number of the model by the searched ones; shape (p,)."""
    slope = np.zeros(len(fitted.x))
    for k in range(len(slope)):
        ends = []
        for sign in (1.0, -1.0):
            x = fitted.x.copy()
            x[k] += sign * UNCERTAINTY.derivative_step
            ends.append(number(fitted.model.values(x)))
        change = ends[0] - ends[1]
        if math.isfinite(goes_round):
            change = math.remainder(change, goes_round)
        slope[k] = change / (2.0 * UNCERTAINTY.derivative_step)
    return slope


def _ends(value: float, sd: float, logarithm: bool) -> tuple[float, float]:
    if logarithm and value != 0.0:
        factor = math.exp(min(SD_OF_95 * sd / abs(value), 50.0))
        return min(value / factor, value * factor), max(value / factor, value * factor)
    return value - SD_OF_95 * sd, value + SD_OF_95 * sd


def p_value(without: HeldOut, with_it: HeldOut, tried: int = 1) -> float:
    """Of no gain: a one-sided t-test of log squared errors of parts of the same windows, with and without.

    Times the number of causes that were `tried` (Bonferroni): the best of many gains by chance. 1 where too
    few parts can be compared.
    """
    difference = _log_errors_saved(without, with_it)
    if not _comparable(difference):
        return 1.0
    return min(1.0, tried * float(ttest_1samp(difference, 0.0, alternative="greater").pvalue))


def may_be_chance(without: HeldOut, with_it: HeldOut, tried: int, most: float) -> bool:
    """Whether parts of windows held out can be compared, and their gain has a larger p-value than `most`."""
    saved = _log_errors_saved(without, with_it)
    return _comparable(saved) and p_value(without, with_it, tried) > most


def _log_errors_saved(without: HeldOut, with_it: HeldOut) -> Array:
    """By parts of the windows, of rows that count in both; shape (parts,)."""
    parts = max(1, math.ceil(UNCERTAINTY.fewest_segments / len(without.cut.windows)))
    counts = without.scored & without.sure & with_it.scored & with_it.sure
    return _block_logs(without, counts, parts) - _block_logs(with_it, counts, parts)


def _comparable(saved: Array) -> bool:
    return len(saved) >= UNCERTAINTY.fewest_compared and float(np.ptp(saved)) > 0.0


def _block_logs(held: HeldOut, counts: Mask, parts: int) -> Array:
    square = np.where(counts, held.error, 0.0) ** 2
    out = []
    for p, least in zip(held.cut.slices, least_square(held.cut), strict=True):
        rows = np.array_split(np.flatnonzero(counts[p]), parts)
        out += [float(np.mean(square[p][each])) + least for each in rows if len(each)]
    return np.asarray(np.log(out))
