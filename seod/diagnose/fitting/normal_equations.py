"""Normal equations of windows, each with an initial state of its own that is eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of derivatives, states first and residual last, rows end to end, and the weights of windows."""

    columns: Array
    weights: Array
    slices: Sequence[slice]


class Normal:
    """Weighted products of the columns, states first and residual last, of each window: shape (w, m, m).

    `prior` is what is known of a step of each free state beforehand: its size over its range, squared;
    `known` likewise of each searched number that is free, shape (p,).
    """

    def __init__(
        self,
        products: Array,
        states: list[int],
        sizes: Array,
        free: Any,
        unknowns: int,
        table: Table | None = None,
        prior: Array | None = None,
        known: Array | None = None,
    ) -> None:
        self.products, self.states, self.sizes, self.table = products, states, sizes, table
        self.free, self.unknowns, self.count = free, unknowns, len(states)
        n = self.count
        own = products[:, :n, :n] + np.diag(np.zeros(n) if prior is None else prior)
        ridge = 1e-9 * np.einsum("wii->wi", own) + 1e-12 * np.trace(own, axis1=1, axis2=2)[:, None] + 1e-200
        self.inverse = np.linalg.inv(own + ridge[:, :, None] * np.eye(n))
        self.solved = self.inverse @ products[:, :n, n:]
        self.reduced = products[:, n:, n:] - np.swapaxes(products[:, :n, n:], 1, 2) @ self.solved
        self.total = self.reduced.sum(axis=0)
        if known is not None:
            self.total += np.diag(np.r_[known, 0.0])

    def curvature(self) -> Array:
        """Of all searched numbers, zero for those that are not free."""
        out = np.zeros((self.unknowns, self.unknowns))
        out[np.ix_(self.free, self.free)] = self.total[:-1, :-1]
        return out

    def length(self, step: Array) -> float:
        """Of a step of the searched numbers, each in its own measure."""
        scale = np.sqrt(np.maximum(self.total.diagonal()[:-1], 0.0))
        return float(np.linalg.norm(scale * step[self.free]))

    def along(self, step: Array, states: Array) -> Array:
        """What a step changes in the simulation, to first order, shape (n,)."""
        assert self.table is not None  # noqa: S101
        own = states[:, self.states] / self.sizes[self.states]
        columns = self.table.columns
        out = columns[:, self.count : -1] @ step[self.free]
        for rows, of in zip(self.table.slices, own, strict=True):
            out[rows] += columns[rows, : self.count] @ of
        return np.asarray(out)

    def projected(self, x: Array) -> Array:
        """Weighted products of the columns with `x`, shape (n,), of each window: shape (w, m - 1)."""
        assert self.table is not None  # noqa: S101 - only a search asks
        table = self.table
        pairs = zip(table.weights, table.slices, strict=True)
        return np.array([w * (x[rows] @ table.columns[rows, :-1]) for w, rows in pairs])

    @property
    def slices(self) -> Sequence[slice]:
        """Rows of each window."""
        assert self.table is not None  # noqa: S101
        return self.table.slices

    def pulls(self, long: float, left: Array) -> Array:
        """What parts of the windows, of `long` rows or a window each, change the searched numbers by.

        Weighted products with what is left, shape (n,), initial states eliminated: they add up to 0 where a
        fit has ended. Shape (parts, p).
        """
        assert self.table is not None  # noqa: S101
        out = []
        for weight, rows, solved in zip(self.table.weights, self.table.slices, self.solved, strict=True):
            columns = self.table.columns[rows]
            own = columns[:, self.count : -1] - columns[:, : self.count] @ solved[:, :-1]
            count = max(1, round(len(columns) / long))
            out += [each.sum(axis=0) for each in np.array_split(weight * own * left[rows, None], count)]
        pulls = np.zeros((len(out), self.unknowns))
        pulls[:, self.free] = out
        return pulls

    def step(
        self, damping: float, low: Array, high: Array, right: Array | None = None
    ) -> tuple[Array, Array]:
        """Of the searched numbers within bounds, and of all windows' initial states, shape (w, 7).

        `right` is in place of the residual's products.
        """
        right = self.products[:, :-1, -1] if right is None else right
        n = self.count
        own = np.einsum("wij,wj->wi", self.inverse, right[:, :n])
        rest = right[:, n:] - np.einsum("wij,wi->wj", self.products[:, :n, n:-1], own)
        step = np.zeros(self.unknowns)
        if len(self.free):
            step[self.free] = self._solved(rest.sum(axis=0), damping, low[self.free], high[self.free])
        own = own - self.solved[:, :, :-1] @ step[self.free]
        states = np.zeros((len(own), len(self.sizes)))
        states[:, self.states] = own * self.sizes[self.states]
        return step, states

    def promise(self) -> float:
        """What an undamped step saves of the weighted squares, were they squares of straight lines."""
        n, right = self.count, self.products[:, :-1, -1]
        own = np.einsum("wij,wj->wi", self.inverse, right[:, :n])
        rest = self.total[:-1, -1]
        saves = float(np.sum(own * right[:, :n]))
        if len(rest):
            saves += float(rest @ np.linalg.lstsq(self.total[:-1, :-1], rest, rcond=1e-14)[0])
        return saves

    def _solved(self, right: Array, damping: float, low: Array, high: Array) -> Array:
        matrix = self.total[:-1, :-1]
        diagonal = np.maximum(matrix.diagonal(), 1e-12 * float(np.max(matrix.diagonal())) + 1e-300)
        damped = matrix + damping * np.diag(diagonal)
        active = np.ones(len(right), np.bool_)
        step = np.zeros(len(right))
        for _ in range(3):  # those that run into a bound stay there, the others are solved anew
            where = np.flatnonzero(active)
            if not len(where):
                break
            fixed = ~active
            rest = right[where] - damped[np.ix_(where, np.flatnonzero(fixed))] @ step[fixed]
            step[where] = np.linalg.lstsq(damped[np.ix_(where, where)], rest, rcond=1e-14)[0]
            step = np.clip(step, low, high)
            bound = active & ((step <= low) | (step >= high))
            if not bound.any():
                break
            active &= ~bound
        return step
