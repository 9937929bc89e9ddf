"""A measured value with its standard deviation and 95 % interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class Value:
    """A measured value; `interval` holds the truth 95 times in 100."""

    value: float
    sd: float
    interval: tuple[float, float]


def measured(value: float, sd: float, dof: float) -> Value:
    """A value whose standard deviation was found from `dof` degrees of freedom (Student's interval)."""
    half = float(stats.t.ppf(0.975, dof)) * sd
    return Value(value, sd, (value - half, value + half))


def mean(values: Sequence[float]) -> Value:
    """Mean of repeated measurements, at least two."""
    return measured(
        float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(len(values)), len(values) - 1
    )
