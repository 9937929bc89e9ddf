"""What one more effect promises to save, by a simulation or two.

That is how much of what the parent leaves lies in the direction of the effect's change, beyond what the
parent's own parameters and initial states can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import CAUSES, begun_from
from seod.diagnose.fitting.least_squares import LeastSquares, weighted
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array


@dataclass(frozen=True, slots=True)
class Promise:
    """One more effect: the model with it, where to begin, and what it may save of the log squared error.

    `numbers` are how many of its numbers save that.
    """

    model: Model
    x: Array
    saves: float
    numbers: int


class ParentResidual:
    """What a parent leaves, and what its own parameters and initial states could still do about it.

    Or what else may be in the readings `beside` it, shape (n, k).
    """

    def __init__(self, parent: Fitted, beside: Array | None = None) -> None:
        self.parent = parent
        search = LeastSquares(parent.model, parent.cut, map, np.ones(len(parent.x), np.bool_))
        residual, error = search.tried(parent.x, parent.start)
        table = search.derivatives(parent.x, parent.start, residual, error, beside).table
        assert table is not None  # noqa: S101 - a search has one
        self.good, self.residual = search.good, residual
        self.weight = np.sqrt(np.repeat(table.weights, parent.cut.sizes))
        columns = table.columns[:, :-1] * self.weight[:, None]
        states = len(parent.model.states)
        self.states = [_orthonormal(columns[rows, :states]) for rows in parent.cut.slices]
        self.own = _orthonormal(self._beyond_states(columns[:, states:]))
        self.remaining = self.beyond(residual)

    def promise(self, name: str, start: Values, *, each_size: bool = False) -> Promise:
        """What an effect saves if its change from this start is the right one but for its size.

        Or but for `each_size`, of one that has several.
        """
        model, x, directions = self._directions(name, start, each_size=each_size)
        total = max(
            float(self.remaining @ self.remaining), 1e-300
        )  # nothing, where a coarse sensor says no more
        explained = float(np.sum((directions.T @ self.remaining) ** 2)) / total
        return Promise(model, x, -math.log(max(1.0 - explained, 1e-12)), directions.shape[1])

    def directions(self, name: str, start: Values) -> Array:
        """Orthonormal changes that an effect of any size makes, beyond the parent's own; shape (n, k)."""
        return self._directions(name, start, each_size=True)[2]

    def unweighted(self, remaining: Array) -> Array:
        """What remains [unit of y]."""
        return np.asarray(remaining / self.weight)

    def _directions(self, name: str, start: Values, *, each_size: bool) -> tuple[Model, Array, Array]:
        """The model with an effect, where to begin, and orthonormal changes that the effect makes."""
        parent, model = self.parent, self.parent.model.with_effect(name)
        x = model.searched(begun_from(parent.model.values(parent.x), start))
        values = model.values(x)
        changed = (_sizes_alone(name, values) if each_size else []) or [{}]
        if CAUSES[name].wave is not None:
            changed.append({f"{name}.cosine": 0.0})
        changes = [self._change(model, model.searched(values | one)) for one in changed]
        return model, x, np.linalg.qr(np.stack(changes, axis=1))[0]

    def _change(self, model: Model, x: Array) -> Array:
        residual = weighted(model, self.parent.cut, x, self.parent.start)
        return self.beyond(np.where(self.good, self.residual - residual, 0.0))

    def beyond(self, y: Array) -> Array:
        """Of changes of `y`, shape (n,) or (n, k), what the parent's own parameters cannot do, weighted."""
        weighted = np.clip((y.T * self.weight).T, -1e100, 1e100)
        left = self._beyond_states(weighted)
        return np.asarray(left - self.own @ (self.own.T @ left))

    def _beyond_states(self, y: Array) -> Array:
        """Of weighted changes of each window what its own initial state cannot do."""
        out = y.copy()
        for rows, own in zip(self.parent.cut.slices, self.states, strict=True):
            out[rows] -= own @ (own.T @ y[rows])
        return out


def _orthonormal(columns: Array) -> Array:
    """Directions of columns, shape (n, k), but for those that are 0."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.qr(columns[:, size > 0.0] / size[size > 0.0])[0])


def _sizes_alone(name: str, values: Values) -> list[Values]:
    """Of an effect that has several sizes each one alone, as large as the largest."""
    sizes = [place for place in (f"{name}.{of}" for of in EFFECTS[name].sizes) if place in values]
    if len(sizes) < 2:
        return []
    largest = max(abs(values[place]) for place in sizes)
    return [dict.fromkeys(sizes, 0.0) | {alone: largest} for alone in sizes]
