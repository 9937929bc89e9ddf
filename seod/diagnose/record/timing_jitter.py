"""Samples taken at another time than they say: their error grows with the slope of the signal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.record.fourth_differences import CORRELATED, NORM, slopes
from seod.diagnose.result import SD_OF_95
from seod.diagnose.tuning.record import TIMING_JITTER

if TYPE_CHECKING:
    from seod.diagnose.record.fourth_differences import Stencils
    from seod.diagnose.result import Array


class Jitter(NamedTuple):
    """Standard deviation of the samples' times [s], 0 where none is seen; and what it was found by."""

    deviation: float = 0.0
    ci95: tuple[float, float] = (0.0, 0.0)
    p_value: float = 1.0
    level: float = 0.0
    steepness: Array | None = None

    def deviations(self, noise: float, stencils: Stencils) -> Array:
        """Of the samples in the middle of the stencils; `noise` where the time takes no part."""
        if self.steepness is None:
            return np.full(len(stencils.difference), noise)
        return np.sqrt(self.level + self.deviation**2 * self.steepness)


def timing_jitter(stencils: Stencils, t: Array, y: Array) -> Jitter:
    """Of the stencils of the samples `y` at the times `t` [s], both shape (n,).

    The mean squared fourth difference is 70 (noise^2 + deviation^2 slope^2): a line over the squared slope.
    """
    steep = _steepness(stencils, t, y)
    steepness, square = steep[stencils.usable], _squares(stencils)
    scale = float(np.mean(steepness)) if len(steepness) else 0.0
    if len(square) < TIMING_JITTER.fewest_differences or scale == 0.0:
        return Jitter()
    level, growth, sd = _line(steepness / scale, square)
    if not growth > TIMING_JITTER.significant * sd or growth < TIMING_JITTER.least_share * (level + growth):
        return Jitter()
    if not _grows(steepness / scale, square, level, growth) or not _alternates(stencils, steep):
        return Jitter()
    deviation = math.sqrt(growth / scale)
    interval = float(np.median(np.diff(t)))
    if deviation > TIMING_JITTER.most * interval:  # a noise that grows with the slope
        return Jitter()
    low, high = (math.sqrt(max(0.0, growth + side * SD_OF_95 * sd) / scale) for side in (-1.0, 1.0))
    p_value = math.erfc(min(growth / sd, 37.0) / math.sqrt(2.0))
    return Jitter(deviation, (low, high), p_value, level, steep)


def remaining_jitter(rest: Stencils, t: Array, y: Array) -> float:
    """Variance of the samples' times [s^2] by what a model leaves of the samples `y` at the times `t` [s].

    Both are of shape (n,), and `rest` are the stencils of what is left.
    """
    steepness = _steepness(rest, t, y)[rest.usable]
    scale = float(np.mean(steepness)) if len(steepness) else 0.0
    return _line(steepness / scale, _squares(rest))[1] / scale if scale > 0.0 else 0.0


def _steepness(stencils: Stencils, t: Array, y: Array) -> Array:
    """Squared slope of the samples of each stencil, as they weigh in it; shape (m,)."""
    slope = np.lib.stride_tricks.sliding_window_view(slopes(t, y) ** 2, 5)
    return np.asarray(np.sum(stencils.weights**2 * slope, axis=1) / NORM**2)


def _squares(stencils: Stencils) -> Array:
    """Squared error of a sample by each usable stencil."""
    return np.asarray(stencils.difference[stencils.usable] ** 2 / NORM**2)


def _line(x: Array, square: Array) -> tuple[float, float, float]:
    """Level, growth and the growth's deviation; each square weighs by what is expected of it."""
    level, growth, variance = float(np.median(square)) / 0.455, 0.0, math.inf
    for _ in range(TIMING_JITTER.rounds):
        if max(level, growth) == 0.0:  # readings stand still in most rows
            break
        expected = np.maximum(level + growth * x, TIMING_JITTER.least_expected * max(level, growth) + 1e-300)
        near = square < TIMING_JITTER.events * expected
        a = np.column_stack([np.ones(near.sum()), x[near]]) / expected[near, None]
        normal = np.linalg.pinv(a.T @ a)
        level, growth = (max(float(each), 0.0) for each in normal @ (a.T @ (square[near] / expected[near])))
        variance = 2.0 * float(normal[1, 1])
    return level, growth, CORRELATED * math.sqrt(variance)


def _grows(x: Array, square: Array, level: float, growth: float) -> bool:
    """The median grows as the mean does, from the flattest third to the steepest: no corners alone."""
    low, high = np.quantile(x, [1.0 / 3.0, 2.0 / 3.0])
    flat, steep = x < low, x > high
    if not flat.any() or not steep.any():
        return False
    wanted = np.median(level + growth * x[steep]) / max(float(np.median(level + growth * x[flat])), 1e-300)
    seen = np.median(square[steep]) / max(float(np.median(square[flat])), 1e-300)
    return bool(seen - 1.0 > TIMING_JITTER.median_growth * (wanted - 1.0))


def _alternates(stencils: Stencils, steepness: Array) -> bool:
    """Neighbouring differences where the signal is steep go against each other: they are samples' errors.

    White errors have a correlation of -0.8; of what a quick signal itself leaves it is nearly 1.
    """
    pairs = stencils.usable[1:] & stencils.usable[:-1] & (np.diff(stencils.middle) == 1)
    pairs &= steepness[1:] > np.quantile(steepness, 2.0 / 3.0)
    scaled = stencils.difference / np.sqrt(steepness + float(np.mean(steepness)))
    before, behind = scaled[:-1][pairs], scaled[1:][pairs]
    return bool(before @ behind < TIMING_JITTER.alternating * 0.5 * (before @ before + behind @ behind))
