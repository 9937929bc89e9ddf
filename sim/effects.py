"""Every effect of the simulated plant: a named group of parameters with null values that switch it off.

This table is the only place where effects are listed. The kernel's parameter record (`sim.parameters`), rig
files, `seod simulate --effect` and the diagnosis take names, units and ranges from here; the equations are in
`docs/model.md`. `unit` in a unit stands for that of the plant's position: rad or m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

Place = Literal["valve", "flow", "oil", "load", "sensor", "plant", "record"]
"""Where an effect enters, in the order of the signal's way; `plant`: K_L, omega_n and zeta themselves."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: Unique within the effect.
        unit: Its unit; `unit` stands for the plant's own.
        null: The value at which it does nothing.
        low: Smallest value that makes sense.
        high: Largest.
        text: What it is.
    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    text: str


@dataclass(frozen=True, slots=True)
class Effect:
    """A named group of parameters.

    Attributes:
        name: As rig files and diagnoses write it.
        enters: Where in the plant.
        physics: What it stands for.
        parameters: Its numbers; all at their null values switch it off.
        equivalent: What cannot be told from it, and under which conditions; "" if nothing is known.
        cause: Whether a diagnosis may name it; the others only make truths to be found.
        counts_as: The cause by whose name a diagnosis answers it; "" by its own.
        sizes: Parameters each of which is a size of its own; none: the first is its size.
    """

    name: str
    enters: Place
    physics: str
    parameters: tuple[Parameter, ...]
    equivalent: str = ""
    cause: bool = True
    counts_as: str = ""
    sizes: tuple[str, ...] = ()


INF = math.inf
SENSOR_CURVE = {2: "a bow", 3: "an S", 4: "a W", 5: "two S", 6: "three bows"}
"""Shapes of a sensor's curve, by the order of the Legendre polynomial: without offset and slope."""

FAR = 1e15
"""Largest number with a unit of length or angle, also by s or s^2: a thousand km, in nm; and of a command's.
Records come in any unit: what is found in one in um, or with commands in counts, is found in m and V, too."""

NEAR = 1.0 / FAR
"""Smallest where 0 is none: a um, in units of a Gm."""

MAP_BENDS, MAP_TILTS = ("bend_1", "bend_2"), ("tilt_1", "tilt_2", "tilt_3")
"""What a valve's map adds at its corners, further out or of one sign; the last tilt at the range's end."""

LEAST_BETWEEN_KNOTS = 0.01
"""Of its range, between a map's corners: nearer ones are one corner."""

