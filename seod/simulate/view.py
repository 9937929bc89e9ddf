"""Between an axis and the simulated plant behind its channels: volts one way, readings the other."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.config.units import UNITS
from seod.loop.sensor import make_sensor
from sim.experiment import count_size
from sim.sensor_config import AbsoluteEncoderTruth, FvConverterTruth, LinearScaleTruth
from sim.sensors import make_sensor as make_truth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.loop.sensor import Sensor
    from sim.config import PlantConfig
    from sim.sensor_config import AnySensor
    from sim.sensors import Perfect

    Array = NDArray[np.float64]


class AxisView:
    """One axis of a simulated rig.

    Args:
        config: The rig file; it has a `simulation:` section.
        axis: Name of the axis.

    Attributes:
        axis: Its section.
        plant: The simulated plant that its output moves.
        slope: Change of the axis' reading with the plant [SI unit per plant's unit].
        per_volt: The plant's volts for each volt of the axis.
        zero: The plant's volts at 0 V.
    """

    def __init__(self, config: RigConfig, axis: str) -> None:
        self.axis = config.axes[axis]
        self.config = config
        self.sensor = config.sensors[self.axis.sensor]
        output = config.outputs[self.axis.output]
        self.plant = plant_of(config, axis)
        self.per_volt = output.scale / UNITS[output.unit][1]
        self.zero = output.offset
        self.slope = self._slope()

    def volts(self, u: Array) -> Array:
        """What the plant gets for the axis' command [V]."""
        return u * self.per_volt + self.zero

    def command(self, volts: Array) -> Array:
        """The axis' command [V] for which the plant gets `volts`."""
        return (volts - self.zero) / self.per_volt

    def readings(self, y: Array) -> Array:
        """What the daemon makes of readings of the plant, in SI; nan where one is missing or unsound.

        They go through the channel's own numbers (a wrapping counter, a stroke) and back.
        """
        truth, believed = self._sensors()
        numbers = self._counted(y).tolist()
        return np.array([believed.read(truth.number(x)) if math.isfinite(x) else math.nan for x in numbers])

    def _sensors(self) -> tuple[Perfect, Sensor]:
        """The simulated sensor, and what the daemon takes it for; both as at the start."""
        return make_truth(self.plant.sensor, self.plant.measures_speed), make_sensor(self.sensor)

    def _counted(self, y: Array) -> Array:
        """An encoder's readings in the middle of their counts: no rounding moves them into another."""
        step = count_size(self.plant)
        if step == 0.0:
            return y
        zero = self.plant.sensor.zero if isinstance(self.plant.sensor, AbsoluteEncoderTruth) else 0.0
        return zero + (np.rint((y - zero) / step) + 0.5) * step

    def _slope(self) -> float:
        believed, truth = (
            make_sensor(self.sensor),
            make_truth(_fine(self.plant.sensor), self.plant.measures_speed),
        )
        start = 0.0 if self.plant.measures_speed else self.plant.position
        step = count_size(self.plant) or 1e-6 * (1.0 + abs(start))
        around = self._counted(np.array([start, start + step])).tolist()
        low, high = (believed.read(truth.number(x)) for x in around)
        return float(f"{(high - low) / step:.9g}")  # the rest is the difference's rounding


def _fine(sensor: AnySensor | None) -> AnySensor | None:
    """The sensor without the counts of its A/D converter, which are larger than a small step."""
    if isinstance(sensor, FvConverterTruth | LinearScaleTruth):
        return sensor.model_copy(update={"adc": None})
    return sensor


def plant_of(config: RigConfig, axis: str) -> PlantConfig:
    """The simulated plant that an axis' output moves.

    Raises:
        ValueError: There is none.
    """
    channel = config.outputs[config.axes[axis].output].channel
    plants = config.simulation.plants.values() if config.simulation else ()
    for plant in plants:
        if plant.input == channel:
            return plant
    raise ValueError(f"no simulated plant is moved by channel {channel!r}")
