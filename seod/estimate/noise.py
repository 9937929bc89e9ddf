"""The measurement's noise, as the residual of a fit shows it: outliers, and colour as an autoregression."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.estimate.arrays import Array

FAR = 6.0
"""Robust standard deviations beyond which a sample is none of the rest: one in 5e8 of normal noise."""
MOST_OUTLIERS = 0.1
"""Part of the samples; where more seem to be, the model is wrong and not the samples."""
LONGEST_MEMORY = 8
"""Order of the autoregression."""


@dataclass(frozen=True, slots=True)
class Noise:
    """How samples have to be combined so that white noise of equal size is left.

    Attributes:
        memory: Coefficients of the autoregression, newest first; empty for white noise.
        kept: Which of the combined samples count; None for all.
        rejected: Outliers.
    """

    memory: tuple[float, ...] = ()
    kept: NDArray[np.bool_] | None = None
    rejected: int = 0

    def whiten(self, x: Array) -> Array:
        """`x`, shape (n,) or (m, n), as rows of equal and independent noise, along the last axis."""
        order, n = len(self.memory), x.shape[-1]
        if order:
            out = x[..., order:].copy()
            for k, factor in enumerate(self.memory, 1):
                out -= factor * x[..., order - k : n - k]
            x = out
        return x if self.kept is None else np.asarray(x[..., self.kept])


WHITE = Noise()


def seen_in(residual: Array) -> Noise:
    """The noise of a residual of shape (n,): its outliers and its colour."""
    far = outliers(residual)
    count = int(np.count_nonzero(far))
    colour = memory(np.where(far, 0.0, residual) if count else residual)
    if not count:
        return Noise(colour)
    touched = np.convolve(far, np.ones(len(colour) + 1))[len(colour) : len(far)] > 0.0
    return Noise(colour, ~touched, count)


def outliers(residual: Array) -> NDArray[np.bool_]:
    """Samples that are far off, shape (n,); none where there are too many of them."""
    deviation = np.abs(residual - np.median(residual))
    far = deviation > FAR * 1.4826 * max(float(np.median(deviation)), 1e-300)
    return far if np.count_nonzero(far) <= MOST_OUTLIERS * len(far) else np.zeros(len(far), np.bool_)


def memory(residual: Array) -> tuple[float, ...]:
    """Autoregression of the order that Schwarz's criterion chooses; empty for white noise.

    By Burg's method, forwards and backwards in time: it has as much of the past count in few samples, of
    noise that hardly forgets, as in many. Gusts on the load are such noise. By the covariances of the few
    (Yule and Walker) it forgets too soon, and standard deviations come out too small (`bench/live_gusts.py`).

    Source: Kay, Modern Spectral Estimation, 1988, 7.3 and 7.5.
    """
    n, left = len(residual), float(residual @ residual) / max(len(residual), 1)
    if n < 10 * LONGEST_MEMORY or not left > 1e-300:
        return ()
    present: list[float] = []
    chosen: tuple[float, ...] = ()
    best = n * math.log(left)
    newer, older = residual[1:], residual[:-1]  # foretold by those between, and by those after them
    for order in range(1, LONGEST_MEMORY + 1):
        both = float(newer @ newer + older @ older)
        reflection = 2.0 * float(newer @ older) / max(both, 1e-300)
        present = [a - reflection * b for a, b in zip(present, reversed(present), strict=True)] + [reflection]
        left *= 1.0 - reflection * reflection
        newer, older = (newer - reflection * older)[1:], (older - reflection * newer)[:-1]
        cost = n * math.log(max(left, 1e-300)) + order * math.log(n)
        if cost < best:
            best, chosen = cost, tuple(present)
    return chosen