_ALL = (
    Effect(
        "transport_delay",
        "valve",
        "The command arrives later: bus, amplifier electronics, a loop's own tick.",
        (Parameter("time", "s", 0.0, 0.0, 100.0, "from the command to the valve"),),
        "On a linear plant with one input and one output, a delay of the sensor.",
    ),
    Effect(
        "valve_saturation",
        "valve",
        "The spool or its amplifier has an end: more voltage opens no further.",
        (Parameter("limit", "V", INF, 1e-6, INF, "largest voltage that counts, either way"),),
        "With a relay alone a smaller gain: u has two values.",
    ),
    Effect(
        "static_valve_map",
        "valve",
        "The valve's gain differs by level and direction: straight lines with rounded corners.",
        (
            *(
                Parameter(name, "V", 0.0, -FAR, FAR, f"further out at the {which} corner, before rounding")
                for name, which in zip(MAP_BENDS, ("first", "second"), strict=True)
            ),
            *(
                Parameter(name, "V", 0.0, -FAR, FAR, f"added at the {which}, either way")
                for name, which in zip(MAP_TILTS, ("first corner", "second corner", "end"), strict=True)
            ),
            Parameter("range", "V", INF, NEAR, INF, "command of the end; beyond it gain 1"),
            Parameter("knot_1", "1", 1.0 / 3.0, 0.01, 0.98, "first corner, as part of the range"),
            Parameter("knot_2", "1", 2.0 / 3.0, 0.02, 0.99, "second corner, as part of the range"),
            Parameter(
                "rounding", "1", 0.0, 0.0, 1.0, "0: sharp; 1: corners round to the nearer of 0 and the end"
            ),
            Parameter("at_ports", "1", 0.0, 0.0, 1.0, "0: of commands; above, of what the spool opens"),
        ),
        "With a relay alone a gain and a load_bias; of few levels valve_deadband, asymmetric_gain.",
        sizes=(*MAP_BENDS, *MAP_TILTS),
    ),
    Effect(
        "valve_hysteresis",
        "valve",
        "Magnetic hysteresis and friction of the spool: a play operator on the command.",
        (Parameter("half_width", "V", 0.0, 0.0, FAR, "half the play"),),
        "With a relay alone a smaller gain.",
    ),
    Effect(
        "valve_lag",
        "valve",
        "The spool follows its command as a first-order lag.",
        (Parameter("time", "s", 0.0, 0.0, 100.0, "time constant"),),
        "sensor_lag on a linear plant; for frequencies far below 1 / time a transport_delay.",
    ),
    Effect(
        "spool_inertia",
        "valve",
        "The spool has mass: its lag is of second order, with half of valve_lag.time omega as damping ratio.",
        (Parameter("omega", "rad/s", INF, 1e-3, INF, "undamped natural frequency of the spool"),),
        "Far above 1 / valve_lag.time nothing; beside valve_rate_limit nothing.",
        cause=False,
    ),
    Effect(
        "valve_rate_limit",
        "valve",
        "The spool goes no faster: its pilot stage gives so much flow, its motor so much current.",
        (Parameter("rate", "V/s", INF, 1e-3, INF, "fastest that the spool goes, either way"),),
        "Under a relay, whose switches are all as high, a moving mean: of slow plants a transport_delay.",
    ),
    Effect(
        "null_shift",
        "valve",
        "The spool's centre is not at 0 V.",
        (Parameter("voltage", "V", 0.0, -FAR, FAR, "at which the valve is closed"),),
        "load_bias of omega_n K_L voltage / (2 zeta): with straight flow and leakage damping the same.",
        counts_as="load_bias",
    ),
    Effect(
        "valve_deadband",
        "valve",
        "Overlap: around its centre the spool opens nothing.",
        (Parameter("half_width", "V", 0.0, 0.0, FAR, "half the overlap"),),
        "With a relay alone a smaller gain.",
    ),
    Effect(
        "asymmetric_gain",
        "flow",
        "An unequal cylinder or spool: K_L (1 + ratio) for positive, K_L (1 - ratio) for negative openings.",
        (Parameter("ratio", "1", 0.0, -0.9, 0.9, "half the relative difference"),),
        "With a relay alone a load_bias.",
    ),
    Effect(
        "square_root_flow",
        "flow",
        "The orifice's flow falls with the square root of the pressure that the load leaves.",
        (
            Parameter(
                "supply", "unit/s^2", INF, NEAR, INF, "acceleration of the free load by the supply pressure"
            ),
        ),
        "For small loads a larger zeta: see sim.linear.",
    ),
    Effect(
        "pressure_dependent_stiffness",
        "oil",
        "Air in the oil: its compliance falls with the square of the supply pressure.",
        (Parameter("air", "1", 0.0, 0.0, 100.0, "its compliance over the oil's at nominal pressure"),),
        "At constant supply pressure nothing: omega_n and zeta hold it.",
    ),
    Effect(
        "load_bias",
        "load",
        "A constant load: gravity, an unbalanced cylinder; or one that grows slowly, as a drive warms up.",
        (
            Parameter("acceleration", "unit/s^2", 0.0, -FAR, FAR, "against positive movement"),
            Parameter("drift", "unit/s^3", 0.0, -FAR, FAR, "by which it grows, from the start on"),
        ),
        "null_shift of 2 zeta acceleration / (omega_n K_L) volts; with a relay alone an asymmetric_gain.",
    ),
    Effect(
        "load_spring",
        "load",
        "The load pulls back to where it belongs: a spring, a pendulum, an aerodynamic hinge moment.",
        (
            Parameter("stiffness", "1/s^2", 0.0, -1e7, 1e7, "acceleration for each unit of deflection"),
            Parameter("centre", "unit", 0.0, -FAR, FAR, "position without force"),
        ),
        "Above its own frequency nothing: the position then turns round before the spring is felt.",
    ),
    Effect(
        "coulomb_friction",
        "load",
        "Seals and bearings: a constant force against the movement, and at rest up to that force.",
        (Parameter("level", "unit/s^2", 0.0, 0.0, FAR, "deceleration"),),
        "In one limit cycle of constant amplitude a larger zeta.",
    ),
    Effect(
        "stribeck_friction",
        "load",
        "More friction at low speed: level * exp(-(v / speed)^2) on top of the Coulomb friction.",
        (
            Parameter("level", "unit/s^2", 0.0, 0.0, FAR, "excess at rest"),
            Parameter("speed", "unit/s", 1.0, NEAR, FAR, "at which it has fallen to 1/e"),
        ),
        "For speeds far above `speed` nothing.",
    ),
    Effect(
        "viscous_friction",
        "load",
        "Damping by friction in proportion to the speed (seals, bearings, a motor) in place of leakage.",
        (Parameter("share", "1", 0.0, 0.0, 1.0, "of the damping 2 zeta omega_n; the rest is leakage"),),
        "Without dry friction, loads and orifices nothing: Eq. 1 has either damping, or both.",
        cause=False,
    ),
    Effect(
        "lugre_friction",
        "load",
        "Bristles in place of sticking (LuGre): the levels are those of Coulomb and Stribeck friction.",
        (
            Parameter("stiffness", "1/s^2", 0.0, 0.0, 1e9, "of the bristles; 0: dry friction that sticks"),
            Parameter("damping", "1/s", 0.0, 0.0, 1e6, "of the bristles"),
        ),
        "For stiffness to infinity the dry friction.",
        cause=False,
    ),
    Effect(
        "load_resonance",
        "load",
        "A second inertia behind a spring and a damper: a shaft, a structure.",
        (
            Parameter(
                "inertia", "1", 0.0, 0.0, 100.0, "second inertia over the first; their sum stays the same"
            ),
            Parameter("omega", "rad/s", 1000.0, 1e-3, 1e5, "of the second inertia with the first held"),
            Parameter("zeta", "1", 0.05, 0.0, 5.0, "its damping ratio"),
        ),
        "For omega far above omega_n nothing: the inertias move as one.",
    ),
    Effect(
        "periodic_disturbance",
        "load",
        "Pump ripple, an unbalanced rotor: amplitude * sin(omega t + phase) on the load.",
        (
            Parameter("amplitude", "unit/s^2", 0.0, 0.0, FAR, "acceleration"),
            Parameter("omega", "rad/s", 100.0, 1e-3, 1e5, "frequency"),
            Parameter("phase", "rad", 0.0, -10.0, 10.0, "at the start"),
        ),
        "A ripple of flow, volts or sensor of the same frequency.",
    ),
    Effect(
        "measured_disturbance",
        "load",
        "A load that a further channel `f` of the recording shows: a force, another circuit's pressure.",
        (
            Parameter("gain", "unit/s^2 for each unit of f", 0.0, -FAR, FAR, "acceleration of the load"),
            Parameter("zero", "of f", 0.0, -FAR, FAR, "f, above its mean, at which it does nothing"),
        ),
        "Without such a channel nothing; of one that follows the movement a load_spring, or zeta.",
    ),
    Effect(
        "backlash",
        "sensor",
        "Play between the actuator and what is measured: the measurement follows once the gap is used up.",
        (Parameter("gap", "unit", 0.0, 0.0, FAR, "the whole gap"),),
    ),
    Effect(
        "position_ripple",
        "sensor",
        "An eccentric encoder: amplitude * sin(wavenumber y + phase) is added to the position.",
        (
            Parameter("amplitude", "unit", 0.0, 0.0, FAR, "of the error"),
            Parameter("wavenumber", "rad/unit", 1.0, NEAR, FAR, "1: once a revolution"),
            Parameter("phase", "rad", 0.0, -10.0, 10.0, "at position 0"),
        ),
        "While the position stays within a small part of a wave a gain of the sensor.",
    ),
    Effect(
        "sensor_nonlinearity",
        "sensor",
        "A smooth curve between position and reading: a linkage, an eccentric encoder in part of a turn.",
        (
            *(
                Parameter(f"order_{n}", "unit", 0.0, -FAR, FAR, f"at the travel's ends: {shape}")
                for n, shape in SENSOR_CURVE.items()
            ),
            Parameter("centre", "unit", 0.0, -FAR, FAR, "middle of the travel"),
            Parameter("half", "unit", 1.0, NEAR, FAR, "half of the travel; beyond it the curve is straight"),
        ),
        "A position_ripple of less than about one wave over the travel.",
        sizes=tuple(f"order_{n}" for n in SENSOR_CURVE),
    ),
    Effect(
        "sensor_lag",
        "sensor",
        "A low-pass of first order in the sensor or its converter.",
        (Parameter("time", "s", 0.0, 0.0, 100.0, "time constant"),),
        "valve_lag on a linear plant.",
    ),
    Effect(
        "rectified_sensor",
        "sensor",
        "A sensor that knows no sign: pulses are counted, a voltage is rectified, a pressure drop is seen.",
        (
            Parameter("part", "1", 0.0, 0.0, 2.0, "below 0 it shows (1 - 2 part) y; 1: the absolute value"),
            Parameter("power", "1", 1.0, 0.5, 3.0, "times |y / range| to this less one; 2: the square"),
            Parameter("range", "unit (unit/s for a speed)", 1.0, NEAR, FAR, "where any power shows the same"),
        ),
        "While the reading keeps its sign a turned sensor, or nothing; its power then shows alone.",
        sizes=("part", "power"),
    ),
    Effect(
        "held_readings",
        "sensor",
        "A sensor slower than the record: each reading is repeated until the next is taken.",
        (Parameter("time", "s", 0.0, 0.0, 100.0, "from one reading to the next, by the sensor's clock"),),
        "Of slow movements a sensor's delay of half of that.",
    ),
    Effect(
        "sensor_quantization",
        "sensor",
        "Counts of an encoder or of a converter.",
        (Parameter("step", "unit (unit/s for a speed)", 0.0, 0.0, FAR, "one count"),),
        "With movement over many steps white noise of step / sqrt(12).",
    ),
    Effect(
        "parameter_drift",
        "plant",
        "Oil that warms up, a supply that sags: relative changes of K_L, omega_n and zeta.",
        (
            Parameter("K_L", "1/s", 0.0, -1.0, 1.0, "of K_L with time"),
            Parameter("omega_n", "1/s", 0.0, -1.0, 1.0, "of omega_n with time"),
            Parameter("zeta", "1/s", 0.0, -1.0, 1.0, "of zeta with time"),
            Parameter("K_L_thermal", "1/K", 0.0, -1.0, 1.0, "of K_L with temperature"),
            Parameter("omega_n_thermal", "1/K", 0.0, -1.0, 1.0, "of omega_n with temperature"),
            Parameter("zeta_thermal", "1/K", 0.0, -1.0, 1.0, "of zeta with temperature"),
        ),
        sizes=("K_L", "omega_n", "zeta", "K_L_thermal", "omega_n_thermal", "zeta_thermal"),
    ),
    Effect(
        "outliers",
        "record",
        "Single samples that are far off: a disturbed line, a bad contact.",
        (
            Parameter("rate", "1", 0.0, 0.0, 1.0, "part of the samples"),
            Parameter(
                "size", "unit (unit/s for a speed)", 0.0, 0.0, FAR, "standard deviation of their error"
            ),
        ),
    ),
    Effect(
        "missing_samples",
        "record",
        "Samples that never came: lost frames, a full queue.",
        (
            Parameter("rate", "1", 0.0, 0.0, 1.0, "part of the samples"),
            Parameter("length", "1", 1.0, 1.0, 1e6, "mean number of samples in a gap"),
        ),
    ),
    Effect(
        "timing_jitter",
        "record",
        "The sample was taken at another time than its timestamp says.",
        (Parameter("deviation", "s", 0.0, 0.0, 0.1, "standard deviation of the time"),),
    ),
)

