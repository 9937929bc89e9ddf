"""Which model an axis has: from the rig file's `simulation:` section."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.config.sensors import PressureConfig
from seod.config.truth import si_per_plant_unit, truth
from seod.config.units import UNITS
from seod.model_monitor.linear import LinearModel
from seod.model_monitor.remote import RemoteModel
from sim.truth import conditions

if TYPE_CHECKING:
    from seod.config.model import RigConfig
    from seod.model_monitor.kernel import KernelModel
    from seod.model_monitor.window import Model
    from sim.config import PlantConfig

LINEAR: Final = {"transport_delay", "sensor_lag", "sensor_quantization", "outliers", "missing_samples"}
"""Effects with which the closed form does, or which are no part of the plant."""


def plant_of(config: RigConfig, axis: str) -> PlantConfig | None:
    """The simulated plant that the axis' output moves, reduced to Eq. 1; None for a rig without a model."""
    channel = config.outputs[config.axes[axis].output].channel
    plants = config.simulation.plants.values() if config.simulation else ()
    return next((plant.reduced for plant in plants if plant.input == channel), None)


def needs_kernel(plant: PlantConfig) -> bool:
    """Whether a plant has effects that the closed form does not know."""
    return any(any(values.values()) for name, values in plant.effects.items() if name not in LINEAR)


def linear_model(config: RigConfig, axis: str) -> Model | None:
    """In closed form; None where its plant has no such values, such as one that is held."""
    plant, values = plant_of(config, axis), truth(config).get(axis, {})
    K_L, omega_n, zeta = (values.get(name) for name in ("K_L", "omega_n", "zeta"))
    if plant is None or K_L is None or omega_n is None or zeta is None:
        return None
    own = config.axes[axis]
    delay = own.estimator.delay + plant.effects.get("transport_delay", {}).get("time", 0.0)
    lag = config.sensors[own.sensor].lag + plant.effects.get("sensor_lag", {}).get("time", 0.0)
    return LinearModel(K_L, omega_n, zeta, delay, lag, own.mode == "velocity")


def kernel_model(config: RigConfig, axis: str) -> KernelModel | None:
    """With all effects. Imports numba, which may take seconds.

    Raises:
        ValueError: The plant cannot be simulated.
    """
    from seod.model_monitor.kernel import KernelModel  # noqa: PLC0415 - numba

    plant = plant_of(config, axis)
    if plant is None or config.simulation is None:
        return None
    own, output = config.axes[axis], config.outputs[config.axes[axis].output]
    slope = si_per_plant_unit(config.sensors[own.sensor], plant.sensor is not None)
    per_volt = output.scale / UNITS[output.unit][1]
    supply, warmth = conditions(plant, config.simulation.constants)
    return KernelModel(plant, slope, per_volt, output.offset, own.estimator.delay, supply, warmth)


def model_of(config: RigConfig, axis: str) -> Model | None:
    """The simplest model that does; None for a rig without one."""
    plant = plant_of(config, axis)
    if plant is None:
        return None
    return RemoteModel(config, axis) if needs_kernel(plant) else linear_model(config, axis)


def nominal_pressure(config: RigConfig, axis: str) -> float | None:
    """Of an axis' plant [Pa], where a sensor tells the pressure that it follows."""
    plant, name = plant_of(config, axis), config.axes[axis].supply_pressure
    sensor = config.sensors.get(name or "")
    if plant is None or plant.nominal_pressure is None or not isinstance(sensor, PressureConfig):
        return None
    if sensor.channel != plant.supply_pressure:
        return None
    return (plant.nominal_pressure * sensor.scale + sensor.offset) * UNITS[sensor.unit][1]
