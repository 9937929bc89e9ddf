"""The plant's equations (`docs/model.md`) differentiated about a steady state."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Legendre

from sim.effects import SENSOR_CURVE
from sim.valve_map import ValveMap

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sim.steady import Conditions, Steady

    Matrix = npt.NDArray[np.float64]

STATES = (
    "spool",
    "pressure",
    "velocity",
    "position",
    "velocity2",
    "position2",
    "bristle",
    "reading",
    "spool_speed",
)
"""All that there can be; names as in `sim.state`, the reading is that behind the sensor's lag."""

SPOOL, PRESSURE, VELOCITY, POSITION, VELOCITY2, POSITION2, BRISTLE, READING, SPOOL_SPEED = range(len(STATES))


def present(p: Mapping[str, float]) -> list[int]:
    """Places in `STATES` of the states that this plant has; `p` are the parameters by name."""
    second, bristles = p["load_resonance_inertia"] > 0.0, p["lugre_friction_stiffness"] > 0.0
    lags = p["valve_lag_time"] > 0.0, p["sensor_lag_time"] > 0.0
    there = (lags[0], True, True, True, second, second, bristles, lags[1], _swings(p))
    return [k for k, is_there in enumerate(there) if is_there]


def _swings(p: Mapping[str, float]) -> bool:
    """Whether the spool has inertia, and no limit of its speed."""
    inertia = p["valve_lag_time"] > 0.0 and p["spool_inertia_omega"] < math.inf
    return inertia and not p["valve_rate_limit_rate"] < math.inf


def _ports_slope(p: Mapping[str, float], steady: Steady) -> float:
    """Of what counts as opening over what the spool opens [1]."""
    valve_map, gain = ValveMap(p), 1.0 + steady.side * p["asymmetric_gain_ratio"]
    if not valve_map.at_ports:
        return gain
    opened = valve_map.command(steady.opening / gain)
    return gain * valve_map.slope(opened, steady.direction or steady.side)


def dynamics(c: Conditions, steady: Steady) -> Matrix:
    """The matrix A of all `STATES`, without lags: shape (9, 9), in their units per second.

    Args:
        c: The plant and what surrounds it.
        steady: The state about which it is linear.
    """
    p, A = c.p, np.zeros((len(STATES), len(STATES)))
    oil = c.stiffness() * c.drifted("omega_n") ** 2
    by_opening, by_pressure = c.flow_slopes(steady.opening, steady.side, steady.pressure)
    if steady.blocked:
        by_opening = 0.0
    A[PRESSURE, SPOOL] = oil * by_opening * _ports_slope(p, steady)
    A[PRESSURE, VELOCITY] = -oil
    A[PRESSURE, PRESSURE] = -oil * (c.leakage() - by_pressure)
    coupling = _coupling(p)
    if not steady.held:
        inertia = 1.0 + p["load_resonance_inertia"]
        A[VELOCITY] = -inertia * _friction(c, steady) - p["load_resonance_inertia"] * coupling
        A[VELOCITY, PRESSURE] += inertia
        A[VELOCITY, POSITION] -= inertia * p["load_spring_stiffness"]
        A[VELOCITY, VELOCITY] -= inertia * c.viscous()
    A[POSITION, VELOCITY] = A[POSITION2, VELOCITY2] = 1.0
    A[VELOCITY2] = coupling
    A[BRISTLE] = _bristle(c, steady)
    return A


def _coupling(p: Mapping[str, float]) -> Matrix:
    """Acceleration of the second inertia by each state."""
    row = np.zeros(len(STATES))
    omega, zeta = p["load_resonance_omega"], p["load_resonance_zeta"]
    row[[POSITION, POSITION2]] = omega**2, -(omega**2)
    row[[VELOCITY, VELOCITY2]] = 2.0 * zeta * omega, -2.0 * zeta * omega
    return row


def _friction(c: Conditions, steady: Steady) -> Matrix:
    """Friction on the load by each state, that of one that slides or of bristles."""
    row = np.zeros(len(STATES))
    if c.p["lugre_friction_stiffness"] > 0.0:
        row[BRISTLE] = c.p["lugre_friction_stiffness"]
        return row + c.p["lugre_friction_damping"] * _bristle(c, steady)
    row[VELOCITY] = c.friction(steady.speed)[1]
    return row


