"""K_L in force: a number, a function of the supply pressure (Eq. 9), or a guess until it is identified."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.config.gain import GainModel


def is_identified(config: float | GainModel) -> bool:
    """Whether K_L is to be found by the excitation itself."""
    return not isinstance(config, float | int) and config.identified is not None


def needs_pressure(config: float | GainModel) -> bool:
    """Whether K_L follows the supply pressure."""
    return not isinstance(config, float | int) and config.identified is None


def gain_of(config: float | GainModel) -> Callable[[float], float]:
    """K_L [axis unit/s/V] as a function of supply pressure [Pa]; nan in, nan out, but for a number."""
    if isinstance(config, float | int):
        return lambda _ps: config
    if (guess := config.identified) is not None:
        return lambda _ps: guess
    if config.table is not None:
        ps, K_L = config.table.ps, config.table.K_L
        return lambda p: interpolated(ps, K_L, p)
    coefficients, (low, high) = config.polynomial or (), config.range or (0.0, 0.0)
    return lambda p: p if math.isnan(p) else polynomial(coefficients, min(max(p, low), high))


def gain_range(config: float | GainModel) -> tuple[float, float]:
    """Smallest and largest K_L [axis unit/s/V] that it can give (a polynomial's seen at 101 pressures)."""
    if isinstance(config, float | int):
        return config, config
    if config.identified is not None:
        return config.identified, config.identified
    if config.table is not None:
        return min(config.table.K_L), max(config.table.K_L)
    gain, (low, high) = gain_of(config), config.range or (0.0, 0.0)
    values = [gain(low + (high - low) * k / 100) for k in range(101)]
    return min(values), max(values)


def interpolated(xs: Sequence[float], ys: Sequence[float], x: float) -> float:
    """Value at `x` on the line through the points (xs ascending), clamped to its ends; nan for nan."""
    if math.isnan(x):
        return x
    if x <= xs[0] or x >= xs[-1]:
        return ys[0] if x <= xs[0] else ys[-1]
    k = bisect_right(xs, x)
    share = (x - xs[k - 1]) / (xs[k] - xs[k - 1])
    return ys[k - 1] + share * (ys[k] - ys[k - 1])


def polynomial(coefficients: Sequence[float], x: float) -> float:
    """c0 + c1 x + c2 x^2 + ..., by Horner's rule."""
    value = 0.0
    for c in reversed(coefficients):
        value = value * x + c
    return value
