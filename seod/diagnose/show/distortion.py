"""Distortion where the input is periodic: symmetric causes make odd harmonics, the others even ones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array

_REPEATS_ALIKE: Final = 0.9
"""Autocorrelation of an input one period later, at least."""
_PERIODS: Final = 3
"""Fewest in a window."""
_HARMONICS: Final = 15


class Harmonics(NamedTuple):
    """Amplitudes by number of the harmonic, 1 first; shape (m,)."""

    number: Array
    amplitude: Array

    def share(self, first: int) -> float:
        """Rms of every second harmonic from this one on."""
        return math.sqrt(0.5 * float(np.sum(self.amplitude[first - 1 :: 2] ** 2)))


def period(u: Array) -> float | None:
    """Of an input [samples]; None where it does not repeat itself three times."""
    x = np.where(np.isfinite(u), u, 0.0)
    x = x - x.mean()
    power = float(x @ x)
    if power == 0.0:
        return None
    n = len(x)
    raw = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2)[: n // _PERIODS]
    alike = raw / power * n / (n - np.arange(len(raw)))
    below = np.flatnonzero(alike < 0.3)
    if not len(below) or below[0] == len(alike) - 1:
        return None
    return _first_peak(alike, int(below[0]))


def _first_peak(alike: Array, start: int) -> float | None:
    """The first of the peaks that are as high as the highest."""
    rest = alike[start:]
    best = float(rest.max())
    if best < _REPEATS_ALIKE:
        return None
    inner = (
        np.flatnonzero((rest[1:-1] >= rest[:-2]) & (rest[1:-1] > rest[2:]) & (rest[1:-1] > 0.97 * best)) + 1
    )
    if not len(inner):
        return None
    k = start + int(inner[0])
    before, at, after = alike[k - 1 : k + 2].tolist()
    bend = before - 2.0 * at + after
    return float(k + (0.5 * (before - after) / bend if bend < 0.0 else 0.0))


def harmonics(segments: Sequence[Array], length: float) -> Harmonics:
    """Of segments of a signal, rms over them; `length` is the period [samples]."""
    count = min(_HARMONICS, int(0.5 * length) - 1)
    squares = sum(np.abs(_lines(segment, length, count)) ** 2 for segment in segments)
    return Harmonics(np.arange(1.0, count + 1.0), np.sqrt(squares / len(segments)))


def _lines(x: Array, length: float, count: int) -> Array:
    """Complex amplitudes by least squares, with a mean and a slope."""
    rows = np.arange(len(x))
    angle = 2.0 * math.pi * rows[:, None] * np.arange(1, count + 1) / length
    columns = np.hstack([np.cos(angle), np.sin(angle), np.ones((len(x), 1)), (rows / len(x))[:, None]])
    kept = np.isfinite(x)
    found = np.linalg.lstsq(columns[kept], x[kept], rcond=None)[0]
    return np.asarray(found[:count] - 1j * found[count : 2 * count])
