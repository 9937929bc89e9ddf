"""What a cubic through neighbouring samples leaves beside their errors, or beside a bend of the signal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from seod.diagnose.tuning.record import OUTLIERS

if TYPE_CHECKING:
    from seod.diagnose.record.fourth_differences import Stencils
    from seod.diagnose.result import Array, Rows

UNKNOWNS = 4
"""Of a cubic."""
LEAST = 1e-12
"""Of an error's own part beyond cubics, of 1: behind a long hole cubics may take up a whole sample."""


@dataclass(frozen=True, slots=True)
class Neighbours:
    """Of k samples n neighbours each, and as many more as another sample lies behind.

    Attributes:
        ticks: Their times from the sample's, over the median interval, shape (k, n).
        cubics: Orthonormal cubics of these, shape (k, n, 4).
        left: What the nearest cubic leaves of their readings, shape (k, n).
        place: Of the sample among them, shape (k,).
        gap: Rows to the other sample; 0: there is none.
    """

    ticks: Array
    cubics: Array
    left: Array
    place: Rows
    gap: int

    @classmethod
    def of(cls, stencils: Stencils, middles: Rows, gap: int = 0) -> Self | None:
        """Of samples in the middle of these stencils, shape (k,); None where there are too few rows."""
        t, y = (np.concatenate([x[0, :2], x[:, 2], x[-1, 3:]]) for x in (stencils.ticks, stencils.samples))
        reach = OUTLIERS.reach
        if len(y) <= 2 * reach + gap:
            return None
        first = np.clip(middles + 2, reach, len(y) - 1 - gap - reach) - reach
        at = first[:, None] + np.arange(2 * reach + gap + 1)
        place = middles + 2 - first
        ticks = t[at] - t[middles + 2, None]
        cubics = np.linalg.qr(
            (ticks / np.max(np.abs(ticks), axis=1, keepdims=True))[..., None] ** np.arange(UNKNOWNS)
        )[0]
        near = y[at] - y[middles + 2, None]
        left = near - (cubics @ (cubics.swapaxes(1, 2) @ near[..., None]))[..., 0]
        return cls(ticks, cubics, left, place, gap)

    def beside_errors(self) -> tuple[Array, Array]:
        """Sum of squares that is left beside the samples' own errors, shape (k,), and these, (k, 1 or 2)."""
        own = np.arange(self.ticks.shape[1]) == self.place[:, None]
        both = [own, np.roll(own, self.gap, axis=1)] if self.gap else [own]
        columns = self._beyond(np.stack(both, axis=2).astype(np.float64))
        across = columns.swapaxes(1, 2)
        bends = across @ columns + LEAST * np.eye(columns.shape[2])
        errors = np.linalg.solve(bends, across @ self.left[..., None])
        left = self.left - (columns @ errors)[..., 0]
        return np.asarray(np.sum(left**2, axis=1)), np.asarray(errors[..., 0])

    def beside_a_bend(self) -> Array:
        """The same beside the best of corners and jumps at or between the samples, shape (k,)."""
        corners = np.linspace(-1.0, self.gap + 1.0, 8 + 4 * self.gap + 1)
        jumps = np.arange(-0.5, self.gap + 1.0)
        shapes = [
            np.abs(self.ticks[..., None] - corners),
            np.sign(self.ticks[..., None] - jumps),
        ]
        columns = self._beyond(np.concatenate(shapes, axis=2))
        along = (columns.swapaxes(1, 2) @ self.left[..., None])[..., 0] ** 2
        saved = along / np.maximum(np.sum(columns**2, axis=1), 1e-300)
        return np.asarray(np.sum(self.left**2, axis=1) - np.max(saved, axis=1))

    def _beyond(self, columns: Array) -> Array:
        """What cubics do not explain of columns, shape (k, n, j)."""
        return np.asarray(columns - self.cubics @ (self.cubics.swapaxes(1, 2) @ columns))
