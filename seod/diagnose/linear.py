"""The gain that fits best at a given natural frequency and damping, found without a search."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fit import Search
from seod.diagnose.normal import Normal
from seod.diagnose.simulate import simulate

if TYPE_CHECKING:
    from seod.diagnose.answer import Array
    from seod.diagnose.model import Model
    from seod.diagnose.windows import Cut


def linear_gain(model: Model, cut: Cut, x: Array, start: Array) -> tuple[float, float, float]:
    """K_L and a load bias that fit best at the omega_n and zeta of `x`, the initial states being free.

    Exact for Eq. 1, whose answer is linear in them; for the effects of a rig's file a guess.

    Returns:
        K_L [unit/s/V], load bias [unit/s^2], and the cost they leave.
    """
    search = Search(model, cut, map, np.zeros(len(x), np.bool_))
    biased = model if "load_bias" in model.names else model.with_effect("load_bias")
    at = np.concatenate([x, np.zeros(len(biased.coordinates) - len(x))])
    columns, bias = [], 1e-2 * model.scales.pressure
    at_rest = simulate(model.record(x), cut, start)
    for column in model.states:
        moved = start.copy()
        moved[:, column] += model.state_sizes[column]
        columns.append(simulate(model.record(x), cut, moved) - at_rest)
    pushed = simulate(
        biased.record(biased.searched({**biased.values(at), "load_bias.acceleration": bias})), cut, start
    )
    place = np.concatenate([np.full(n, s) for n, s in zip(cut.sizes, start[:, 2], strict=True)])
    offset = np.zeros_like(place) if model.sees_speed else place
    K_L = model.values(x)["K_L"]
    every = [*columns, (at_rest - offset) / K_L, (pushed - at_rest) / bias, search.y - offset]
    table = np.stack(every, axis=1) * search.good[:, None]
    products = np.array([table[piece].T @ table[piece] for piece in search.slices])
    normal = Normal(products, model.states, model.state_sizes, np.arange(2), 2)
    found = np.linalg.lstsq(normal.total[:2, :2], normal.total[:2, 2], rcond=1e-12)[0]
    error = normal.left[:, 2, 2] - 2.0 * normal.left[:, 2, :2] @ found
    error += np.einsum("i,wij,j->w", found, normal.left[:, :2, :2], found)
    return float(found[0]) or 1e-9, float(found[1]), search.cost(np.maximum(error, 0.0) / search.count)
