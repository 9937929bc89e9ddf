"""What an axis runs under: supply pressure, temperature, and the gain K_L that follows from the pressure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.config.gain_in_force import gain_of, gain_range, needs_pressure
from seod.loop.sensor import make_sensor

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.base import Sample
    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig
    from seod.loop.sensor import Sensor

SILENT_S = 1.0
"""A slow sensor that has not been heard of for this long is silent; pressures change slowly."""


def value(sensor: Sensor, t: float, sample: Sample) -> float:
    """The newest sample at time `t` [s], in SI; nan while the sensor is silent or not sound."""
    return sensor.read(sample.value) if t - sample.t <= SILENT_S else math.nan


class Conditions:
    """K_L in force, from the rig file and the pressure, or as it was set.

    Args:
        axis: The axis.
        rig: The rig file.
        warn: Takes a code and a sentence for the clients.
    """

    def __init__(self, axis: AxisConfig, rig: RigConfig, warn: Callable[[str, str], None]) -> None:
        self.warn = warn
        self.needs_pressure = needs_pressure(axis.K_L)
        self.gain = gain_of(axis.K_L)
        self.K_L = sum(gain_range(axis.K_L)) / 2.0
        """The middle of the range until the pressure is known; the last one known while it is not."""
        self.pressure = self.thermometer = None
        if axis.supply_pressure is not None:
            self.pressure = make_sensor(rig.sensors[axis.supply_pressure])
        if axis.temperature is not None:
            self.thermometer = make_sensor(rig.sensors[axis.temperature])
        self.known = not self.needs_pressure
        self.ps = self.temperature = math.nan
        """Supply pressure [Pa] and temperature [K]; nan where they are not known."""

    def sense(self, t: float, pressure: Sample | None, temperature: Sample | None) -> None:
        """Take the newest samples of the sensors that there are; the gain follows."""
        if self.thermometer is not None and temperature is not None:
            self.temperature = value(self.thermometer, t, temperature)
        if self.pressure is not None and pressure is not None:
            self.ps = value(self.pressure, t, pressure)
            if self.needs_pressure:
                self._follow(self.gain(self.ps))

    def set(self, K_L: float) -> None:
        """From now on the gain is this number [axis unit/s/V]."""
        self.needs_pressure, self.known, self.K_L = False, True, K_L

    def _follow(self, K_L: float) -> None:
        heard = not math.isnan(K_L)
        if self.known and not heard:
            self.warn("supply_pressure", f"the sensor of supply pressure is silent: K_L stays {self.K_L:.4g}")
        self.known = heard
        if heard:
            self.K_L = K_L
