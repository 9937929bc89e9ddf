"""Noise that remembers: what an autoregression of it foretells, and which rows have all of their past."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array, Mask


def unforeseen(x: Array, memory: Sequence[float]) -> Array:
    """Rows of `x`, shape (n, ...), less what noise with this memory (newest first) makes of those before."""
    return np.asarray(lfilter(np.r_[1.0, -np.asarray(memory)], [1.0], x, axis=0)) if len(memory) else x


def has_past(counts: Mask, order: int) -> Mask:
    """Rows that count, and so many before each; shape (n,)."""
    missing = np.convolve(~counts, np.ones(order + 1))[: len(counts)]
    missing[:order] = 1.0
    return np.asarray(missing < 0.5)
