"""What a simulated plant is to small signals, where its rig's constants have it. Needs no numba."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim.hydraulics.linear import small_signal as physical
from sim.hydraulics.record import record_of
from sim.linear import small_signal
from sim.parameters import plant_parameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim.config import PlantConfig, SimulationConfig

LEAST_SUPPLY = 0.01
"""Least supply pressure over its nominal value that a plant follows: below, its equations have no sense."""


def conditions(plant: PlantConfig, constants: Mapping[str, float]) -> tuple[float, float]:
    """Supply pressure over nominal, temperature above nominal [K]: what the channels say that it follows."""
    supply, warmth = 1.0, 0.0
    if plant.supply_pressure is not None and plant.nominal_pressure is not None:
        supply = max(LEAST_SUPPLY, constants[plant.supply_pressure] / plant.nominal_pressure)
    if plant.temperature is not None and plant.nominal_temperature is not None:
        warmth = constants[plant.temperature] - plant.nominal_temperature
    return supply, warmth


def plant_truth(
    plant: PlantConfig, constants: Mapping[str, float], since: float = 0.0, speed: float = 0.0
) -> dict[str, float | None]:
    """K_L [unit/s/V], omega_n [rad/s] and zeta of a plant that moves slowly, as `sim.linear` says.

    Args:
        plant: It, with its effects.
        constants: Numbers of the constant channels.
        since: How long it drifts already [s].
        speed: About which [unit/s].

    Returns:
        By name; None where there is no such value, such as for a load that its supply cannot move.
    """
    supply, warmth = conditions(plant, constants)
    try:
        values = numbers(plant, plant.position, speed, supply, warmth, since)
    except ValueError:
        return dict.fromkeys(("K_L", "omega_n", "zeta"))
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def numbers(
    plant: PlantConfig, position: float, speed: float, supply: float, warmth: float, since: float = 0.0
) -> dict[str, float]:
    """K_L [unit/s/V], omega_n [rad/s] and zeta about a speed [unit/s] at a position, of either kind of plant.

    Raises:
        ValueError: There is no such steady state.
    """
    at = {"position": position, "speed": speed, "supply": supply, "warmth": warmth}
    if plant.hydraulic is not None:
        found = physical(record_of(plant), **at)
        return {"K_L": found.K_L, "omega_n": found.omega_n, "zeta": found.zeta}
    small = small_signal(plant_parameters(plant), since=since, **at)
    return {"K_L": small.K_L, "omega_n": small.omega_n, "zeta": small.zeta}


def rig_truth(simulation: SimulationConfig) -> dict[str, dict[str, float | None]]:
    """`plant_truth` of each plant, as the rig begins."""
    return {name: plant_truth(plant, simulation.constants) for name, plant in simulation.plants.items()}