LEAST = {"valve_lag.time": 1e-5, "sensor_lag.time": 1e-5, "backlash.gap": NEAR}
"""What is smaller and not 0 costs the kernel much, for nothing that could be seen."""

LEAST_SPOOL_DAMPING = 0.05
"""Damping ratio of a spool with inertia, at least: of less what is left of its way never ends."""

STEEPEST = 1e5
"""Greatest level of Stribeck friction over its speed [1/s]."""

STIFFEST = 1e9
"""Greatest stiffness of bristles over level [1/unit]: what gives way by less is dry friction, in any unit."""

QUICKEST = 1e4
"""The same times the speed at which Stribeck friction has fallen [1/s]: beside it bristles never settle, and
each of them is followed at any speed."""

EFFECTS = {effect.name: effect for effect in _ALL}
"""All effects by name, in the order of the signal's way."""


@cache
def parameter(place: str) -> tuple[Effect, Parameter]:
    """The effect and the parameter that `effect.parameter` names.

    Raises:
        ValueError: There is none; the message tells which there are.
    """
    name, _, of = place.partition(".")
    if name not in EFFECTS:
        raise ValueError(f"{place}: no effect {name!r}; there are {', '.join(EFFECTS)}")
    effect = EFFECTS[name]
    for each in effect.parameters:
        if each.name == of:
            return effect, each
    known = ", ".join(f"{name}.{each.name}" for each in effect.parameters)
    raise ValueError(f"{place}: {name} has no parameter {of!r}; it has {known}")


