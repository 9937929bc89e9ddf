"""The physical plant in time: Runge-Kutta of fourth order, cut where the load stops or breaks away."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim.compiled import Record, compiled, inlined
from sim.hydraulics.flow import (
    CRANK_NEAR,
    LEAST_VOLUME,
    W,
    Y,
    airy,
    drive,
    encoded,
    expand_stroke,
    fed,
    friction_level,
    near,
    opening,
    rates,
    seen,
    set_pressure,
    shaken,
    stroke_near,
)

if TYPE_CHECKING:
    import numpy.typing as npt

STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "t",  # [s]
            "origin",  # [s] when ripple and shaking began
            "target",  # [V] where the spool is going: the command after limit and hysteresis
            "spool",  # [V]
            "spool_speed",  # [V/s]
            "pressure_a",  # [Pa]
            "pressure_b",
            "velocity",  # [unit/s]
            "position",  # [unit]
            "velocity2",  # of the second inertia
            "position2",
            "pressure_s",  # [Pa] at the servovalve
            "lagged",  # [unit, unit/s] behind the sensor's lag
            "motion",  # -1, 1: where the load moves; 0: it sticks or lies at a stop
            "stopped",  # -1, 1: it lies at the low, the high stop
            "supply",  # [1] supply pressure over the rig file's
            "warmth",  # [K] above nominal
            "conductance",  # [m^3/s/V/Pa^0.5] of an orifice in these surroundings
            "thinner",  # [1] by which leakage has grown with temperature
            "absolute_a",  # [Pa] absolute, about which the oil's stiffness is expanded
            "absolute_b",
            "absolute_s",
            "inverse_a",  # [1/Pa] 1 over these
            "inverse_b",
            "inverse_s",
            "air_a",  # [1] part of the volume that is air there
            "air_b",
            "air_s",
            "crank_at",  # [unit] about which the crank is expanded
            "way",  # [m] stroke there
            "lever",  # [m/unit]
            "lever_1",  # [m/unit^2], and so on: its derivatives
            "lever_2",
            "steps",  # Runge-Kutta steps so far
        )
    ]
)

SPOOL_STEP = 0.35
"""Longest substep times the spool's omega; likewise of the next two."""
LOAD_STEP = 0.25
ORIFICE_STEP = 0.8
"""Of the rate at which an orifice fills a chamber; the method is stable to 2.78."""
SHARPNESS = 1e-10
"""Events are located to this part of a substep."""
MOST_TRIALS = 40
MOST_EVENTS = 10000
"""In one call; any more are not located, so that it ends whatever the parameters."""


@compiled
def surroundings(p: Record, s: Record, supply: float, warmth: float) -> None:
    """Have `supply` times the rig file's pressure, `warmth` [K] above nominal from now on.

    What was expanded about a state is forgotten, so that it may be asked after any change of `p` or `s`.
    """
    s.absolute_a = s.absolute_b = s.absolute_s = 0.0
    s.crank_at = math.inf
    s.supply, s.warmth = supply, warmth
    s.thinner = math.exp(p.oil_thermal * warmth)
    s.conductance = p.conductance
    if p.valve_measured_0 != 0.0:
        ps = p.supply_pressure * supply
        at = min(max(ps, p.valve_measured_low), p.valve_measured_high)
        K_L = p.valve_measured_0 + (p.valve_measured_1 + p.valve_measured_2 * at) * at
        s.conductance = K_L * 0.5 * (p.area_a + p.area_b) / math.sqrt(0.5 * (ps - p.supply_tank))


@compiled
def rest(p: Record, s: Record, t: float, position: float, pressure_a: float, pressure_b: float) -> None:
    """Let the plant stand still at `position` [unit] at `t` [s] with these pressures [Pa]."""
    s.t = s.origin = t
    surroundings(p, s, 1.0, 0.0)
    s.target = s.spool = s.spool_speed = 0.0
    s.position = s.position2 = position
    s.velocity = s.velocity2 = 0.0
    s.pressure_a, s.pressure_b = pressure_a, pressure_b
    s.pressure_s = set_pressure(p, s, t)
    s.lagged = 0.0 if p.measures_speed else encoded(p, position)
    s.motion = 0.0 if p.load_coulomb + p.load_stribeck > 0.0 else 1.0
    s.stopped = 0.0


@compiled
def command(p: Record, s: Record, volts: float) -> None:
    """Have a command arrive at the spool's motor [V]."""
    volts = min(max(volts, -p.valve_limit), p.valve_limit)
    s.target = min(max(s.target, volts - p.valve_hysteresis), volts + p.valve_hysteresis)


