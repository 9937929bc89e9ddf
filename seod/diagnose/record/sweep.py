"""Commands that sweep: their frequency or their size goes one way with time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

from seod.diagnose.tuning.record import SWEEP

if TYPE_CHECKING:
    from seod.diagnose.result import Array


def sweeps(t: Array, u: Array) -> bool:
    """Whether the frequency or the rms of a command, shape (n,), rises or falls with the time `t` [s]."""
    parts = [rows for rows in np.array_split(np.arange(len(u)), SWEEP.parts) if len(rows) > 1]
    sizes = np.array([float(np.std(u[rows])) for rows in parts])
    driven = np.flatnonzero(sizes > SWEEP.at_rest * np.max(sizes))
    if len(driven) < SWEEP.parts - SWEEP.rests:
        return False
    rates = [_rms(np.diff(u[parts[k]])) / float(np.median(np.diff(t[parts[k]]))) for k in driven]
    return _one_way(sizes[driven]) or _one_way(np.array(rates) / sizes[driven])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _one_way(values: Array) -> bool:
    if not np.min(values) > 0.0 or np.max(values) < SWEEP.changes * np.min(values):
        return False
    return abs(float(spearmanr(values, np.arange(len(values))).statistic)) > SWEEP.alike
