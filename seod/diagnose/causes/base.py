"""K_L, omega_n and zeta of Eq. 1: within what limits they are searched."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.cause import Coordinate

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales

FASTEST_PLANT, FASTEST_UNDER_RELAY = 0.8, 1.25
"""Natural frequency times the sampling interval, at most; the latter under a relay, where trials take few
samples. Plants at the bound are slow to simulate."""
LEAST_RANGE: Final = 0.5
"""Slowest natural frequency over the fastest, at most: of windows of few, uneven samples they would meet."""
DAMPED_BY_RELAY: Final = 5.0
"""Largest zeta under a relay: of more damping only the slower pole shows, and the other takes time."""
LEAST_GAIN, LARGEST_GAIN = 1e-18, 1e18
"""K_L [unit/s/V], in whatever unit the recordings have."""
LEAST_DAMPING: Final = 1e-3
"""Of zeta: less is not told from none within a recording."""
BASE: Final = ("K_L", "omega_n", "zeta")


def base(sign: float, scales: Scales, gain: float | None = None) -> tuple[Coordinate, ...]:
    """Coordinates of K_L, omega_n and zeta, in this order.

    Args:
        sign: Of K_L: -1 or 1.
        scales: Sizes of the recordings.
        gain: K_L where it is known [unit/s/V]; None: it is searched.
    """
    fastest = (FASTEST_UNDER_RELAY if scales.relayed else FASTEST_PLANT) / scales.tick_s
    slowest = min(scales.slowest, LEAST_RANGE * fastest)
    known = None if gain is None else Coordinate("K_L", math.copysign(1.0, gain), abs(gain), abs(gain))
    return (
        known or Coordinate("K_L", sign, LEAST_GAIN, LARGEST_GAIN),
        Coordinate("omega_n", 1.0, slowest, fastest),
        Coordinate("zeta", 1.0, LEAST_DAMPING, scales.damped),
    )
