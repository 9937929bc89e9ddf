"""Commands that sweep: their frequency or their size goes one way with time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import spearmanr

if TYPE_CHECKING:
    from seod.diagnose.result import Array

PARTS: Final = 8
"""Of a recording, that are compared."""
ALIKE: Final = 0.9
"""Rank correlation with time from which on a command sweeps: of 8 parts by chance one in 300."""
AT_REST: Final = 0.1
RESTS: Final = 2
"""Part of the largest size up to which the command rests, and so many parts may: before and after."""
CHANGES: Final = 2.0
"""Largest frequency or size over the least, at least."""


def sweeps(t: Array, u: Array) -> bool:
    """Whether the frequency or the rms of a command, shape (n,), rises or falls with the time `t` [s]."""
    parts = [rows for rows in np.array_split(np.arange(len(u)), PARTS) if len(rows) > 1]
    sizes = np.array([float(np.std(u[rows])) for rows in parts])
    driven = np.flatnonzero(sizes > AT_REST * np.max(sizes))
    if len(driven) < PARTS - RESTS:
        return False
    rates = [_rms(np.diff(u[parts[k]])) / float(np.median(np.diff(t[parts[k]]))) for k in driven]
    return _one_way(sizes[driven]) or _one_way(np.array(rates) / sizes[driven])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _one_way(values: Array) -> bool:
    if not np.min(values) > 0.0 or np.max(values) < CHANGES * np.min(values):
        return False
    return abs(float(spearmanr(values, np.arange(len(values))).statistic)) > ALIKE
