"""Dense lines by few points that look the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

COLUMNS: Final = 700
"""Columns of pixels that a dense line is thinned to: of each its lowest and highest point."""


def thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """A dense line by the lowest and highest point of each column, in their order; a short one as it is.

    Args:
        x: Rising, shape (n,).
        y: Shape (n,); nan where there is none.
    """
    if len(x) <= 3 * COLUMNS:
        return x, y
    edges = np.linspace(0, len(x), COLUMNS + 1).astype(np.intp)
    rows = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        part = y[first:last]
        if np.isfinite(part).any():
            rows += sorted({first + int(np.nanargmin(part)), first + int(np.nanargmax(part))})
    return x[rows], y[rows]
