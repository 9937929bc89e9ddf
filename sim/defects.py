"""Defects of a recording: outliers, missing samples, samples taken at another time than they say.

They act on the record, not on the plant. Names and parameters are those of `sim.effects`; `random` is a
seeded generator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RAREST = 1e-15
"""Smallest probability that is told from 0: any less does not happen in a recording."""


def outliers(n: int, rate: float, size: float, random: Generator) -> Array:
    """Errors to be added to samples.

    Args:
        n: Number of samples.
        rate: Part of them that is hit [1].
        size: Standard deviation of these errors [unit of the samples]; they are normal.
        random: Where chance comes from.

    Returns:
        Shape (n,); 0 where none is.
    """
    errors = random.normal(0.0, size, n) if size > 0.0 else np.zeros(n)
    return np.where(random.random(n) < rate, errors, 0.0)


def missing_samples(n: int, rate: float, length: float, random: Generator) -> NDArray[np.bool_]:
    """Which samples are missing.

    Gaps and what lies between them have geometric lengths. Where gaps that short cannot make up that part
    they are longer.

    Args:
        n: Number of samples.
        rate: Part of them that is missing [1].
        length: Mean length of the gaps [samples].
        random: Where chance comes from.

    Returns:
        Shape (n,).
    """
    if rate in {0.0, 1.0}:
        return np.full(n, rate == 1.0)
    odds = rate / (1.0 - rate)
    length = max(length, odds)
    begin = max(RAREST, odds / length)
    missing, k, gap = np.zeros(n, bool), 0, bool(random.random() < rate)
    while k < n:
        run = int(random.geometric(1.0 / length if gap else begin))
        missing[k : k + run] = gap
        k, gap = k + run, not gap
    return missing


def jittered(t: Array, deviation: float, random: Generator) -> Array:
    """When samples were really taken [s]: never out of order, and none before the first time.

    Args:
        t: When they say [s], ascending, shape (n,).
        deviation: Standard deviation of the difference [s].
        random: Where chance comes from.

    Returns:
        Ascending, shape (n,).
    """
    if deviation == 0.0:
        return t
    return np.sort(np.maximum(t + random.normal(0.0, deviation, len(t)), t[0]))
