"""The kernel's parameters: one record of numbers, laid out by the table of effects."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from sim.effects import EFFECTS, INF, SENSOR_CURVE, contradiction, parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sim.config import PlantConfig
    from sim.effects import Parameter

BASE = {
    "K_L": math.nan,
    "omega_n": math.nan,
    "zeta": math.nan,
    "stop_low": -INF,
    "stop_high": INF,
    "measures_speed": 0.0,
}
"""Parameters that are no effect: those of Eq. 1 [unit/s/V, rad/s, 1], the end stops [unit] and whether the
sensor sees speed (1) or position (0); with their defaults, NaN where there is none."""

SLOTS = (
    *BASE,
    *(f"{effect.name}_{each.name}" for effect in EFFECTS.values() for each in effect.parameters),
    "substep",
    "shortest",
    "longest_exact",
    "linear",
    "by_matrix",
)
"""Names of the parameter vector's elements, in its order: `effect_parameter`, the longest substep [s], the
shortest one over it that an orifice may ask for, the longest exact step [s] (0: none is), whether all are
exact (1) or only some (`sim.exact`), and whether these are by a matrix (`sim.matrix_steps`; else 0): a number
that other plants hardly have, too."""

PARAMETERS = np.dtype([(name, np.float64) for name in SLOTS])
"""The same as a record; an array of it and the vector are views of one memory."""

ACCURACY = 0.1
"""Longest substep times the fastest rate of the plant; docs/model.md states the tolerance."""

APART = 0.01
"""Of a spool's lag from a pole of the load, at least, where steps are exact: they lose two digits there."""

SHORTEST = 1e-3
"""Of substeps that an orifice near its largest pressure asks for, over the longest."""


def parameters(
    K_L: float,
    omega_n: float,
    zeta: float,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    *,
    accuracy: float = ACCURACY,
    shortest: float = SHORTEST,
    **base: float,
) -> npt.NDArray[np.void]:
    """The record for a plant with these effects.

    Args:
        K_L: Gain [unit/s/V].
        omega_n: Undamped natural frequency [rad/s].
        zeta: Damping ratio.
        effects: Values by effect and parameter; what is left out is null (or, of an effect that is on, the
            default of the table).
        accuracy: Longest substep times the plant's fastest rate.
        shortest: Substep that an orifice may ask for, over the longest.
        base: Others of `BASE`.

    Returns:
        Array of shape (1,) of `PARAMETERS`.

    Raises:
        ValueError: Something is unknown or out of its range; every such place is named.
    """
    values = {**_NULLS, **base, "K_L": K_L, "omega_n": omega_n, "zeta": zeta}
    values.update(_chosen(effects or {}))
    if len(values) > len(_NULLS):
        unknown = [name for name in values if name not in _NULLS]
        raise ValueError(f"unknown: {', '.join(unknown)}; there are {', '.join(BASE)}")
    linear, matrix = is_linear(values), by_matrix(values)
    exact = accuracy / _event_rate(values) if matrix or linear_at_times(values) else 0.0
    record = np.array([*values.values(), 0.0, shortest, exact, float(linear), 0.0]).view(PARAMETERS)
    if matrix:
        record["by_matrix"] = 1.0 + crc32(record.tobytes())
    record["substep"] = exact if linear else accuracy / fastest_rate(record)
    return record


def plant_parameters(plant: PlantConfig) -> npt.NDArray[np.void]:
    """The record for a plant of a rig file: array of shape (1,) of `PARAMETERS`.

    Raises:
        ValueError: Something is out of its range.
    """
    low, high = plant.stops or (-INF, INF)
    return parameters(
        plant.K_L,
        plant.omega_n,
        plant.zeta,
        plant.effects,
        stop_low=low,
        stop_high=high,
        measures_speed=float(plant.measures_speed),
    )


def nulls() -> dict[str, float]:
    """Null value of each effect's parameters by slot."""
    return {f"{e.name}_{each.name}": each.null for e in EFFECTS.values() for each in e.parameters}


_CHANGING = ("parameter_drift", "pressure_dependent_stiffness")
_NULLS = {**BASE, **nulls()}
_MORE_STATES = ("load_resonance_inertia", "load_spring_stiffness", "sensor_lag_time")
"""What must be 0 where oil and load alone are linear, if only at times; else it takes a matrix."""
_ANOTHER_EQUATION = (
    "load_bias_drift",
    *(f"{name}_{each.name}" for name in _CHANGING for each in EFFECTS[name].parameters),
)
"""What must be 0 in either case."""
_BENDS = (
    "backlash_gap",
    "position_ripple_amplitude",
    *(f"sensor_nonlinearity_order_{n}" for n in SENSOR_CURVE),
    "rectified_sensor_part",
    "rectified_sensor_power",
)
"""What bends a sensor, so that what is behind its lag is not linear."""
_AT_TIMES = ("stribeck_friction_level", "lugre_friction_stiffness", "valve_lag_time")
"""What must be 0, too, where they always are."""


