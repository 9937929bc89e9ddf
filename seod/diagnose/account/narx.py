"""An ARX with bent terms and products beside the linear ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.account import steps
from seod.diagnose.account.arx import Arx, farthest, rows_of, side_by_side
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
        begun = self.arx.simulated(runs)
        y, u = side_by_side(begun), side_by_side([run.u for run in runs])
        how = self.arx.order, self.arx.integrates, YARDSTICK.sharp
        steps.simulate_narx(y, u, self.weights, self.sizes, *how, farthest(runs))
        return [y[: len(one), w] for w, one in enumerate(begun)]


def fitted_narx(runs: Sequence[Run | None], arx: Arx, ridge: float) -> Narx:
    """What the linear model leaves one step ahead, by ridge regression on all terms."""
    past, now = rows_of(runs, arx)
    sizes = np.maximum(np.max(np.abs(past), axis=0), 1e-300)
    terms = np.asarray(steps.bent(past / sizes, arx.order, YARDSTICK.sharp))
    linear = np.zeros(terms.shape[1])
    linear[: past.shape[1]] = arx.weights * sizes
    size = np.sqrt(np.maximum(np.mean(terms**2, axis=0), 1e-300))
    scaled = terms / size
    products = scaled.T @ scaled / len(now) + ridge * np.eye(len(size))
    right = scaled.T @ (now - terms @ linear) / len(now)
    return Narx(arx, sizes, linear + np.linalg.solve(products, right) / size)
