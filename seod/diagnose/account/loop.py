"""Whether a loop is closed, so that commands answer to what disturbs the load, and the noise of one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from seod.diagnose.account.arx import Arx, rows_of, runs_of
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.tuning.account import PREDICTION, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.arx import Run
    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def acts_on_errors(every: Sequence[Series], parts: Sequence[WindowResidual]) -> bool:
    """Whether a relay or a servo loop acts on what disturbs the load; `parts` are what a model leaves."""
    if any(one.relayed for one in every):
        return True
    noise = colour(parts)
    errors = [noise.whitened(np.where(one.scored, one.error, 0.0)) for one in parts]
    past = [noise.has_past(one.scored) for one in parts]
    known = [np.where(some, error, 0.0) for some, error in zip(past, errors, strict=True)]
    return is_closed([one.u for one in parts], known)


def beside_commands(cuts: Sequence[Cut]) -> tuple[float, ...]:
    """Memory, newest first, of what disturbs readings beside their commands; none where rows are few.

    A long autoregression of readings, with the commands before each as well, foretells whatever a linear
    plant and its noise do, in a loop and without one (Ljung, System Identification, 2nd ed., 10.4). Of such
    length that each half of the windows foretells the other best.
    """
    position = not cuts[0].series[0].sees_speed
    halves = [runs_of(cut, 1) for cut in cuts]
    orders = [Arx(order, position, np.empty(0)) for order in PREDICTION.noise_orders]
    missed = [sum(_missed(arx, *two) for two in (halves, halves[::-1])) for arx in orders]
    if not math.isfinite(min(missed)):
        return ()
    best = orders[missed.index(min(missed))]
    past, now = _before(best, [run for half in halves for run in half])
    own = np.r_[1.0, -np.linalg.lstsq(past, now, rcond=1e-10)[0][: best.order]]
    whole = np.convolve(own, [1.0, -1.0]) if position else own
    return tuple((-whole[1:]).tolist())


def _before(arx: Arx, runs: Sequence[Run | None]) -> tuple[Array, Array]:
    """Of each reading its past, and it: without the command of its own row, which may answer to it."""
    past, now = rows_of(runs, arx)
    return (np.delete(past, arx.order, axis=1), now) if len(now) else (past, now)


def _missed(arx: Arx, fitted: Sequence[Run | None], other: Sequence[Run | None]) -> float:
    """Mean squared error of what a model of some windows foretells of others; inf where rows are few."""
    (past, now), (ahead, then) = _before(arx, fitted), _before(arx, other)
    if len(now) < PREDICTION.rows_each * past.shape[1] or not len(then):
        return math.inf
    return float(np.mean((then - ahead @ np.linalg.lstsq(past, now, rcond=1e-10)[0]) ** 2))


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
