"""The finest step that a sensor can tell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.config.sensors import AbsoluteEncoderConfig, IncrementalEncoderConfig
from seod.config.units import UNITS

if TYPE_CHECKING:
    from seod.config.sensors import SensorConfig


def resolution_of(sensor: SensorConfig) -> float:
    """One count of an encoder in SI; 0 for a sensor that is not known to have steps."""
    if isinstance(sensor, IncrementalEncoderConfig) and sensor.counts_per_unit is not None:
        unit: float = UNITS[sensor.unit][1]
        return unit / abs(sensor.counts_per_unit)
    if isinstance(sensor, IncrementalEncoderConfig):
        return 2.0 * math.pi / abs(sensor.counts_per_rev or math.inf)
    if isinstance(sensor, AbsoluteEncoderConfig):
        return 2.0 * math.pi / abs(sensor.counts_per_rev or float(1 << sensor.bits))
    return 0.0
