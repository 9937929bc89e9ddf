"""Whether a fit's residual is noise, or repeats with the limit cycle as only a wrong model's error does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

HARMONICS: Final = 8
"""Of the limit cycle, that are looked at; fewer where a half cycle has few samples."""
_TAKEN: Final = 2.0
"""Degrees of freedom at the harmonics that the fit took from its residual: omega_n and zeta."""


class Misfit(NamedTuple):
    """What repeats from cycle to cycle in a residual.

    Attributes:
        ratio: Power at the limit cycle's harmonics to that between them, for each degree of freedom; 1 for
            noise of any smooth spectrum.
        excess: The same power to that of the whole residual: the square of what widens deviations.
        chance: Roughly how probable so high a ratio is for noise.
        size: Effective value of what repeats beyond noise [unit].
    """

    ratio: float
    excess: float
    chance: float
    size: float


NOTHING: Final = Misfit(1.0, 1.0, 1.0, 0.0)


def misfit(t: Array, residual: Array, period: float) -> Misfit:
    """Compare the residual's power at the harmonics of a period with that between them.

    Args:
        t: Sample times [s], rising, shape (n,).
        residual: Shape (n,).
        period: Of the limit cycle [s].

    Returns:
        What repeats; `NOTHING` where the samples last for less than two periods.
    """
    cycles = int((t[-1] - t[0]) / period + 1e-6) if len(t) and period > 0.0 else 0
    if cycles < 2:
        return NOTHING
    inside = t > t[-1] - cycles * period
    count = int(np.count_nonzero(inside))
    harmonics = min(HARMONICS, count // (4 * cycles))
    if harmonics < 3:
        return NOTHING
    power = _power(t[inside], residual[inside], cycles * period, harmonics * cycles + cycles // 2)
    bins = np.arange(1, len(power) + 1)
    near, at = bins > cycles // 2, bins % cycles == 0
    between = float(np.mean(power[near & ~at]))
    return _judged(float(np.sum(power[at])), between, (harmonics, int(np.sum(near & ~at))), count)


def _power(t: Array, residual: Array, span: float, highest: int) -> Array:
    """|sum of residual e^(-j b 2 pi t / span)|^2 for the bins b from 1 to the highest."""
    turn = np.exp(-2j * math.pi / span * (t - t[0]))
    turns = np.multiply.accumulate(np.broadcast_to(turn, (highest, len(turn))), axis=0)
    return np.asarray(np.abs(turns @ residual) ** 2)


def _judged(at: float, between: float, bins: tuple[int, int], count: int) -> Misfit:
    """Power `at` all harmonics and the mean `between` them, of so many bins each, from `count` samples."""
    freedom, others = max(2.0 * bins[0] - _TAKEN, 1.0), 2.0 * bins[1]
    expected = 0.5 * freedom * between
    ratio = at / max(expected, 1e-300)
    size = math.sqrt(2.0 * max(at - expected, 0.0)) / count
    level = (2.0 * at + others * between) / (freedom + others)
    return Misfit(ratio, 2.0 * at / (freedom * max(level, 1e-300)), _chance(ratio, freedom, others), size)


def _chance(ratio: float, freedom: float, others: float) -> float:
    """How often Fisher's F is above `ratio`, by Wilson and Hilferty's cube root, which is nearly normal."""
    a, b, root = 2.0 / (9.0 * freedom), 2.0 / (9.0 * others), math.cbrt(ratio)
    z = (root * (1.0 - b) - (1.0 - a)) / math.sqrt(b * root * root + a)
    return 0.5 * math.erfc(z / math.sqrt(2.0))
