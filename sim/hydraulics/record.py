"""The parameters of a physical plant as one record of numbers. Needs no numba."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sim.effects import EFFECTS
from sim.hydraulics.parts import INF, PARTS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy.typing as npt

    from sim.hydraulics.parts import Hydraulic

DERIVED = (
    "rotary",  # 1: a motor, 0: a cylinder
    "area_a",  # [m^3/unit, with a crank m^2] of the chamber that positive volts fill
    "area_b",
    "volume_a",  # [m^3] at position 0
    "volume_b",
    "conductance",  # [m^3/s/V/Pa^0.5] of one orifice
    "clearance",  # [V] opening that each orifice always has
    "relief",  # [m^3/s/Pa] what the relief valve lets go more, for more pressure; 0: stiff supply
    "minus_inverse_polytropic",  # [1]
    "crank_angle",  # [rad] of a cylinder's crank at position 0
    "crank_square",  # [m^2] base^2 + arm^2
    "stop_low",  # [unit]
    "stop_high",
    "measures_speed",  # 1: the sensor sees speed
)
"""Slots beside those of `PARTS`."""

SENSOR = {
    name: tuple(each.name for each in EFFECTS[name].parameters)
    for name in (
        "sensor_lag",
        "sensor_quantization",
        "position_ripple",
        "outliers",
        "missing_samples",
        "timing_jitter",
    )
}
"""Effects of `sim.effects` that stand in the record under their own names."""

SLOTS = (
    *(part.slot for part in PARTS),
    *DERIVED,
    *(f"{name}_{of}" for name, parameters in SENSOR.items() for of in parameters),
)
RECORD = np.dtype([(name, np.float64) for name in SLOTS])
"""The record: all of `PARTS`, `DERIVED` and `SENSOR`."""

ATMOSPHERE = 101325.0
"""[Pa]"""

Values = dict[str, float]


class Described(Protocol):
    """What the record is made from; a plant of a rig file (`sim.config.PlantConfig`) is such."""

    @property
    def hydraulic(self) -> Hydraulic | None:
        """Its parts; None: it is no physical plant."""

    @property
    def effects(self) -> Mapping[str, Mapping[str, float]]:
        """Values by effect and parameter, as in `sim.effects`."""

    @property
    def stops(self) -> tuple[float, float] | None:
        """End stops [unit]; None: there are none."""

    @property
    def measures_speed(self) -> bool:
        """Whether its sensor sees speed."""


def _times_inertia(name: str) -> Callable[[Values, float], None]:
    def put(v: Values, value: float) -> None:
        v[name] = value * v["load_inertia"]

    return put


def _put(name: str) -> Callable[[Values, float], None]:
    def put(v: Values, value: float) -> None:
        v[name] = value

    return put


def _spool_lag(v: Values, value: float) -> None:
    """A spool of second order whose phase at low frequency is that of the lag."""
    if value > 0.0:
        v["valve_omega"] = min(v["valve_omega"], 2.0 * v["valve_zeta"] / value)


def _air(v: Values, value: float) -> None:
    """So much air that its compliance in chambers at half the supply is that part of the oil's."""
    absolute, n = 0.5 * v["supply_pressure"] + ATMOSPHERE, v["oil_polytropic"]
    each = v["oil_bulk_modulus"] / (n * absolute) * (ATMOSPHERE / absolute) ** (1.0 / n)
    v["oil_air"] = value / each


PHYSICAL: dict[str, Callable[[Values, float], None]] = {
    "transport_delay.time": _put("valve_delay"),
    "valve_saturation.limit": _put("valve_limit"),
    "valve_hysteresis.half_width": _put("valve_hysteresis"),
    "valve_lag.time": _spool_lag,
    "valve_rate_limit.rate": _put("valve_rate"),
    "null_shift.voltage": _put("valve_null_bias"),
    "valve_deadband.half_width": _put("valve_overlap"),
    "asymmetric_gain.ratio": _put("valve_asymmetry"),
    "pressure_dependent_stiffness.air": _air,
    "load_bias.acceleration": _times_inertia("load_force"),
    "load_spring.stiffness": _times_inertia("load_spring"),
    "load_spring.centre": _put("load_spring_centre"),
    "coulomb_friction.level": _times_inertia("load_coulomb"),
    "stribeck_friction.level": _times_inertia("load_stribeck"),
    "stribeck_friction.speed": _put("load_stribeck_speed"),
    "load_resonance.inertia": _put("load_second"),
    "load_resonance.omega": _put("load_second_omega"),
    "load_resonance.zeta": _put("load_second_zeta"),
    "periodic_disturbance.amplitude": _times_inertia("load_shake"),
    "periodic_disturbance.omega": _put("load_shake_omega"),
    "periodic_disturbance.phase": _put("load_shake_phase"),
}
"""What the parameters of `sim.effects` are to a physical plant: each sets a part, in that part's unit."""