def stiffest_bristles(values: Mapping[str, float]) -> float:
    """Greatest stiffness of bristles over level [1/unit], beside what else is in `values`, by place."""
    if not values.get("stribeck_friction.level", 0.0) > 0.0:
        return STIFFEST
    return min(STIFFEST, QUICKEST / values.get("stribeck_friction.speed", 1.0))


def contradiction(effects: Mapping[str, Mapping[str, float]]) -> str:
    """What of these effects cannot be together, or is too quick to be simulated; "" if all can."""
    values = {f"{name}.{of}": value for name, group in effects.items() for of, value in group.items()}
    level = values.get("coulomb_friction.level", 0.0)
    bristles = values.get("lugre_friction.stiffness", 0.0)
    stiffest = stiffest_bristles(values)
    problems = [
        f"{place} must be 0 or at least {least:g}"
        for place, least in LEAST.items()
        if 0.0 < values.get(place, 0.0) < least
    ]
    if bristles > 0.0 and not level > 0.0:
        problems.append(
            "lugre_friction needs coulomb_friction.level > 0: its bristles give way at that force"
        )
    elif bristles > stiffest * level:
        problems.append(f"lugre_friction.stiffness must be at most {stiffest:g} coulomb_friction.level")
    spool, lag = values.get("spool_inertia.omega", INF), values.get("valve_lag.time", 0.0)
    if spool < INF and not lag > 0.0:
        problems.append("spool_inertia needs valve_lag.time > 0, which damps it")
    elif spool < INF and spool * lag < 2.0 * LEAST_SPOOL_DAMPING:
        problems.append(
            f"spool_inertia.omega must be at least {2.0 * LEAST_SPOOL_DAMPING:g} / valve_lag.time"
        )
    knots = [place for place, value in values.items() if place.startswith("static_valve_map.") and value]
    if knots and "static_valve_map.range" not in values:
        problems.append("static_valve_map needs a range: the command of its end")
    first, second = (values.get(f"static_valve_map.knot_{k}", k / 3.0) for k in (1, 2))
    if second - first < LEAST_BETWEEN_KNOTS:
        problems.append(
            f"static_valve_map.knot_2 must be at least {LEAST_BETWEEN_KNOTS:g} above knot_1 ({first:g})"
        )
    slowest = values.get("stribeck_friction.level", 0.0) / STEEPEST
    if values.get("stribeck_friction.speed", 1.0) < slowest:
        problems.append(f"stribeck_friction.speed must be at least {slowest:g}: its level / {STEEPEST:g}")
    return "; ".join(problems)


def power_of_y(unit: str) -> int:
    """Of the unit of y in a unit of the table: 1 in `unit/s^2`, -1 in `rad/unit`, 0 in `V`."""
    return -1 if unit.endswith("/unit") else int(unit.startswith(("unit", "(unit")))
