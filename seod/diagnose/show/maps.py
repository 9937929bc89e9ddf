"""Residuals over time, input, states and the phase of the cycle: in bins, with intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.result import SD_OF_95

if TYPE_CHECKING:
    from seod.diagnose.result import Array

_BINS: Final = 24
_FEWEST: Final = 20
"""Samples of a bin that is shown."""
_OUTSIDE: Final = 0.005
"""Part of the samples at each end that does not stretch the bins."""


_MOSTLY: Final = 0.4
"""Part of the variance that a quantity has to tell for the values to be drawn over it."""


class Binned(NamedTuple):
    """Mean of a residual over a quantity; arrays of shape (bins,), nan in bins with too few samples.

    Attributes:
        centre: Mean of the quantity.
        mean: Mean of the residual.
        low, high: 95 % interval of the mean.
    """

    centre: Array
    mean: Array
    low: Array
    high: Array


def binned(x: Array, residual: Array, correlated: float = 1.0) -> Binned:
    """The residual over `x`, samples without either left out.

    Args:
        x: Quantity, shape (n,).
        residual: Shape (n,).
        correlated: So many neighbouring samples count as one.
    """
    edges = edges_of(x)
    place, kept = _places(x, edges), np.isfinite(x) & np.isfinite(residual)
    count, total, squares, own = (
        np.bincount(place[kept], weights, len(edges) + 1)[1:-1]
        for weights in (None, residual[kept], residual[kept] ** 2, x[kept])
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count >= _FEWEST, total / count, np.nan)
        spread = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
        half = SD_OF_95 * spread / np.sqrt(np.maximum(count / correlated, 1.0))
        return Binned(own / count, mean, mean - half, mean + half)


def explains(binned: Binned, values: Array) -> bool:
    """Whether the bins' means tell most of what there is: the values depend on the quantity."""
    means = binned.mean[np.isfinite(binned.mean)]
    return bool(len(means) > 1 and np.var(means) > _MOSTLY * np.nanvar(values))


def plane(x: Array, y: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Mean residual over two quantities: edges of both, (n + 1,) and (m + 1,), and the means, (m, n)."""
    kept = np.isfinite(x) & np.isfinite(y) & np.isfinite(residual)
    edges = edges_of(x), edges_of(y)
    bins = [edges[0], edges[1]]
    count = np.histogram2d(x[kept], y[kept], bins)[0]
    total = np.histogram2d(x[kept], y[kept], bins, weights=residual[kept])[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return edges[0], edges[1], np.where(count >= 3, total / count, np.nan).T


def edges_of(x: Array) -> Array:
    """Equal bins over nearly all of what there is."""
    finite = x[np.isfinite(x)]
    if not len(finite):
        return np.array([0.0, 1.0])
    low, high = np.quantile(finite, [_OUTSIDE, 1.0 - _OUTSIDE]).tolist()
    if not high > low:
        return np.array([low - 0.5, low + 0.5])
    return np.linspace(low, high, _BINS + 1)


def _places(x: Array, edges: Array) -> Array:
    """Number of the bin, 0 and len(edges) outside."""
    inside = np.where(np.isfinite(x), x, np.inf)
    return np.asarray(np.where(inside == edges[-1], len(edges) - 1, np.searchsorted(edges, inside, "right")))
