"""What a simulated rig truly is, in the units of the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.sensors import FvConverterConfig, ScaledConfig
from seod.config.units import UNITS
from sim.truth import plant_truth

if TYPE_CHECKING:
    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig
    from seod.config.sensors import SensorConfig
    from sim.config import PlantConfig


def truth(config: RigConfig) -> dict[str, dict[str, float | None]]:
    """True K_L [axis unit/s/V], omega_n [rad/s] and zeta of each axis; empty for a real rig.

    They are those of small movements as the rig begins (`sim.linear`), of a physical plant about its
    reference speed; None where there is no such value.
    """
    if config.simulation is None:
        return {}
    plants = {plant.input: plant for plant in config.simulation.plants.values()}
    answer = {}
    for name, axis in config.axes.items():
        sensor, output = config.sensors[axis.sensor], config.outputs[axis.output]
        plant = plants.get(output.channel)
        if plant is None:
            continue
        per_volt = output.scale / UNITS[output.unit][1]
        unit = per_volt * si_per_plant_unit(sensor, plant.sensor is not None)
        true = plant_truth(plant, config.simulation.constants, speed=_speed(plant, axis, sensor))
        answer[name] = {**true, "K_L": None if true["K_L"] is None else true["K_L"] * unit}
    return answer


def _speed(plant: PlantConfig, axis: AxisConfig, sensor: SensorConfig) -> float:
    """At which a physical plant is asked [its unit/s]: its valve is open there, which damps."""
    if plant.hydraulic is None or axis.reference is None:
        return 0.0
    return axis.reference / si_per_plant_unit(sensor, plant.sensor is not None)


def si_per_plant_unit(sensor: SensorConfig, is_si: bool) -> float:
    """A plant moves in its channel's unit, or in SI where a sensor of its own looks at it."""
    if is_si or not isinstance(sensor, ScaledConfig | FvConverterConfig):
        return 1.0
    return sensor.scale * UNITS[sensor.unit][1]
