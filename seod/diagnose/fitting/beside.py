"""Numbers of a set beside what is no part of the model: a slow offset, and when commands were given.

How large each may be is known beforehand: its columns are scaled so that its numbers have deviation 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.command_lead import lead_column, led, possible
from seod.diagnose.fitting.least_squares import LeastSquares, fit
from seod.diagnose.fitting.slow_offset import half_waves
from seod.diagnose.record.command_timing import Timing, looks
from seod.diagnose.tuning.fitting import SLOW_OFFSET
from seod.diagnose.tuning.record import COMMAND_TIMING
from seod.identify.spread import correlation_time

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.normal_equations import Normal
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def linear(fitted: Fitted) -> tuple[Normal, Array]:
    """Normal equations with what is beside the model, and what is left without that, shape (n,)."""
    search = _search(fitted, map)
    beside = _side_by_side(half_waves(fitted.cut), lead_column(fitted))
    parts, residual = _derived(search, fitted, beside)
    if beside is None:
        return parts, residual
    return parts, residual - parts.along(*_stepped(parts, search, fitted.x))


def correlated_rows(fitted: Fitted, left: Array) -> float:
    """Of how many rows what is left, shape (n,), counts as one."""
    parts = zip(fitted.cut.slices, fitted.error, strict=True)
    return float(correlation_time(np.concatenate([left[rows] / math.sqrt(e + 1e-300) for rows, e in parts])))


def beside_lead(fitted: Fitted, parallel: ParallelMap, ended: Callable[[], bool]) -> Fitted:
    """The same set with commands when they were given, where nobody tells, and numbers fitted with these."""
    for number in range(COMMAND_TIMING.rounds):
        lead, least = _lead(fitted, parallel), COMMAND_TIMING.nearly if number else COMMAND_TIMING.least
        if abs(lead) * COMMAND_TIMING.unsure < least:
            break
        trials = [
            fit(fitted.model, each, fitted.x, fitted.start, COMMAND_TIMING.fit_steps, parallel, ended=ended)
            for each in _held_or_running_on(led(fitted.cut, lead))
        ]
        best = min(trials, key=lambda one: one.cost)
        if not best.cost < fitted.cost:
            break
        fitted = best
    return fitted


def _held_or_running_on(cut: Cut) -> list[Cut]:
    """Windows as they are, and with commands that run on at the same times on average."""
    if any(one.runs_on for one in cut.series):
        return [cut]
    running = [Timing(one.lead - COMMAND_TIMING.middle * looks(one.u)).of(one) for one in cut.series]
    return [cut, replace(cut, series=running)] if all(one.runs_on for one in running) else [cut]


def promised_by_lead(fitted: Fitted, parallel: ParallelMap) -> float:
    """What other times of commands may save of the mean log squared error, to first order.

    0 where these are told.
    """
    if not fitted.cut.untimed:
        return 0.0
    parts, _ = _beside_a_lead(_search(fitted, parallel), fitted)
    rows = float(np.count_nonzero(fitted.cut.good))
    return -math.log1p(-min(parts.promise() / rows, COMMAND_TIMING.most_promised))


def _lead(fitted: Fitted, parallel: ParallelMap) -> float:
    """By how many deviations earlier commands were given than they are simulated; 0 where that is told."""
    if not fitted.cut.untimed:
        return 0.0
    search = _search(fitted, parallel)
    parts, wide = _beside_a_lead(search, fitted)
    step, _ = _stepped(parts, search, fitted.x)
    return float(np.clip(step[-1] / wide, *possible(fitted.cut)))


def _beside_a_lead(search: LeastSquares, fitted: Fitted) -> tuple[Normal, float]:
    """Normal equations with a lead, and over what its deviation is in them: of so many rows one counts."""
    column = lead_column(fitted)
    left, error = search.tried(fitted.x, fitted.start)
    wide = math.sqrt(max(1.0, correlated_rows(fitted, left)))
    beside = None if column is None else column / wide
    return search.derivatives(fitted.x, fitted.start, left, error, beside), wide


def part_beside_slow_offset(fitted: Fitted, without: Fitted, parallel: ParallelMap) -> float:
    """Of the log squared error that an effect saves, the part saved beside an offset that moves slowly.

    To first order. In both sets the sensor's offset is no larger than what is left without the effect: so
    little is in noise, and a cause leaves more without it. 1 where the effect saves nothing.
    """
    both = fitted, without
    searches = [_search(one, parallel) for one in both]
    tried = [search.tried(one.x, one.start) for search, one in zip(searches, both, strict=True)]
    squared = [
        float(np.sum(left[search.good] ** 2)) for search, (left, _) in zip(searches, tried, strict=True)
    ]
    if not 0.0 < squared[0] < squared[1]:
        return 1.0
    wide = math.sqrt(squared[1] / np.count_nonzero(searches[1].good))
    beside = [
        _squared_beside_slow_offset(*each, wide) for each in zip(searches, both, tried, squared, strict=True)
    ]
    return math.log(beside[1] / beside[0]) / math.log(squared[1] / squared[0])


def _squared_beside_slow_offset(
    search: LeastSquares, fitted: Fitted, tried: tuple[Array, Array], squared: float, wide: float
) -> float:
    """Squared error beside an offset that moves slowly, whose half-waves have such a deviation.

    A step that ends at its limits may err more than none, `squared`: then none is taken.
    """
    residual, error = tried
    slowly = half_waves(replace(fitted.cut, slow=wide), first=1)
    parts = search.derivatives(fitted.x, fitted.start, residual, error, slowly)
    left = (residual - parts.along(*_stepped(parts, search, fitted.x, SLOW_OFFSET.largest)))[search.good]
    return min(float(left @ left), squared) + 1e-300


def beside_slow_offset(fitted: Fitted, parallel: ParallelMap) -> Fitted:
    """The same set with the numbers that it has beside an offset that moves slowly.

    One step: the offset is in the noise, so that it changes them by little. Where the simulation does not
    follow it in proportion they stay as they are.
    """
    beside = half_waves(fitted.cut)
    if beside is None:
        return fitted
    search = _search(fitted, parallel)
    parts, residual = _derived(search, fitted, beside)
    step, states = _stepped(parts, search, fitted.x)
    step[len(fitted.x) :] = 0.0  # the offset itself is no part of the model
    x = fitted.x + step[: len(fitted.x)]
    start, moved, new = search.moved(x, fitted.start, states, 1.0)
    astray = np.where(search.good, moved - residual + parts.along(step, states), 0.0)
    if float(astray @ astray) > SLOW_OFFSET.astray * float(residual[search.good] @ residual[search.good]):
        return fitted
    return replace(fitted, x=x, start=start, error=new)


def _search(fitted: Fitted, parallel: ParallelMap) -> LeastSquares:
    return LeastSquares(fitted.model, fitted.cut, parallel, np.ones(len(fitted.x), np.bool_))


def _derived(search: LeastSquares, fitted: Fitted, beside: Array | None) -> tuple[Normal, Array]:
    """Normal equations where a set is, with what is beside it, and its residual."""
    residual, error = search.tried(fitted.x, fitted.start)
    return search.derivatives(fitted.x, fitted.start, residual, error, beside), residual


def _side_by_side(*columns: Array | None) -> Array | None:
    told = [each for each in columns if each is not None]
    return np.hstack(told) if told else None


def _stepped(parts: Normal, search: LeastSquares, x: Array, most: float = math.inf) -> tuple[Array, Array]:
    """The step to the least squares of what is searched and of what is beside it, and initial states'.

    What is beside it goes no further than so many of its deviations, `most`.
    """
    free = np.full(parts.unknowns - len(x), most)
    low, high = np.maximum(search.low - x, -search.reach), np.minimum(search.high - x, search.reach)
    return parts.step(0.0, np.r_[low, -free], np.r_[high, free])