@compiled
def measured(p: Record, s: Record) -> float:
    """What the sensor sees, before noise and counts [unit, or unit/s]."""
    return s.lagged if p.sensor_lag_time > 0.0 else seen(p, s.position, s.velocity)


@compiled
def quantized(p: Record, value: float) -> float:
    """A reading [unit, or unit/s] in whole counts of the sensor."""
    step = p.sensor_quantization_step
    return value if step == 0.0 else step * math.floor(value / step + 0.5)


@compiled
def advance(p: Record, s: Record, t: float) -> None:
    """Bring the plant to `t` [s], the command held."""
    events = 0
    while s.t < t:
        begin(p, s)
        left = t - s.t
        square, pieces = left * left * quickest(p, s), 1.0
        if square > 1.0:
            pieces = math.ceil(math.sqrt(square) - 1e-9)
        h = left / pieces if pieces > 1.0 else left
        z = (
            s.spool,
            s.spool_speed,
            s.pressure_a,
            s.pressure_b,
            s.velocity,
            s.position,
            s.velocity2,
            s.position2,
            s.pressure_s,
            s.lagged,
        )
        then = step(p, s, z, h)
        if events <= MOST_EVENTS and event(p, s, then, h) > 0.0:
            part = locate(p, s, z, h, event(p, s, then, h))
            then = step(p, s, z, part)
            accept(p, s, then, part)
            switch(p, s)
            events += 1
        else:
            accept(p, s, then, h)
            if pieces <= 1.0:
                s.t = t


@inlined
def begin(p: Record, s: Record) -> None:
    """Begin a substep: expand what is costly about where the plant is, if it has gone too far."""
    s.absolute_a, s.inverse_a, s.air_a = airy(p, s.pressure_a, s.absolute_a, s.inverse_a, s.air_a)
    s.absolute_b, s.inverse_b, s.air_b = airy(p, s.pressure_b, s.absolute_b, s.inverse_b, s.air_b)
    if p.supply_droop > 0.0:
        s.absolute_s, s.inverse_s, s.air_s = airy(p, s.pressure_s, s.absolute_s, s.inverse_s, s.air_s)
    if p.cylinder_arm > 0.0 and not abs(s.position - s.crank_at) <= 0.5 * CRANK_NEAR:
        expand_stroke(p, s)


@inlined
def quickest(p: Record, s: Record) -> float:
    """Square of the least number of substeps a second that follow all that moves [1/s^2]."""
    lever, va, vb = 1.0, p.volume_a, p.volume_b
    if p.rotary == 0.0:
        way, lever = stroke_near(p, s, s.position)
        va, vb = max(va + p.area_a * way, LEAST_VOLUME * va), max(vb - p.area_b * way, LEAST_VOLUME * vb)
    over, under = near(p, s.pressure_a, s.absolute_a, s.inverse_a, s.air_a)
    ca = over / (under * va)
    over, under = near(p, s.pressure_b, s.absolute_b, s.inverse_b, s.air_b)
    cb = over / (under * vb)
    stiff = (p.area_a * p.area_a * ca + p.area_b * p.area_b * cb) * lever * lever / p.load_inertia
    found = max(
        (p.valve_omega * (1.0 / SPOOL_STEP)) ** 2,
        stiff * (1.0 + p.load_second) * (1.0 / LOAD_STEP**2),
    )
    o = max(abs(opening(p, s.spool)), abs(opening(p, s.target))) + p.clearance
    if o > 0.0:
        ps = s.pressure_s
        into, out = min(ps - s.pressure_a, ps - s.pressure_b), min(s.pressure_a, s.pressure_b) - p.supply_tank
        slope = s.conductance * o * max(ca, cb) * (1.0 / ORIFICE_STEP)
        found = max(found, slope * slope / max(min(abs(into), abs(out)), p.valve_laminar))
    if p.supply_droop > 0.0:
        over, under = near(p, s.pressure_s, s.absolute_s, s.inverse_s, s.air_s)
        found = max(found, (over * p.relief / (under * p.supply_volume * ORIFICE_STEP)) ** 2)
    if p.sensor_lag_time > 0.0:
        found = max(found, (1.0 / (ORIFICE_STEP * p.sensor_lag_time)) ** 2)
    if p.load_second > 0.0:
        found = max(found, p.load_second_omega**2 * (1.0 + p.load_second) * (1.0 / LOAD_STEP**2))
    return found


@inlined
def _along(z: tuple[float, ...], k: tuple[float, ...], h: float) -> tuple[float, ...]:
    return (
        z[0] + h * k[0],
        z[1] + h * k[1],
        z[2] + h * k[2],
        z[3] + h * k[3],
        z[4] + h * k[4],
        z[5] + h * k[5],
        z[6] + h * k[6],
        z[7] + h * k[7],
        z[8] + h * k[8],
        z[9] + h * k[9],
    )