def _bristle(c: Conditions, steady: Steady) -> Matrix:
    """Rate of the bristles by each state: at rest they go with the load, in motion they have settled."""
    row = np.zeros(len(STATES))
    if c.p["lugre_friction_stiffness"] == 0.0:
        return row
    if steady.direction == 0.0:
        row[VELOCITY] = 1.0
    elif steady.speed != 0.0:
        level, slope = c.friction(steady.speed)
        row[VELOCITY] = abs(steady.speed) * slope / level
        row[BRISTLE] = -c.p["lugre_friction_stiffness"] * abs(steady.speed) / level
    return row


def sensor(p: Mapping[str, float], steady: Steady, position: float) -> Matrix:
    """What is measured by each of `STATES`, the sensor's lag left out: shape (9,).

    Args:
        p: Parameters by name.
        steady: The state about which it is linear.
        position: Of the load [unit].
    """
    row = np.zeros(len(STATES))
    if "backlash" in steady.blocked:
        return row
    wave, amplitude = p["position_ripple_wavenumber"], p["position_ripple_amplitude"]
    angle = wave * (position - 0.5 * steady.direction * p["backlash_gap"]) + p["position_ripple_phase"]
    bend, rises, bows = _bend(p, position - 0.5 * steady.direction * p["backlash_gap"])
    slope = 1.0 + amplitude * wave * math.cos(angle) + rises
    if not p["measures_speed"]:
        behind = position - 0.5 * steady.direction * p["backlash_gap"]
        row[POSITION] = slope * _shown(p, behind + amplitude * math.sin(angle) + bend)
        return row
    row[VELOCITY] = slope
    row[POSITION] = steady.speed * (bows - amplitude * wave**2 * math.sin(angle))
    return row * _shown(p, slope * (steady.speed or steady.direction))


def _bend(p: Mapping[str, float], position: float) -> tuple[float, float, float]:
    """The sensor's curve [unit], its slope, and its second derivative [1/unit]."""
    half = p["sensor_nonlinearity_half"]
    curve = Legendre([0.0, 0.0, *(p[f"sensor_nonlinearity_order_{n}"] for n in SENSOR_CURVE)])
    along = (position - p["sensor_nonlinearity_centre"]) / half
    z = min(max(along, -1.0), 1.0)
    rises = float(curve.deriv()(z))
    bows = float(curve.deriv(2)(z)) if z == along else 0.0
    return float(curve(z)) + rises * (along - z), rises / half, bows / half**2


def _shown(p: Mapping[str, float], seen: float) -> float:
    """Slope of what the sensor shows over what it sees."""
    slope = 1.0 if seen >= 0.0 else 1.0 - 2.0 * p["rectified_sensor_part"]
    power = p["rectified_sensor_power"]
    return slope if power == 1.0 else slope * power * abs(seen / p["rectified_sensor_range"]) ** (power - 1.0)


def add_lags(p: Mapping[str, float], A: Matrix, C: Matrix) -> tuple[Matrix, Matrix]:
    """Complete A by the lags of spool and sensor.

    Args:
        p: Parameters by name.
        A: That of `dynamics`, shape (9, 9); changed here.
        C: That of `sensor`, shape (9,).

    Returns:
        B for a command [V], and C with the lag: shape (9,) each.
    """
    B = np.zeros(len(STATES))
    before, behind = p["valve_lag_time"], p["sensor_lag_time"]
    if _swings(p):
        square = p["spool_inertia_omega"] ** 2
        A[SPOOL, SPOOL_SPEED], A[SPOOL_SPEED, SPOOL] = 1.0, -square
        A[SPOOL_SPEED, SPOOL_SPEED], B[SPOOL_SPEED] = -square * before, square
    elif before > 0.0:
        A[SPOOL, SPOOL], B[SPOOL] = -1.0 / before, 1.0 / before
    else:
        B[PRESSURE] = A[PRESSURE, SPOOL]
    if behind > 0.0:
        A[READING], A[READING, READING] = C / behind, -1.0 / behind
        C = np.eye(len(STATES))[READING]
    return B, C
