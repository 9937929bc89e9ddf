"""An ARX with bent terms and products beside the linear ones."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.account.arx import Arx, farthest, past_of, rows_of, side_by_side
from seod.diagnose.tuning.account import YARDSTICK

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.arx import Run
    from seod.diagnose.result import Array


class Narx(NamedTuple):
    """An ARX whose terms are bent, multiplied and squared too; begins as that ARX does."""

    arx: Arx
    sizes: Array
    weights: Array

    def simulated(self, runs: Sequence[Run]) -> list[Array]:
        """Windows from the beginning of the linear model's simulation, side by side."""
        order, add = self.arx.order, float(self.arx.integrates)
        begun = self.arx.simulated(runs)
        y, u = side_by_side(begun), side_by_side([run.u for run in runs])
        limit = farthest(runs)
        for k in range(order + self.arx.integrates, len(y)):
            step = _bent(past_of(y, u, k, self.arx) / self.sizes) @ self.weights
            y[k] = np.clip(add * y[k - 1] + step, -limit, limit)
        return [y[: len(one), w] for w, one in enumerate(begun)]


def fitted_narx(runs: Sequence[Run | None], arx: Arx, ridge: float) -> Narx:
    """What the linear model leaves one step ahead, by ridge regression on all terms."""
    past, now = rows_of(runs, arx)
    sizes = np.maximum(np.max(np.abs(past), axis=0), 1e-300)
    terms = _bent(past / sizes)
    linear = np.zeros(terms.shape[1])
    linear[: past.shape[1]] = arx.weights * sizes
    size = np.sqrt(np.maximum(np.mean(terms**2, axis=0), 1e-300))
    scaled = terms / size
    products = scaled.T @ scaled / len(now) + ridge * np.eye(len(size))
    right = scaled.T @ (now - terms @ linear) / len(now)
    return Narx(arx, sizes, linear + np.linalg.solve(products, right) / size)


def _bent(past: Array) -> Array:
    """Linear terms; bent ones; products of the newest value of y, its change, and the commands."""
    width = (past.shape[1] - 2) // 2
    y, v, u, w = past[:, 0], past[:, 0] - past[:, 1], past[:, width], past[:, width + 1]
    some = y, v, u, w
    bends = [f(s) for s in some for f in (_sign, np.abs)] + [s**3 for s in some]
    return np.column_stack([past, *bends, *(a * b for a, b in combinations_with_replacement(some, 2))])


def _sign(x: Array) -> Array:
    return np.tanh(x / YARDSTICK.sharp)