def vector(record: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
    """The same memory as a vector, shape (len(SLOTS),)."""
    return record.view(np.float64)


def _chosen(effects: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    chosen, problems = {}, []
    for name, values in effects.items():
        for of, value in values.items():
            try:
                each = parameter(f"{name}.{of}")[1]
                _in_range(each, value, f"{name}.{of}")
            except ValueError as error:
                problems.append(str(error))
            else:
                chosen[f"{name}_{of}"] = float(value)
        if not values and name not in EFFECTS:
            problems.append(f"{name}: no such effect; there are {', '.join(EFFECTS)}")
    problems += filter(None, [contradiction(effects)])
    if problems:
        raise ValueError("; ".join(problems))
    return chosen


def _in_range(each: Parameter, value: float, place: str) -> None:
    if not each.low <= value <= each.high:
        raise ValueError(f"{place} = {value:g} {each.unit} must be within [{each.low:g}, {each.high:g}]")


def linear_at_times(p: Mapping[str, float]) -> bool:
    """Whether pressure, speed and position alone follow a linear equation, always or at some speeds.

    Then a step is exact (`sim.exact`). Its length matters to events alone: of each there may be one in it.
    """
    if not p["zeta"] > 0.0 or any(p[name] != 0.0 for name in (*_MORE_STATES, *_ANOTHER_EQUATION)):
        return False
    return p["square_root_flow_supply"] == INF and (p["valve_lag_time"] == 0.0 or _fades_apart(p))


def _fades_apart(p: Mapping[str, float]) -> bool:
    """Whether a spool follows its command by a lag alone, at another rate than the plant's own."""
    rate, omega_n = 1.0 / p["valve_lag_time"], p["omega_n"]
    damping, share = 2.0 * p["zeta"] * omega_n, p["viscous_friction_share"]
    square = omega_n * omega_n + share * (1.0 - share) * damping * damping
    apart = rate * (rate - damping) + square
    alone = p["spool_inertia_omega"] == INF and p["valve_rate_limit_rate"] == INF
    return alone and abs(apart) > APART * (rate * rate + square)


def by_matrix(p: Mapping[str, float]) -> bool:
    """Whether they do together with a second inertia, a spring or a straight sensor's lag, at some speeds."""
    if not any(p[name] != 0.0 for name in _MORE_STATES) or p["square_root_flow_supply"] != INF:
        return False
    if p["valve_lag_time"] != 0.0 or p["periodic_disturbance_amplitude"] != 0.0:
        return False
    straight = p["sensor_lag_time"] == 0.0 or all(p[name] == _NULLS[name] for name in _BENDS)
    return straight and p["zeta"] > 0.0 and not any(p[name] != 0.0 for name in _ANOTHER_EQUATION)


def is_linear(p: Mapping[str, float]) -> bool:
    """Whether they do from one event to the next, whatever the speed."""
    always = p["valve_rate_limit_rate"] == INF and not any(p[name] != 0.0 for name in _AT_TIMES)
    return always and linear_at_times(p)


def _event_rate(p: Mapping[str, float]) -> float:
    """Rate [rad/s] of the quickest turn of a plant whose steps are exact."""
    swings, ratio = p["periodic_disturbance_amplitude"] != 0.0, p["load_resonance_inertia"]
    second = p["load_resonance_omega"] if ratio > 0.0 else 0.0
    rates = [max(p["omega_n"], second) * math.sqrt(1.0 + ratio), math.sqrt(abs(p["load_spring_stiffness"]))]
    return max(*rates, p["periodic_disturbance_omega"] if swings else 0.0)


def fastest_rate(record: npt.NDArray[np.void]) -> float:
    """Rate of the fastest thing in the plant that is the same in every state [rad/s].

    What depends on the state (orifice, bristles) shortens the substep in the kernel.
    """
    p = record[0]
    omega_n, zeta, ratio = float(p["omega_n"]), float(p["zeta"]), float(p["load_resonance_inertia"])
    rates = [omega_n * max(1.0, 2.0 * zeta), math.sqrt(abs(float(p["load_spring_stiffness"])))]
    if ratio > 0.0:
        omega = float(p["load_resonance_omega"]) * math.sqrt(1.0 + ratio)
        rates.append(omega * max(1.0, 2.0 * float(p["load_resonance_zeta"]) * math.sqrt(1.0 + ratio)))
        rates[0] *= math.sqrt(1.0 + ratio)
    if p["periodic_disturbance_amplitude"] > 0.0:
        rates.append(float(p["periodic_disturbance_omega"]))
    if p["sensor_lag_time"] > 0.0:
        rates.append(0.4 / float(p["sensor_lag_time"]))
    if p["valve_lag_time"] > 0.0:
        rates.append(0.2 / float(p["valve_lag_time"]))
    if p["spool_inertia_omega"] < math.inf:
        rates.append(0.3 * float(p["spool_inertia_omega"]))
    if p["stribeck_friction_level"] > 0.0:
        rates.append(float(p["stribeck_friction_level"]) / float(p["stribeck_friction_speed"]))
    if p["lugre_friction_stiffness"] > 0.0:
        scale = 1.0 + ratio
        rates.append(math.sqrt(scale * float(p["lugre_friction_stiffness"])))
        rates.append(scale * float(p["lugre_friction_damping"]))
    return max(rates)
