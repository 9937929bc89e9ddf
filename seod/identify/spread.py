"""How far the answer may be off: the covariance of the unknowns, by what is left of the recordings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.fft import next_fast_len

from seod.estimate.noise import Noise, memory

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.identify.problem import Problem

WHITE: Final = 2.0
"""Correlation time in samples up to which a residual looks like noise."""
_BATCHES: Final = 30
"""Pieces of a recording whose scatter tells how the residual is correlated, at least."""


def covariance(problem: Problem, answer: Any) -> tuple[Array, list[float]]:
    """Of the searched unknowns, and each residual's correlation time in samples.

    A correlated residual counts by the spectrum of its autoregression, and by batches where these tell more,
    as with what a wrong model leaves.
    """
    jacobian, residual = answer.jac, answer.fun
    count, unknowns = jacobian.shape
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    variance = float(residual @ residual) / max(count - unknowns - 4 * len(problem.records), 1)
    plain = variance * inverse
    batched, coloured = np.zeros((2, unknowns, unknowns))
    times, at = [], 0
    for record in problem.records:
        piece = slice(at, at + len(record.y))
        at += len(record.y)
        times.append(correlation_time(residual[piece]))
        batched += _by_batches(scaled[piece], residual[piece], times[-1])
        coloured += _by_spectrum(scaled[piece], residual[piece])
    ways = (
        [plain] if max(times) < WHITE else [plain, inverse @ batched @ inverse, inverse @ coloured @ inverse]
    )
    widest = np.max([way.diagonal() for way in ways], axis=0)
    grown = np.sqrt(np.maximum(1.0, widest / np.maximum(plain.diagonal(), 1e-300)))
    return plain * np.outer(grown / size, grown / size), times


def _by_batches(slopes: Array, residual: Array, time: float) -> Array:
    """Scatter of the gradient's sums over pieces longer than the correlation, shape (unknowns, unknowns)."""
    length = max(1, min(int(5.0 * time), len(residual) // _BATCHES))
    sums = np.add.reduceat(slopes * residual[:, None], np.arange(0, len(residual), length), axis=0)
    return np.asarray(sums.T @ sums)


def _by_spectrum(slopes: Array, residual: Array) -> Array:
    """Variance of the gradient where the residual is an autoregression's, by its spectrum; as above."""
    factors = memory(residual)
    size = next_fast_len(2 * len(residual), real=True)
    power = innovation(residual) / np.abs(np.fft.rfft([1.0, *(-f for f in factors)], size)) ** 2
    power[1 : (size + 1) // 2] *= 2.0  # the spectrum's other half
    waves = np.fft.rfft(slopes, size, axis=0)
    return np.asarray((waves.conj().T * power @ waves).real / size)


def innovation(residual: Array) -> float:
    """Variance of what an autoregression of the residual does not foretell."""
    rest = Noise(memory(residual)).whiten(residual)
    return max(float(rest @ rest) / len(rest), 1e-300)


def correlation_time(residual: Array) -> float:
    """Sum of the autocorrelation up to where it first vanishes [samples]; about 1 for white noise."""
    n = len(residual)
    power = float(residual @ residual)
    if power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(residual, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: n // 2] / power
    below = np.flatnonzero(correlation < 2.0 / math.sqrt(n))
    end = int(below[0]) if len(below) else len(correlation)
    return float(1.0 + 2.0 * np.sum(correlation[1:end]))
