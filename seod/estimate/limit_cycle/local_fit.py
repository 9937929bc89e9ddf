"""Crossings and peaks from noisy samples, by polynomials fitted around them.

A polynomial over a tenth of a period uses all samples there, so white noise averages out, missing samples and
jitter do not matter, and the highest of many noisy samples is not taken for the peak.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

_ATTEMPTS = 4
_CENTRED = 0.3
"""A result within this part of the half-width of the window's centre needs no second fit."""
_GRID = np.linspace(-1.0, 1.0, 41)
_GRID_POWERS = np.vander(_GRID, 5, increasing=True)


def crossing(t: Array, y: Array, level: float, guess: float, half_width: float) -> float | None:
    """Time at which `y` passes `level` near `guess`, by a cubic; None where it does not, or samples lack.

    Args:
        t: Times [s], ascending, shape (n,).
        y: Samples, shape (n,).
        level: Value passed.
        guess: Time near the crossing [s].
        half_width: Half the length of the fitted segment [s].
    """
    centre = guess
    for _ in range(_ATTEMPTS):
        c = _fit(t, y, centre, half_width, degree=3)
        if c is None:
            return None
        x = _root(c, level)
        if x is None:
            return None
        if abs(x) < _CENTRED:
            return centre + x * half_width
        centre += max(-1.0, min(1.0, x)) * half_width
    return None


def peak(t: Array, y: Array, sign: int, guess: float, half_width: float) -> tuple[float, float] | None:
    """Time and value of the maximum (`sign` 1) or minimum (-1) near `guess`, by a quartic; else None."""
    centre = guess
    for _ in range(_ATTEMPTS):
        c = _fit(t, y, centre, half_width, degree=4)
        if c is None:
            return None
        values = _GRID_POWERS[:, : len(c)] @ c
        best = int(np.argmax(sign * values))
        if 8 <= best <= 32:
            return centre + half_width * float(_GRID[best]), _vertex(values[best - 1 : best + 2])
        centre += half_width * float(_GRID[best])
    return None


def _fit(t: Array, y: Array, centre: float, half_width: float, degree: int) -> Array | None:
    """Ascending coefficients in (t - centre) / half_width; of lower degree where samples are few."""
    first, last = np.searchsorted(t, (centre - half_width, centre + half_width))
    x = (t[first:last] - centre) / half_width
    degree = min(degree, len(x) - 2)
    if degree < 1:
        return None
    powers = np.vander(x, degree + 1, increasing=True)
    return np.asarray(np.linalg.lstsq(powers, y[first:last], rcond=None)[0], dtype=np.float64)


def _root(c: Array, level: float) -> float | None:
    """The root next to the centre, by Newton's method."""
    c0, c1, c2, c3 = (*c.tolist(), 0.0, 0.0)[:4]
    x = 0.0
    for _ in range(8):
        slope = c1 + x * (2.0 * c2 + x * 3.0 * c3)
        if slope == 0.0:
            return None
        step = (c0 - level + x * (c1 + x * (c2 + x * c3))) / slope
        x = max(-2.0, min(2.0, x - step))
        if abs(step) < 1e-9:
            break
    return x


def _vertex(three: Array) -> float:
    """Extreme value of the parabola through three equally spaced values."""
    a, b, c = three.tolist()
    bend = a - 2.0 * b + c
    return float(b - (c - a) ** 2 / (8.0 * bend)) if bend else float(b)
