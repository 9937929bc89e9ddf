"""Commands that repeat: what repeats with them is an answer, not a disturbance from outside."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from seod.diagnose.answer import Array
    from seod.diagnose.windows import Cut, Series

ALIKE: Final = 0.9
"""Correlation of the command with itself a period later."""
HARMONICS: Final = 6
"""Of the command, with which a disturbance can be in step; above it is hardly an answer."""
SHORTEST_S: Final = 1.0
"""Periods searched for: a faster limit cycle wanders, and does not look like a slow disturbance."""
IRREGULAR: Final = 0.05
MOSTLY: Final = 0.9
"""How far a relay's periods are from their median, most of them, where it has a frequency."""
REGULAR_CYCLES: Final = 10
_GRID: Final = 1 << 14


def in_step(cut: Cut, omega: float) -> bool:
    """Whether `omega` [rad/s] is a harmonic of a command, as far as its recording can tell."""
    return any(_in_step(one, omega) for one in cut.series)


def _in_step(one: Series, omega: float) -> bool:
    period, lowest = relay_period_s(one.t, one.u), 1.5  # it may have locked to a disturbance of its frequency
    if period is None:
        period, lowest = command_period_s(one.t, one.u), 0.5
    if period is None:
        return False
    order = omega * period / (2.0 * math.pi)
    if not lowest < order < HARMONICS + 0.5:
        return False
    return abs(order - round(order)) < min(period / float(one.t[-1] - one.t[0]), 0.5)


def relay_period_s(t: Array, u: Array) -> float | None:
    """Mean period of a command of two values that switches regularly [s], None of any other."""
    low, high = float(np.min(u)), float(np.max(u))
    if not np.all((u == low) | (u == high)):
        return None
    rises = t[1:][np.diff(u) > 0.0]
    periods = np.diff(rises)
    if len(periods) < REGULAR_CYCLES:
        return None
    regular = periods[np.abs(periods / np.median(periods) - 1.0) < IRREGULAR]
    return float(np.mean(regular)) if len(regular) > MOSTLY * len(periods) else None


def command_period_s(t: Array, u: Array) -> float | None:
    """Period of a command that repeats itself at least three times [s], None if it does not."""
    even = np.linspace(t[0], t[-1], _GRID)
    x = np.interp(even, t, u)
    x = x - np.mean(x)
    power = np.abs(np.fft.rfft(x, 2 * _GRID)) ** 2
    alike = np.fft.irfft(power)[:_GRID] / np.arange(_GRID, 0, -1) / max(float(np.var(x)), 1e-300)
    tick = float(even[1] - even[0])
    below = np.flatnonzero(alike < 0.5)
    if not len(below):
        return None
    first = max(int(below[0]), math.ceil(SHORTEST_S / tick))
    last = int(_GRID / 3)
    if first >= last:
        return None
    near = first + np.flatnonzero(alike[first:last] > max(ALIKE, 0.97 * float(np.max(alike[first:last]))))
    if not len(near):
        return None
    best = near[0] + int(np.argmax(alike[near[0] : near[0] + near[0] // 4 + 1]))
    return float(best * tick)
