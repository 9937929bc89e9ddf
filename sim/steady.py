"""Steady states of the plant: what belongs to a held command, or to a constant speed of the load.

Written in plain numbers beside `sim.physics`, so that who only asks about a plant need not import numba; the
tests hold both together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sim.valve_map import ValveMap

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

LAMINAR = 1e-2
"""That of `sim.physics`."""

TIGHT = 1e-9
"""Part of the damping that leaks at least: of a load that is held the pressure then has an end."""

MOST_HALVINGS = 2000
"""Until two neighbouring numbers are left, also near zero."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """A plant and what surrounds it.

    Attributes:
        p: The kernel's parameters by name.
        position: Where the load is [unit].
        supply: Supply pressure over nominal.
        warmth: Temperature above nominal [K].
        since: Time since the start [s], for what drifts.
    """

    p: Mapping[str, float]
    position: float = 0.0
    supply: float = 1.0
    warmth: float = 0.0
    since: float = 0.0

    def drifted(self, name: str) -> float:
        """K_L [unit/s/V], omega_n [rad/s] or zeta, by its name, as it is by now."""
        rate, thermal = self.p[f"parameter_drift_{name}"], self.p[f"parameter_drift_{name}_thermal"]
        return self.p[name] * max(0.05, 1.0 + rate * self.since + thermal * self.warmth)

    def stiffness(self) -> float:
        """Stiffness of the oil over that at nominal supply pressure [1]."""
        air = self.p["pressure_dependent_stiffness_air"]
        return (1.0 + air) / (1.0 + air / self.supply**2)

    def leakage(self) -> float:
        """Flow lost for each acceleration [s]: 2 zeta / omega_n, less what is viscous friction."""
        leaks = max(1.0 - self.p["viscous_friction_share"], TIGHT)
        return leaks * 2.0 * self.drifted("zeta") / self.drifted("omega_n")

    def viscous(self) -> float:
        """Deceleration by viscous friction for each speed [1/s]."""
        return self.p["viscous_friction_share"] * 2.0 * self.drifted("zeta") * self.drifted("omega_n")

    def load(self) -> float:
        """Pressure that the load asks for without friction [unit/s^2]."""
        deflection = self.position - self.p["load_spring_centre"]
        constant = self.p["load_bias_acceleration"] + self.p["load_bias_drift"] * self.since
        return constant + self.p["load_spring_stiffness"] * deflection

    def friction(self, speed: float) -> tuple[float, float]:
        """Friction at |speed| [unit/s]: its level [unit/s^2] and its slope there [1/s]."""
        excess, scale = self.p["stribeck_friction_level"], self.p["stribeck_friction_speed"]
        excess *= math.exp(-((speed / scale) ** 2))
        return self.p["coulomb_friction_level"] + excess, -2.0 * abs(speed) / scale**2 * excess

    def sticks(self) -> bool:
        """Whether friction holds a load at rest; bristles (LuGre) do not, they yield like a spring."""
        return self.p["lugre_friction_stiffness"] == 0.0 and self.friction(0.0)[0] > 0.0

    def flow_slopes(self, opening: float, side: float, pressure: float) -> tuple[float, float]:
        """The flow's slopes against the opening, through zero [unit/s/V], and against the pressure [s].

        The flow is the first of them times the opening.

        Args:
            opening: In volts of an ideal symmetric valve.
            side: -1, 1: the valve's side, also where it is closed; 0: both alike.
            pressure: Load pressure as acceleration [unit/s^2].
        """
        gain, most = self.drifted("K_L"), self.p["square_root_flow_supply"] * self.supply
        if most == math.inf:
            return gain, 0.0
        gain *= math.sqrt(self.supply)
        drop = 1.0 - side * pressure / most
        blunt = drop**2 + LAMINAR**2
        rounding = ((1.0 + LAMINAR**2) / blunt) ** 0.25
        bend = rounding * (1.0 - 0.5 * drop**2 / blunt)
        return gain * drop * rounding, -gain * abs(opening) * bend / most


@dataclass(frozen=True, slots=True)
class Steady:
    """A steady state.

    Attributes:
        volts: The command [V].
        opening: What it opens, in volts of an ideal symmetric valve.
        side: -1, 1: the valve's side, also where it is just closed; 0: at rest in its null, where small
            signals use both sides alike.
        pressure: [unit/s^2]
        speed: [unit/s]
        direction: -1, 1: where the load moves, however slowly; 0: it rests.
        held: Friction or an end stop holds the load.
        blocked: Effects that keep small changes of the command from the measurement; `stops`: an end stop.
    """

    volts: float
    opening: float
    side: float
    pressure: float
    speed: float
    direction: float
    held: bool
    blocked: tuple[str, ...]


def at_speed(c: Conditions, speed: float, direction: float) -> Steady:
    """The load moves at `speed` [unit/s]; where that is 0, slowly in `direction`, or it rests (0).

    Raises:
        ValueError: The supply pressure cannot move the load.
    """
    direction = _sign(speed) if speed else direction
    pressure = c.load() + direction * c.friction(speed)[0] + c.viscous() * speed
    flow = speed + c.leakage() * pressure
    side = _sign(flow or direction)
    slope = c.flow_slopes(0.0, side, pressure)[0]
    if slope <= 0.0:
        most = c.p["square_root_flow_supply"] * c.supply
        raise ValueError(f"the load needs {abs(pressure):g} unit/s^2, the supply has {most:g} unit/s^2")
    opening = flow / slope
    volts = _command(c.p, opening, side, direction)
    closed = flow == 0.0 and direction == 0.0
    return _steady(c, Steady(volts, opening, side, pressure, speed, direction, False, ()), closed, direction)


def at_volts(c: Conditions, volts: float, direction: float) -> Steady:
    """The command is held at `volts`.

    Args:
        c: The plant.
        volts: The command [V].
        direction: -1, 1: from which side the spool came there, for its hysteresis; 0: it is in the middle.
            A load in perfect balance without friction moves slowly this way.
    """
    opening, side = _opening(c.p, volts, direction)
    pressure = _stall(c, opening, side)
    surplus, friction = pressure - c.load(), c.friction(0.0)[0]
    way = _sign(surplus) if surplus else direction
    speed = 0.0
    if friction > 0.0 and abs(surplus) <= friction:
        way = 0.0
    else:
        speed = _speed(c, opening, side, way)
        pressure = c.load() + way * c.friction(speed)[0] + c.viscous() * speed
    return _steady(
        c, Steady(volts, opening, side, pressure, speed, way, False, ()), opening == 0.0, direction
    )


def _steady(c: Conditions, s: Steady, closed: bool, pushed: float) -> Steady:
    """`s` with all that blocks: the valve is `closed`, its play is `pushed` to this side."""
    p = c.p
    stuck = s.direction == 0.0 and c.sticks()
    low, high = p["stop_low"], p["stop_high"]
    stopped = (c.position >= high and s.direction >= 0.0) or (c.position <= low and s.direction <= 0.0)
    blocks = {
        "valve_saturation": abs(s.volts) > p["valve_saturation_limit"],
        "valve_hysteresis": pushed == 0.0 and p["valve_hysteresis_half_width"] > 0.0,
        "valve_deadband": closed and p["valve_deadband_half_width"] > 0.0,
        "coulomb_friction": stuck and p["coulomb_friction_level"] > 0.0,
        "stribeck_friction": stuck and p["stribeck_friction_level"] > 0.0,
        "stops": stopped,
        "backlash": s.direction == 0.0 and p["backlash_gap"] > 0.0,
    }
    return replace(
        s, held=stuck or stopped, blocked=tuple(name for name, blocked in blocks.items() if blocked)
    )


def _command(p: Mapping[str, float], opening: float, side: float, direction: float) -> float:
    """The command [V] that makes an opening on this side, come from the other side of its hysteresis."""
    valve_map = ValveMap(p)
    beyond = opening / (1.0 + side * p["asymmetric_gain_ratio"])
    if valve_map.at_ports:
        beyond = valve_map.command(beyond)
    overlap = side * p["valve_deadband_half_width"] if opening or direction else 0.0
    worth = beyond + overlap + p["null_shift_voltage"] + direction * p["valve_hysteresis_half_width"]
    return worth if valve_map.at_ports else valve_map.command(worth)


def _opening(p: Mapping[str, float], volts: float, direction: float) -> tuple[float, float]:
    """What a command opens [V], and the valve's side."""
    limit, overlap = p["valve_saturation_limit"], p["valve_deadband_half_width"]
    valve_map, worth = ValveMap(p), min(max(volts, -limit), limit)
    if not valve_map.at_ports:
        worth = valve_map.worth(worth)
    spool = worth - direction * p["valve_hysteresis_half_width"]
    from_centre = spool - p["null_shift_voltage"]
    side = _sign(from_centre or direction)
    opened = side * max(0.0, abs(from_centre) - overlap)
    if valve_map.at_ports:
        opened = valve_map.worth(opened)
    return opened * (1.0 + side * p["asymmetric_gain_ratio"]), side


def _stall(c: Conditions, opening: float, side: float) -> float:
    """Pressure at which all the flow leaks away: that of a load which cannot move [unit/s^2]."""
    without_load = opening * c.flow_slopes(opening, side, 0.0)[0] / c.leakage()
    return _root(lambda a: opening * c.flow_slopes(opening, side, a)[0] - c.leakage() * a, 0.0, without_load)


def _speed(c: Conditions, opening: float, side: float, direction: float) -> float:
    """Speed [unit/s] at which pressure, load and friction are in balance."""

    def surplus(speed: float) -> float:
        pressure = c.load() + direction * c.friction(speed)[0] + c.viscous() * speed
        return opening * c.flow_slopes(opening, side, pressure)[0] - c.leakage() * pressure - speed

    frictionless = opening * c.flow_slopes(opening, side, c.load())[0] - c.leakage() * c.load()
    return _root(surplus, 0.0, frictionless)


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where `function`, of one sign at `low` and of the other at `high`, is zero: to the last digit."""
    rising = function(high) > function(low)
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        if middle in {low, high}:
            break
        if (function(middle) > 0.0) == rising:
            high = middle
        else:
            low = middle
    return high
