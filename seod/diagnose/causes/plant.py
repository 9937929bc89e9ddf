"""How the plant itself changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.cause import Cause, Coordinate, signed

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales

DRIFT_SIZE: Final = 0.1
"""Relative change over the longest recording, in whose steps a drift with time is searched; chosen."""
THERMAL_DRIFT_SIZE: Final = 0.01
"""Relative change for each kelvin, in whose steps one with temperature is; chosen."""
LARGEST_DRIFT: Final = 1.0
"""Of either [1/s], [1/K]: the simulated plant's own limit."""
DRIFT_START: Final = 0.1
"""Of a drift's size, where a search begins; chosen."""


def _drift_size(s: Scales) -> float:
    return THERMAL_DRIFT_SIZE if s.warmer else DRIFT_SIZE / s.span_s


def _drifts(s: Scales) -> tuple[Coordinate, ...]:
    kind = "_thermal" if s.warmer else ""
    return tuple(signed(f"{place}{kind}", _drift_size(s), LARGEST_DRIFT) for place in BASE)


PARAMETER_DRIFT: Final = Cause(
    name="parameter_drift",
    says="The plant itself changes: oil that warms up, a supply that sags.",
    coordinates=_drifts,
    starts=lambda s: ((DRIFT_START * _drift_size(s),) * len(BASE),),
)
PLANT: Final = (PARAMETER_DRIFT,)
