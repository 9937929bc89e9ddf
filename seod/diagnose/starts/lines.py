"""Where the search for a wave begins: the lines that a residual has over time, or over the position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.fft import next_fast_len

from seod.diagnose.causes.table import wave_of
from seod.diagnose.tuning.starts import LINES

if TYPE_CHECKING:
    from seod.diagnose.causes.cause import Wave
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def lines(wave: Wave, cut: Cut, residual: Array, position: Array, speed: Array | None) -> list[float]:
    """Frequencies [rad/s], or wavenumbers [rad/unit], at which a residual of windows has its largest lines.

    Args:
        wave: How it repeats.
        cut: The windows.
        residual: Measured minus simulated, 0 where nothing was, shape (n,).
        position: Of the load, shape (n,).
        speed: Of the load, 0 where it is not known, where the sensor sees it: a ripple shows in proportion.
    """
    lowest = math.ceil(wave.fewest * LINES.finer)
    if wave.over == "time":
        return _over_time(cut, residual, lowest)
    return _over(position, residual, np.ones(len(residual)) if speed is None else speed, lowest)


def _over_time(cut: Cut, residual: Array, lowest: int) -> list[float]:
    tick = min(recording.tick for recording in cut.series)
    k = max({of for of, _, _ in cut.windows}, key=lambda of: len(cut.series[of].t))
    one = cut.series[k]
    grid = np.zeros(round(float(one.t[-1] - one.t[0]) / tick) + 2)
    for (of, first, last), own in zip(cut.windows, cut.slices, strict=True):
        if of == k:
            rows = np.round((one.t[first:last] - one.t[0]) / tick).astype(int)
            grid[rows] = residual[own] - np.mean(residual[own])
    return _peaks(grid, tick, lowest)


def _over(position: Array, residual: Array, shows: Array, lowest: int) -> list[float]:
    """Lines over the position of a wave that is in each sample as far as it `shows` there."""
    span = max(float(np.ptp(position)), 1e-300)
    index = np.minimum(((position - position.min()) / span * LINES.bins).astype(int), LINES.bins - 1)
    count = np.bincount(index, weights=shows**2, minlength=LINES.bins)
    total = np.bincount(index, weights=residual * shows, minlength=LINES.bins)
    mean = np.where(count > 0.0, total / np.where(count > 0.0, count, 1.0), 0.0)
    return _peaks((mean - mean.mean()) * np.sqrt(count), span / LINES.bins, lowest)


def _peaks(signal: Array, step: float, lowest: int) -> list[float]:
    """The largest lines, apart from each other by more than their width [rad per unit of `step`]."""
    size = next_fast_len(LINES.finer * len(signal), real=True)
    power = np.abs(np.fft.rfft(signal, size)) ** 2
    power[:lowest] = 0.0
    found: list[float] = []
    for _ in range(LINES.tried):
        peak = int(np.argmax(power))
        if power[peak] <= 0.0:
            break
        found.append(2.0 * math.pi * _summit(power, peak) / (size * step))
        power[max(0, peak - LINES.width * LINES.finer) : peak + LINES.width * LINES.finer] = 0.0
    return found


def _summit(power: Array, peak: int) -> float:
    """Place of the parabola's summit through three points."""
    if not 0 < peak < len(power) - 1:
        return float(peak)
    left, middle, right = (float(x) for x in np.sqrt(power[peak - 1 : peak + 2]))
    bend = left - 2.0 * middle + right
    return peak + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)


def wave_starts(name: str, numbers: list[float], size: float) -> tuple[Values, ...]:
    """Where to begin at these frequencies: with a small wave, whose parts a first step finds."""
    parts, place = {f"{name}.cosine": size, f"{name}.sine": size}, f"{name}.{wave_of(name).number}"
    return tuple(parts | {place: number} for number in numbers)
