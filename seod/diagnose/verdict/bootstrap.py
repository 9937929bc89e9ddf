"""How sure an NRMSE is: by drawing blocks of the held-out windows again and again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.verdict import BOOTSTRAP
from seod.diagnose.verdict.figures import scored_windows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array, Diagnosis, Window


def interval(
    windows: Sequence[Window], errors: Sequence[Array], seed: int = BOOTSTRAP.seed
) -> tuple[float, float]:
    """95 % interval of the NRMSE over the windows' scored samples, by a block bootstrap (Kuensch 1989).

    Args:
        windows: Held-out windows.
        errors: Measured less simulated in each.
        seed: Of the draws.
    """
    parts = -(-BOOTSTRAP.fewest_blocks // len(windows))
    sums = np.concatenate([_blocks(w, e, parts) for w, e in zip(windows, errors, strict=True)])
    draws = np.random.default_rng(seed).integers(0, len(sums), (BOOTSTRAP.draws, len(sums)))
    drawn = sums[draws].sum(axis=1)
    errors_drawn = np.sqrt(drawn[:, 0] / np.maximum(drawn[:, 1], 1e-300))
    low, high = np.quantile(errors_drawn, BOOTSTRAP.quantiles).tolist()
    return low, high


def with_intervals(d: Diagnosis) -> Diagnosis:
    """The diagnosis with intervals of both models' held-out errors."""
    windows = scored_windows(d)
    if not windows:
        return d
    before = interval(windows, [w.y - w.y_baseline for w in windows])
    after = interval(windows, [w.y - w.y_extended for w in windows])
    baseline, extended = replace(d.baseline, holdout_ci95=before), replace(d.extended, holdout_ci95=after)
    return replace(d, baseline=baseline, extended=extended)


def _blocks(window: Window, error: Array, parts: int) -> Array:
    """Sums of squares of the error and of the measurement about its mean, shape (parts, 2)."""
    kept = window.scored & np.isfinite(error)
    own = window.y[kept] - np.mean(window.y[kept])
    segments = zip(np.array_split(error[kept], parts), np.array_split(own, parts), strict=True)
    return np.array([(float(e @ e), float(y @ y)) for e, y in segments])
