"""The measurement's noise, as the residual of a fit shows it: outliers, and colour as an autoregression."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array

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
        good: Which samples count, shape (n,).
        memory: Coefficients of the autoregression, shape (order,); empty for white noise.
    """

    good: Array
    memory: Array

    def whiten(self, x: Array) -> Array:
        """`x`, shape (n,) or (n, m), in rows of equal and independent noise; fewer rows than n."""
        x = x[self.good]
        order = len(self.memory)
        if order == 0:
            return x
        return np.asarray(lfilter(np.concatenate(([1.0], -self.memory)), [1.0], x, axis=0))[order:]


def white(count: int) -> Noise:
    """Nothing is known to the contrary."""
    return Noise(np.ones(count, bool), np.empty(0))


def seen_in(residual: Array) -> Noise:
    """The noise of a residual of shape (n,): its outliers, and its colour where that is more than chance."""
    good = ~outliers(residual)
    return Noise(good, memory(residual[good]))


def outliers(residual: Array) -> Array:
    """Samples that are far off, shape (n,); none where there are too many of them."""
    deviation = np.abs(residual - np.median(residual))
    far = deviation > FAR * 1.4826 * max(float(np.median(deviation)), 1e-300)
    return far if np.mean(far) <= MOST_OUTLIERS else np.zeros(len(residual), bool)


def memory(residual: Array) -> Array:
    """Autoregression of the order that Schwarz's criterion chooses; empty for white noise."""
    n = len(residual)
    if n < 10 * LONGEST_MEMORY:
        return np.empty(0)
    covariance = np.array([residual[k:] @ residual[: n - k] for k in range(LONGEST_MEMORY + 1)]) / n
    if covariance[0] <= 0.0:
        return np.empty(0)
    best, chosen = n * math.log(covariance[0]), np.empty(0)
    for order in range(1, LONGEST_MEMORY + 1):
        coefficients = np.asarray(solve_toeplitz(covariance[:order], covariance[1 : order + 1]))
        left = covariance[0] - float(coefficients @ covariance[1 : order + 1])
        cost = n * math.log(max(left, 1e-300)) + order * math.log(n)
        if cost < best:
            best, chosen = cost, coefficients
    return chosen