def unfit(effects: Mapping[str, Mapping[str, float]]) -> str | None:
    """Which of these effects a physical plant does not take; None: it takes all."""
    known = {place.partition(".")[0] for place in PHYSICAL} | SENSOR.keys()
    others = [name for name in effects if name not in known]
    others += [place for place, value in _places(effects) if place not in PHYSICAL and value != 0.0]
    if not others:
        return None
    own = "; its orifices are such already" if "square_root_flow" in others else ""
    return f"a hydraulic plant takes no {', '.join(others)}{own}; it takes {', '.join(sorted(known))}"


def _places(effects: Mapping[str, Mapping[str, float]]) -> Iterator[tuple[str, float]]:
    """Parameters of effects at the plant itself that it takes, as `PHYSICAL` has them."""
    names = {place.partition(".")[0] for place in PHYSICAL}
    for name, parameters in effects.items():
        if name in names:
            yield from ((f"{name}.{of}", value) for of, value in parameters.items())


def record_of(plant: Described) -> npt.NDArray[np.void]:
    """The record for a physical plant: shape (1,) of `RECORD`.

    Raises:
        ValueError: It is no hydraulic plant, or an effect does not fit it.
    """
    if plant.hydraulic is None:
        raise ValueError("a plant without `hydraulic:` has no physical parameters")
    if wrong := unfit(plant.effects):
        raise ValueError(wrong)
    values = written(plant.hydraulic)
    low, high = plant.stops or (-INF, INF)
    values |= {"stop_low": low, "stop_high": high, "measures_speed": float(plant.measures_speed)}
    for name, parameters in plant.effects.items():
        if name in SENSOR:
            values |= {f"{name}_{of}": value for of, value in parameters.items()}
    for place, value in _places(plant.effects):
        if place in PHYSICAL:
            PHYSICAL[place](values, value)
    values |= _derived(plant.hydraulic, values)
    return np.array([tuple(values[name] for name in SLOTS)], RECORD)


def written(hydraulic: Hydraulic) -> Values:
    """Values by slot: those of the rig file, else the defaults; parts that are not there are 0."""
    values = dict.fromkeys(SLOTS, 0.0)
    for part in PARTS:
        default = 0.0 if part.default is None else part.default
        values[part.slot] = hydraulic.get(part.group, {}).get(part.name, default)
    for name, parameters in SENSOR.items():
        nulls = {each.name: each.null for each in EFFECTS[name].parameters}
        values |= {f"{name}_{of}": nulls[of] for of in parameters}
    return values


def _derived(hydraulic: Hydraulic, v: Values) -> Values:
    opening = v["valve_rated_flow"] / v["valve_rated_volts"]
    found = {
        "minus_inverse_polytropic": -1.0 / v["oil_polytropic"],
        "rotary": float("motor" in hydraulic),
        "conductance": opening / math.sqrt(0.5 * v["valve_rated_drop"]),
        "clearance": v["valve_leakage"] / opening,
        "relief": 1.0 / v["supply_droop"] if v["supply_droop"] > 0.0 else 0.0,
        "crank_angle": 0.0,
        "crank_square": 0.0,
    }
    if "motor" in hydraulic:
        found |= dict.fromkeys(("area_a", "area_b"), v["motor_displacement"])
        found |= dict.fromkeys(("volume_a", "volume_b"), v["motor_volume"])
        return found
    if v["cylinder_arm"] > 0.0:
        base, arm, length = v["cylinder_base"], v["cylinder_arm"], v["cylinder_length"]
        found["crank_square"] = base * base + arm * arm
        found["crank_angle"] = math.acos((found["crank_square"] - length * length) / (2.0 * base * arm))
    piston = 0.25 * math.pi * v["cylinder_piston"] ** 2
    ring = piston - 0.25 * math.pi * v["cylinder_rod"] ** 2
    return found | {
        "area_a": piston,
        "area_b": ring,
        "volume_a": v["cylinder_volume"] + piston * v["cylinder_half_stroke"],
        "volume_b": v["cylinder_volume"] + ring * v["cylinder_half_stroke"],
    }
