"""A guard of one axis with limits that are powers of two, and how tests look at it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from drivers.base import Sample
from seod.config.axis import LimitsConfig
from seod.config.guard import GuardConfig
from seod.loop.guard import AxisGuard

if TYPE_CHECKING:
    from seod.loop.guard import Trip

LIMITS = {"output": 2.0, "travel": (-1.0, 3.0), "speed": 16.0, "amplitude": 0.5, "excitation": 10.0}
GUARD = {"stale": 0.125, "frozen": 2.0, "no_switch": 16.0}
"""Powers of two: their sums and differences are exact."""


def make(**changes: Any) -> AxisGuard:
    limits = LimitsConfig.model_validate({**LIMITS, **changes})
    return AxisGuard("motor", limits, GuardConfig.model_validate(GUARD))


def look(
    judge: AxisGuard, t: float, y: float, swing: float | None = None, exciting: bool = False
) -> Trip | None:
    return judge.inspect(t, Sample(y, t), y, swing, exciting, growth_counts=False)


def beyond(limit: float) -> float:
    """The next number away from zero."""
    return math.nextafter(limit, math.copysign(math.inf, limit))


def told(trip: Trip | None) -> Trip:
    assert trip is not None
    return trip
