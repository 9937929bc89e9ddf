"""How well an estimated plant explains what was measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.estimate.limit_cycle.closed_form import LimitCycle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.arrays import Array
    from seod.estimate.limit_cycle.inversion import Plant
    from seod.estimate.limit_cycle.switches import Switch


def fitness(plant: Plant | None, switches: Sequence[Switch], gain: float, t: Array, y: Array) -> float | None:
    """1 - NRMSE of the last cycle against the plant's limit cycle under the switches really applied.

    NRMSE = sqrt(sum e^2 / sum (y - mean)^2); the offset of the position is free. 0 where the model is no
    better than the mean.

    Args:
        plant: Estimate; None gives None.
        switches: The three switches that bound the cycle.
        gain: K_L e_a [axis unit/s].
        t: Times of the samples [s], shape (n,).
        y: Position [axis unit], shape (n,).
    """
    if plant is None or len(switches) < 3:
        return None
    first, middle, last = (s.t for s in switches)
    halves = (middle - first, last - middle) if switches[0].up else (last - middle, middle - first)
    cycle = LimitCycle.of(plant.zeta, plant.omega_n * halves[0], plant.omega_n * halves[1])
    inside = slice(*np.searchsorted(t, (first, last)))
    since_up = t[inside] - (first if switches[0].up else middle)
    residual = y[inside] - cycle.positions(plant.omega_n * since_up) * (gain / plant.omega_n)
    spread = float(np.var(y[inside])) if len(residual) > 1 else 0.0
    if spread <= 0.0:
        return None
    return max(0.0, 1.0 - math.sqrt(float(np.var(residual)) / spread))
