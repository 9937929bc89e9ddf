"""Whether commands depend on what was not foretold of the readings before: whether a loop is closed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from seod.diagnose.tuning.account import PREDICTION, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array


def is_closed(commands: Sequence[Array], errors: Sequence[Array]) -> bool:
    """Whether the commands of windows answer to errors that are white, each shape (n,).

    Commands made white, too, the sum of their products at each lag has a known deviation where they do not
    (Caines and Chan, IEEE Trans. Automatic Control 20, 1975).
    """
    u = np.concatenate(commands)
    past = np.concatenate([_shifted(each, PREDICTION.command_order) for each in commands])
    white = u - past @ np.linalg.lstsq(past, u, rcond=1e-10)[0]
    own = np.split(white, np.cumsum([len(each) for each in commands])[:-1])
    pairs = [(c, e) for c, e in zip(own, errors, strict=True) if len(e) > PREDICTION.lags]
    scores = [sum(float(c[lag:] @ e[: len(e) - lag]) for c, e in pairs) for lag in range(PREDICTION.lags)]
    size = math.sqrt(float(np.mean(white**2) * np.mean(np.concatenate(errors) ** 2)) * len(u))
    limit = norm.isf(0.5 * SYSTEMATIC.chance / PREDICTION.lags)
    return bool(np.max(np.abs(scores)) > limit * size)


def _shifted(u: Array, order: int) -> Array:
    """Commands before each, and 1; shape (n, order + 1)."""
    before = [np.r_[np.full(min(k, len(u)), u[0]), u[: max(len(u) - k, 0)]] for k in range(1, order + 1)]
    return np.column_stack([*before, np.ones_like(u)])
