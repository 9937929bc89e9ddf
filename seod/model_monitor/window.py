"""A short segment of an axis' rows, and what a model has to do with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Segment(NamedTuple):
    """What was put out and what was measured.

    Attributes:
        t: Times of fresh samples [s], rising, shape (n,).
        y: Samples [axis unit, of a speed per s], shape (n,).
        t_u: When commands left [s], rising, from before the first sample on; shape (m,).
        u: Commands [V], shape (m,).
        supply: Supply pressure over nominal, shape (n,) or (0,).
    """

    t: Array
    y: Array
    t_u: Array
    u: Array
    supply: Array


class Model(Protocol):
    """Something that can simulate a segment."""

    name: str
    """`linear` or `kernel`."""

    def residual(self, segment: Segment) -> Array:
        """Measured less simulated, shape (n,); the state at the beginning is fitted.

        Raises:
            ValueError, ArithmeticError: It cannot be simulated.
        """

    def close(self) -> None:
        """Let go of what it holds."""
