"""Readings of a coarse sensor: within half a step an error says nothing, beyond it all the more.

A reading stands for an interval. How far outside it a simulation lies counts, not how far from its middle:
rounding is no white noise, and hides much less than its deviation of step / sqrt(12).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.tuning.record import COARSE

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask

_CHANGES: Final = 2.0 / math.sqrt(math.pi)
"""Changes of a reading by noise, of samples that pass steps slowly, for each: times noise over step."""
_SQUARE_BEYOND: Final = 2.0 * math.sqrt(2.0 / math.pi) / 3.0
"""Mean square beyond the interval, over deviation^3 / step: both ends, positions within the step alike."""


class Readings(NamedTuple):
    """What a coarse sensor's samples say.

    Attributes:
        y: Middles of the intervals, shape (n,).
        slack: Half their width; 0 where rounding is as good as white noise.
        level: What noise leaves beyond, root mean square, as little as may be.
        allowed: As much as may be.
        noise: Standard deviation about the middle, rounding included.
    """

    y: Array
    slack: float
    level: float
    allowed: float
    noise: float


def readings(y: Array, good: Mask, step: float, noise: float, *, held: bool = False) -> Readings:
    """Samples `y`, shape (n,), of a sensor with this step; `noise` is the deviation from sample to sample.

    Where that is as large as rounding's, rounding is white noise: so it is of a movement that passes steps
    from row to row, whose counts do not show how large the noise is. Nor do those of a sensor that repeats
    its readings (`held`) and passes steps between them.
    """
    rounding = step / math.sqrt(12.0)
    turn = float(np.angle(np.mean(np.exp(2j * math.pi * y[good] / step)))) / (2.0 * math.pi)
    number = np.round(y / step - turn)
    passes = held and float(np.mean(np.abs(np.diff(number[good])))) > COARSE.passed_between
    beneath = noise_beneath(number[good])
    if passes or noise > COARSE.as_rounding * rounding or beneath > COARSE.white_above:
        least = max(noise, rounding)
        return Readings(y, 0.0, least, least, least)
    level, allowed = (
        step * math.sqrt(_SQUARE_BEYOND * max(COARSE.noise_margin * beneath, sd) ** 3)
        for sd in (COARSE.least_noise, COARSE.most_noise)
    )
    middle = np.where(good, (number + turn) * step, y)
    return Readings(middle, 0.5 * step, level, allowed, rounding)


def noise_beneath(number: Array) -> float:
    """Noise before rounding over the step, by changes to and fro of the counts `number`, shape (n,)."""
    rows = np.flatnonzero(np.diff(number))
    if len(rows) < 2:
        return 0.0
    change, apart = np.diff(number)[rows], np.diff(rows)
    back = change[1:] * change[:-1] < 0.0
    passes = max(len(rows) - int(np.count_nonzero(back)), 1)
    near = apart < max(COARSE.there_and_back * len(number) / passes, COARSE.there_and_back_rows)
    return float(np.count_nonzero(back & near)) / (_CHANGES * len(number))


def beyond(error: Array, slack: Array) -> Array:
    """Errors as far as they lie outside the interval of a reading; all of shape (n,)."""
    return np.asarray(np.sign(error) * np.maximum(np.abs(error) - slack, 0.0))
