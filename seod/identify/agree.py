"""Whether recordings that were fitted jointly are of one plant, as those at two amplitudes may not be."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.estimate.advice import INTERVAL
from seod.identify.fit import Fit, fit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.identify.problem import Given
    from seod.identify.record import Record

_FAR: Final = 4.0
"""Standard deviations of a difference that is no chance among some pairs of recordings."""
_MATTERS: Final = 0.01
"""Relative difference that matters."""


def disagreement(records: Sequence[Record], given: Given, best: Fit) -> str | None:
    """The two recordings, each fitted alone, that differ most in omega_n or zeta; None where all agree."""
    if len(records) < 2:
        return None
    alone = [(record.name, fit([record], given, best.plant)) for record in records]
    found = [
        (_distance(a, b, what), f"{what} is {_told(a, what)} in {first} but {_told(b, what)} in {second}")
        for (first, a), (second, b) in combinations(alone, 2)
        for what in ("omega_n", "zeta")
    ]
    far, sentence = max(found)
    if far < _FAR:
        return None
    return f"{sentence}: the plant has changed, or depends on the amplitude"


def _distance(a: Fit, b: Fit, what: str) -> float:
    """In standard deviations of the difference; 0 where it does not matter."""
    apart = abs(a.value[what] - b.value[what])
    sd = float(np.hypot(a.sd[what], b.sd[what]))
    if not apart > _MATTERS * min(a.value[what], b.value[what]):
        return 0.0
    return apart / max(sd, 1e-300)


def _told(alone: Fit, what: str) -> str:
    return f"{alone.value[what]:.4g} +- {INTERVAL * alone.sd[what]:.2g}"
