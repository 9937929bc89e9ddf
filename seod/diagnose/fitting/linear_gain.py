"""The gain that fits best at a given natural frequency and damping, found without a search."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import OFFSET, OFFSET_PLACE
from seod.diagnose.fitting.least_squares import LeastSquares
from seod.diagnose.fitting.normal_equations import Normal
from seod.diagnose.fitting.simulate import POSITION, simulate
from seod.diagnose.tuning.fitting import LINEAR_GAIN

if TYPE_CHECKING:
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def linear_gain(
    model: Model, cut: Cut, x: Array, start: Array, known: float | None = None
) -> tuple[float, float, float]:
    """K_L and a load bias that fit best at the omega_n and zeta of `x`, the initial states being free.

    Exact for Eq. 1, whose answer is linear in them; for the effects of a rig's file a guess.

    Args:
        model: Eq. 1, with the effects of a rig's file.
        cut: The windows.
        x: Searched numbers, shape (p,).
        start: Initial states, shape (w, 7).
        known: K_L [unit/s/V] if it is known.

    Returns:
        K_L [unit/s/V], load bias [unit/s^2], and the cost they leave.
    """
    search = LeastSquares(model, cut, map, np.zeros(len(x), np.bool_))
    biased = model if OFFSET in model.names else model.with_effect(OFFSET)
    at = np.concatenate([x, np.zeros(len(biased.coordinates) - len(x))])
    columns, bias = [], LINEAR_GAIN.bias * model.scales.pressure
    at_rest = simulate(model.record(x), cut, start)
    for column in model.states:
        moved = start.copy()
        moved[:, column] += model.state_sizes[column]
        columns.append(simulate(model.record(x), cut, moved) - at_rest)
    pushed = simulate(biased.record(biased.searched({**biased.values(at), OFFSET_PLACE: bias})), cut, start)
    place = np.concatenate([np.full(n, s) for n, s in zip(cut.sizes, start[:, POSITION], strict=True)])
    offset = np.zeros_like(place) if model.sees_speed else place
    K_L = model.values(x)["K_L"]
    every = [*columns, (at_rest - offset) / K_L, (pushed - at_rest) / bias, search.y - offset]
    table = np.stack(every, axis=1) * search.good[:, None]
    products = np.array([table[rows].T @ table[rows] for rows in search.slices])
    normal = Normal(products, model.states, model.state_sizes, np.arange(2), 2)
    found = _solved(normal.total, known)
    error = normal.reduced[:, 2, 2] - 2.0 * normal.reduced[:, 2, :2] @ found
    error += np.einsum("i,wij,j->w", found, normal.reduced[:, :2, :2], found)
    return (
        float(found[0]) or 1e-9,
        float(found[1]),
        search.cost(np.maximum(error, 0.0) / np.maximum(search.count, 1)),
    )


def _solved(total: Array, known: float | None) -> Array:
    """K_L, which may be known, and the bias."""
    if known is None:
        return np.asarray(np.linalg.lstsq(total[:2, :2], total[:2, 2], rcond=1e-12)[0])
    return np.array([known, (total[1, 2] - total[1, 0] * known) / max(float(total[1, 1]), 1e-300)])
