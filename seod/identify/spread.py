"""How far the answer may be off: the covariance of the unknowns, by what is left of the recordings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array
    from seod.identify.problem import Problem

WHITE: Final = 2.0
"""Correlation time in samples up to which a residual looks like noise."""
_BATCHES: Final = 30
"""Pieces of a recording whose scatter tells how the residual is correlated, at least."""


def covariance(problem: Problem, answer: Any) -> tuple[Array, list[float]]:
    """Of the searched unknowns, and each residual's correlation time in samples.

    A correlated residual, as a wrong model leaves it, counts by batches: the scatter of the gradient's sums
    over pieces much longer than its correlation (a sandwich of batch means).
    """
    jacobian, residual = answer.jac, answer.fun
    count, unknowns = jacobian.shape
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    variance = float(residual @ residual) / max(count - unknowns - 4 * len(problem.records), 1)
    plain = variance * inverse
    spread, times, at = np.zeros((unknowns, unknowns)), [], 0
    for record in problem.records:
        piece = slice(at, at + len(record.y))
        at += len(record.y)
        times.append(correlation_time(residual[piece]))
        length = max(1, min(int(5.0 * times[-1]), len(record.y) // _BATCHES))
        starts = np.arange(0, len(record.y), length)
        sums = np.add.reduceat(scaled[piece] * residual[piece, None], starts, axis=0)
        spread += sums.T @ sums
    wide = plain if max(times) < WHITE else inverse @ spread @ inverse
    grown = np.sqrt(np.maximum(1.0, wide.diagonal() / np.maximum(plain.diagonal(), 1e-300)))
    out = plain * np.outer(grown, grown) if (grown > 1.0).any() else plain
    return out / np.outer(size, size), times


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
