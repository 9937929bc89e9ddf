"""The step of a coarse sensor, from how its readings gather around multiples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.tuning.record import STEP

if TYPE_CHECKING:
    from seod.diagnose.result import Array


class Counts(NamedTuple):
    """A sensor's step [unit of y], 0 where none is seen, and its standard deviation."""

    step: float = 0.0
    sd: float = 0.0


def counts(y: Array, noise: float) -> Counts:
    """The step of readings `y`, shape (n,), finite; `noise` is the deviation from sample to sample."""
    levels = np.unique(y)
    if len(levels) < STEP.fewest_levels:
        return Counts()
    exact = _whole_counts(levels, len(y))
    if exact.step > 0.0:
        return exact if exact.step > STEP.exact_above * noise else Counts()
    return _gathered(y, noise)


def _whole_counts(levels: Array, n: int) -> Counts:
    """The distance of which all distances of levels are multiples; 0 where there is none.

    Readings without a step seldom repeat: then there are nearly as many levels as readings. Levels that a
    converter has rounded lie off their multiples, neighbours alike: all together tell the step as one would.
    """
    if len(levels) > STEP.few_levels * n:
        return Counts()
    distances = np.diff(levels)
    apart = distances > STEP.same_level * float(np.ptp(levels))
    step = float(np.min(distances[apart], initial=math.inf))
    if not math.isfinite(step):
        return Counts()
    numbers = distances / step
    if float(np.max(np.abs(numbers - np.round(numbers)))) > STEP.off_multiple:
        return Counts()
    number = np.concatenate([[0.0], np.cumsum(np.round(numbers))])
    line = np.polynomial.Polynomial.fit(number, levels, 1)
    step, off = float(line.convert().coef[1]), float(np.std(levels - line(number)))
    least = STEP.exact * step / len(levels)
    return Counts(step, max(least, off / float(np.std(number))))


def _gathered(y: Array, noise: float) -> Counts:
    """By the circular mean |mean exp(2 pi i y / step)| over all steps between noise and range."""
    span = float(np.ptp(y))
    cells = np.minimum(
        ((y - np.min(y)) * (STEP.histogram_bins / span)).astype(np.int64), STEP.histogram_bins - 1
    )
    histogram = np.bincount(cells, minlength=STEP.histogram_bins) / len(y)
    pad = STEP.pad
    means = np.abs(np.fft.rfft(histogram, pad * STEP.histogram_bins))
    most = STEP.finest_part * STEP.histogram_bins
    finest = int(min(pad * span / max(STEP.within_noise * noise, 1e-300), most))
    coarsest = STEP.fewest_steps * pad
    if finest <= coarsest:
        return Counts()
    k = coarsest + int(np.argmax(means[coarsest:finest]))
    if means[k] < STEP.gathered or means[k] - _background(means, k, pad) < STEP.contrast:
        return Counts()
    return _refined(y, pad * span / k, noise)


def _background(means: Array, k: int, pad: int) -> float:
    """Median of what steps of nearly the same size have."""
    reach = STEP.near_steps * pad
    near = np.abs(np.arange(k - reach, k + reach + 1) - k) > STEP.own_steps * pad
    return float(np.median(means[k - reach : k + reach + 1][near]))


def _refined(y: Array, step: float, noise: float) -> Counts:
    """Least squares of the readings to whole counts, from a step that is nearly right.

    None where readings lie further from them than their noise, or go on alike from row to row: then a
    movement gathers there, as a steep ripple's does once a wave, and one of a single speed at each row.
    """
    order = np.arange(3)
    about = y - np.mean(y)
    for _ in range(STEP.rounds):
        turn = np.angle(np.mean(np.exp(2j * math.pi * about / step)))
        number = np.round(about / step - turn / (2.0 * math.pi))
        slope, offset = np.polyfit(number, about, 1)
        step = float(slope)
    left = about - slope * number - offset
    alike = np.bincount(np.abs(np.diff(number)).astype(np.int64), minlength=2)[1:]
    if float(np.std(left)) > STEP.most_scatter * noise or float(np.max(alike)) > STEP.one_speed * len(y):
        return Counts()
    spread = float(np.std(left)) / max(float(np.std(number)) * math.sqrt(len(y) - len(order)), 1e-300)
    return Counts(step, spread)
