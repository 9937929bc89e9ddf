"""Whether y follows u itself, where nobody says so and Eq. 1 leaves much of it as a position."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.identify.fit import Fit, fit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.identify.problem import Given
    from seod.identify.record import Record

_CLEARLY: Final = 0.8
"""Error as a speed over that as a position, below which it is told. Measured: 0.12 to 0.70 of a dryer, an arm
and a crane, none of which follows the integral."""


def as_speed(records: Sequence[Record], given: Given, best: Fit) -> str | None:
    """A sentence where y fits clearly better as a speed; `best` is its plant as a position."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = fit([_turned(each) for each in records], given)
    except (np.linalg.LinAlgError, ArithmeticError, ValueError):
        return None
    if not found.nrmse < _CLEARLY * best.nrmse:
        return None
    return (
        "y is taken for a position, which follows the integral of u. As what follows u itself, a speed or a "
        f"position that a spring or a loop holds, {100.0 * found.nrmse:.3g} % is left: --output velocity"
    )


def _turned(record: Record) -> Record:
    turned = copy.copy(record)
    turned.output = "velocity"
    return turned