@compiled
def step(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, ...]:
    """One Runge-Kutta step of fourth order, `h` [s] long.

    Args:
        p: Parameters.
        s: State at its beginning.
        z: The same as `flow.rates` takes it.
        h: Length [s].

    Returns:
        `z` at its end.
    """
    half = 0.5 * h
    middle, end = s.t + half, s.t + h
    feed, shake = fed(p, s, middle), shaken(p, s, middle)
    a = rates(p, s, z, fed(p, s, s.t), shaken(p, s, s.t))
    b = rates(p, s, _along(z, a, half), feed, shake)
    c = rates(p, s, _along(z, b, half), feed, shake)
    d = rates(p, s, _along(z, c, h), fed(p, s, end), shaken(p, s, end))
    return _along(_along(_along(_along(z, a, h / 6.0), b, h / 3.0), c, h / 3.0), d, h / 6.0)


@inlined
def accept(p: Record, s: Record, z: tuple[float, ...], h: float) -> None:
    """Make `z`, `h` [s] from now, the state."""
    s.t += h
    s.spool, s.spool_speed, pa, pb, s.velocity, s.position, s.velocity2, s.position2, ps, s.lagged = z
    s.pressure_a, s.pressure_b = max(pa, p.oil_vapour), max(pb, p.oil_vapour)
    s.pressure_s = ps if p.supply_droop > 0.0 else set_pressure(p, s, s.t)
    if p.load_second == 0.0:
        s.velocity2, s.position2 = s.velocity, s.position
    s.steps += 1.0


@compiled
def event(p: Record, s: Record, z: tuple[float, ...], h: float) -> float:
    """Above 0 where the load has stopped, broken away, or met an end within the `h` [s] that ended in `z`.

    Of a load that rests in N unit, of one that moves in unit/s or unit.
    """
    if s.motion == 0.0:
        push = drive(p, s, z, shaken(p, s, s.t + h))
        return (abs(push) if s.stopped == 0.0 else -s.stopped * push) - friction_level(p, 0.0)
    turned = -1.0
    if p.load_coulomb + p.load_stribeck > 0.0:
        turned = -s.motion * z[W]
    return max(turned, z[Y] - p.stop_high, p.stop_low - z[Y])


@compiled
def locate(p: Record, s: Record, z: tuple[float, ...], h: float, at_high: float) -> float:
    """Time just after the event within `h` [s]: secants, bisected where they stall.

    Args:
        p: Parameters.
        s: State at the beginning.
        z: The same as numbers that are integrated.
        h: Length of the substep [s].
        at_high: `event` at its end.
    """
    low, high, at_low = 0.0, h, event(p, s, z, 0.0)
    for trial in range(MOST_TRIALS):
        if high - low <= SHARPNESS * h:
            break
        middle = 0.5 * (low + high)
        if trial % 3 != 2 and at_high > at_low:
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            middle = min(max(middle, low + 1e-3 * SHARPNESS * h), high - 1e-3 * SHARPNESS * h)
        value = event(p, s, step(p, s, z, middle), middle)
        s.steps += 1.0
        if value > 0.0:
            if value < 1e-12 * abs(at_high) or middle >= high:
                high = middle
                break
            high, at_high = middle, value
        else:
            low, at_low = middle, value
    return high


@compiled
def switch(p: Record, s: Record) -> None:
    """Do what the event just met asks for: stop, stick, turn round or leave."""
    z = (
        s.spool,
        s.spool_speed,
        s.pressure_a,
        s.pressure_b,
        0.0,
        s.position,
        s.velocity2,
        s.position2,
        s.pressure_s,
        s.lagged,
    )
    push, holds = drive(p, s, z, shaken(p, s, s.t)), friction_level(p, 0.0)
    if s.motion != 0.0:
        s.velocity = 0.0
        if s.position >= p.stop_high:
            s.position, s.stopped, s.motion = p.stop_high, 1.0, 0.0
        elif s.position <= p.stop_low:
            s.position, s.stopped, s.motion = p.stop_low, -1.0, 0.0
        else:
            s.motion = 0.0 if abs(push) <= holds else math.copysign(1.0, push)
        if p.load_second == 0.0:
            s.velocity2 = 0.0
        return
    s.motion, s.stopped = math.copysign(1.0, push), 0.0


def new_state(
    record: npt.NDArray[np.void], pressures: tuple[float, float], t: float = 0.0, position: float = 0.0
) -> npt.NDArray[np.void]:
    """A plant at rest with these chamber pressures [Pa]: array of shape (1,) of `STATE`."""
    state = np.zeros(1, STATE)
    rest(record[0], state[0], t, position, float(pressures[0]), float(pressures[1]))
    return state
