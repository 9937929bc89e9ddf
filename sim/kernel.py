"""The kernel: the reduced hydraulic plant with all effects, integrated from event to event.

Equations and tolerance are in `docs/model.md`; the names here are the ones there. Between two commands the spool
moves as an exact exponential; pressure, load and sensor are integrated by the classic fourth-order Runge-Kutta
method in substeps of at most `substep`. A substep in which something switches (the load stops, sticks, breaks away,
meets an end stop or the other flank of the backlash, or the measurement passes the relay's threshold) is cut
there: the right-hand side is smooth within each piece, so that the order of the method holds.
"""

from __future__ import annotations

import math

import numpy as np

from sim.compiled import Record, compiled
from sim.parameters import PARAMETERS

STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "t",  # [s]
            "origin",  # [s] when drift and disturbance began
            "target",  # [V] where the spool is going: the command after saturation and hysteresis
            "spool",  # [V]
            "pressure",  # [unit/s^2] acceleration of the free load by the load pressure
            "velocity",  # [unit/s]
            "position",  # [unit]
            "velocity2",  # [unit/s] of the second inertia
            "position2",  # [unit]
            "bristle",  # [unit] mean deflection of LuGre friction's bristles
            "lagged",  # [unit, unit/s] behind the sensor's lag
            "followed",  # [unit] behind the backlash
            "motion",  # -1, 1: where the load moves; 0: it sticks
            "stopped",  # -1, 1: it lies at the low, the high end stop
            "supply",  # [1] supply pressure over its nominal value
            "warmth",  # [K] temperature above its nominal value
            "level",  # [unit] threshold that the measurement is watched for
            "rate",  # [unit/s] at which the threshold moves
            "watch",  # -1, 1: the measurement falls below, rises above the threshold; 0: nothing is watched
            "passed",  # 1: it did, and the integration ended there
        )
    ]
)

LAMINAR = 1e-2
"""Relative pressure drop below which the orifice's flow is laminar: no infinite slope at zero."""

SHARPNESS = 1e-13
"""Events are located to this part of a substep."""

MOST_EVENTS = 10000
"""In one call; more are a sign of a fault, and end it."""


@compiled
def rest(p: Record, s: Record, t: float, position: float) -> None:
    """Let the plant stand still at `position` [unit] at `t` [s], valve closed, load in balance."""
    s.t = s.origin = t
    s.target = s.spool = 0.0
    s.position = s.position2 = position
    s.velocity = s.velocity2 = 0.0
    s.pressure = p.load_bias_acceleration + p.load_spring_stiffness * (position - p.load_spring_centre)
    s.bristle = 0.0
    s.motion = 0.0 if _dry_friction(p) else 1.0
    s.stopped = 0.0
    s.supply = 1.0
    s.warmth = 0.0
    s.watch = s.passed = 0.0
    s.followed = position
    s.lagged = 0.0 if p.measures_speed else _rippled(p, position)


@compiled
def command(p: Record, s: Record, volts: float) -> None:
    """Have a command arrive at the valve [V]: saturation and hysteresis."""
    limit, play = p.valve_saturation_limit, p.valve_hysteresis_half_width
    volts = min(max(volts, -limit), limit)
    s.target = min(max(s.target, volts - play), volts + play)


@compiled
def measured(p: Record, s: Record) -> float:
    """What the sensor sees now, before noise and quantisation [unit, or unit/s]."""
    if p.sensor_lag_time > 0.0:
        return s.lagged
    return _seen(p, s, s.position, s.velocity)


@compiled
def quantized(p: Record, value: float) -> float:
    """A reading in whole counts of the sensor."""
    step = p.sensor_quantization_step
    return value if step == 0.0 else step * math.floor(value / step + 0.5)


@compiled
def advance(p: Record, s: Record, t: float) -> None:
    """Bring the state to time `t` [s], the command held.

    Where a threshold is watched (`watch`) and passed, it ends there: `s.t` tells when, `s.passed` is 1.
    """
    s.passed = 0.0
    for _ in range(MOST_EVENTS):
        left = t - s.t
        if left <= 0.0:
            break
        h, ends = _substep(p, s, left)
        now = (s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged)
        then = _step(p, s, now, h)
        if _event(p, s, then, h) <= 0.0:
            _accept(p, s, then, h)
            if ends:
                s.t = t
        else:
            low, high = _locate(p, s, now, h)
            then = _step(p, s, now, high)
            _accept(p, s, then, high)
            _switch(p, s, then, high)
            if s.passed != 0.0:
                break


@compiled
def _substep(p: Record, s: Record, left: float) -> tuple[float, bool]:
    """How far to go now [s], and whether that is the whole of `left`."""
    longest = p.substep
    opening = abs(_opening(p, s.spool)) + abs(_opening(p, s.target))
    if p.square_root_flow_supply < math.inf and opening > 0.0:
        drop = 1.0 - abs(s.pressure) / (p.square_root_flow_supply * s.supply)
        rate = p.omega_n * p.omega_n * p.K_L * opening / p.square_root_flow_supply
        longest = min(longest, 0.5 * math.sqrt(LAMINAR + abs(drop)) / rate)
    if p.lugre_friction_stiffness > 0.0:
        level = p.coulomb_friction_level + 1e-300
        rate = p.lugre_friction_stiffness * abs(s.velocity) / level
        longest = min(longest, 1.0 / (rate + 1e-300))
    longest = max(longest, 1e-9)
    pieces = math.ceil(left / longest - 1e-9)
    h = left / pieces if pieces > 1.0 else left
    edge = _next_edge(p, s)
    if edge < h:
        return edge, False
    return h, pieces <= 1.0


@compiled
def _next_edge(p: Record, s: Record) -> float:
    """When the spool next passes an edge of its overlap, where the flow has a kink [s]; inf: never."""
    lag = p.valve_lag_time
    if lag == 0.0:
        return math.inf
    nearest = math.inf
    for side in (-1.0, 1.0):
        edge = p.null_shift_voltage + side * p.valve_deadband_half_width
        before, after = s.spool - s.target, edge - s.target
        if before * after > 0.0 and abs(after) < abs(before) * (1.0 - 1e-9):
            nearest = min(nearest, lag * math.log(before / after))
    return nearest


@compiled
def _opening(p: Record, spool: float) -> float:
    """What the spool opens, in volts of an ideal symmetric valve."""
    from_centre = spool - p.null_shift_voltage
    overlap, ratio = p.valve_deadband_half_width, p.asymmetric_gain_ratio
    if from_centre > overlap:
        return (from_centre - overlap) * (1.0 + ratio)
    if from_centre < -overlap:
        return (from_centre + overlap) * (1.0 - ratio)
    return 0.0


@compiled
def _spool_at(p: Record, s: Record, h: float) -> float:
    """The spool `h` [s] from now [V]."""
    if p.valve_lag_time == 0.0:
        return s.target
    return s.target + (s.spool - s.target) * math.exp(-h / p.valve_lag_time)


@compiled
def _flow(p: Record, s: Record, opening: float, pressure: float, gain: float) -> float:
    """Flow through the valve as the speed that it would give a load without pressure [unit/s]."""
    most = p.square_root_flow_supply
    if most == math.inf:
        return gain * opening
    drop = 1.0 - math.copysign(pressure, opening * pressure) / (most * s.supply)
    orifice = drop * ((1.0 + LAMINAR * LAMINAR) / (drop * drop + LAMINAR * LAMINAR)) ** 0.25
    return gain * opening * math.sqrt(s.supply) * orifice


@compiled
def _drifted(rate: float, thermal: float, t: float, warmth: float) -> float:
    """Factor of a drifting parameter; never below a twentieth."""
    return max(0.05, 1.0 + rate * t + thermal * warmth)


@compiled
def _stiffness(p: Record, s: Record) -> float:
    """Stiffness of the oil over that at nominal supply pressure."""
    air = p.pressure_dependent_stiffness_air
    return 1.0 if air == 0.0 else (1.0 + air) / (1.0 + air / (s.supply * s.supply))


@compiled
def _drive(p: Record, s: Record, t: float, pressure: float, position: float, coupling: float) -> float:
    """Acceleration of the whole load by everything but dry friction [unit/s^2]."""
    drive = pressure - p.load_bias_acceleration - p.load_spring_stiffness * (position - p.load_spring_centre)
    if p.periodic_disturbance_amplitude != 0.0:
        angle = p.periodic_disturbance_omega * (t - s.origin) + p.periodic_disturbance_phase
        drive += p.periodic_disturbance_amplitude * math.sin(angle)
    ratio = p.load_resonance_inertia
    return drive - ratio / (1.0 + ratio) * coupling


@compiled
def _coupling(p: Record, velocity: float, position: float, velocity2: float, position2: float) -> float:
    """Acceleration of the second inertia by its spring and damper [unit/s^2]."""
    omega, zeta = p.load_resonance_omega, p.load_resonance_zeta
    return omega * omega * (position - position2) + 2.0 * zeta * omega * (velocity - velocity2)


@compiled
def _friction_level(p: Record, speed: float) -> float:
    """Coulomb and Stribeck friction at a speed [unit/s^2]."""
    level = p.coulomb_friction_level
    if p.stribeck_friction_level > 0.0:
        relative = speed / p.stribeck_friction_speed
        level += p.stribeck_friction_level * math.exp(-relative * relative)
    return level


@compiled
def _dry_friction(p: Record) -> bool:
    """Whether the load can stick."""
    return p.lugre_friction_stiffness == 0.0 and _friction_level(p, 0.0) > 0.0


@compiled
def _rates(
    p: Record, s: Record, z: tuple[float, ...], t: float, opening: float
) -> tuple[float, float, float, float, float, float, float]:
    """Right-hand side: time derivatives of pressure, velocity, position, those of the second inertia, the
    bristles, and the lagged measurement.
    """
    pressure, velocity, position, velocity2, position2, bristle, lagged = z
    since, warmth = t - s.origin, s.warmth
    gain = p.K_L * _drifted(p.parameter_drift_K_L, p.parameter_drift_K_L_thermal, since, warmth)
    omega = p.omega_n * _drifted(p.parameter_drift_omega_n, p.parameter_drift_omega_n_thermal, since, warmth)
    zeta = p.zeta * _drifted(p.parameter_drift_zeta, p.parameter_drift_zeta_thermal, since, warmth)
    flow = _flow(p, s, opening, pressure, gain)
    d_pressure = _stiffness(p, s) * (omega * omega * (flow - velocity) - 2.0 * zeta * omega * pressure)

    ratio = p.load_resonance_inertia
    coupling = _coupling(p, velocity, position, velocity2, position2) if ratio > 0.0 else 0.0
    friction, d_bristle = 0.0, 0.0
    if p.lugre_friction_stiffness > 0.0:
        level = _friction_level(p, velocity)
        d_bristle = velocity - p.lugre_friction_stiffness * abs(velocity) / level * bristle
        friction = p.lugre_friction_stiffness * bristle + p.lugre_friction_damping * d_bristle
    elif s.motion != 0.0:
        friction = s.motion * _friction_level(p, velocity)
    d_velocity, d_velocity2 = 0.0, coupling
    if s.motion != 0.0 and s.stopped == 0.0:
        d_velocity = (1.0 + ratio) * (_drive(p, s, t, pressure, position, coupling) - friction)

    d_lagged = 0.0
    if p.sensor_lag_time > 0.0:
        d_lagged = (_seen(p, s, position, velocity) - lagged) / p.sensor_lag_time
    if ratio == 0.0:  # one inertia: the second goes with it
        d_velocity2, velocity2 = d_velocity, velocity
    return d_pressure, d_velocity, velocity, d_velocity2, velocity2, d_bristle, d_lagged


@compiled
def _moved(z: tuple[float, ...], k: tuple[float, ...], h: float) -> tuple[float, ...]:
    """z + h k."""
    return (
        z[0] + h * k[0],
        z[1] + h * k[1],
        z[2] + h * k[2],
        z[3] + h * k[3],
        z[4] + h * k[4],
        z[5] + h * k[5],
        z[6] + h * k[6],
    )


@compiled
def _step(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, ...]:
    """One Runge-Kutta step of `h` [s] from `z`."""
    half = 0.5 * h
    first = _opening(p, s.spool) if p.valve_lag_time > 0.0 else _opening(p, s.target)
    middle = _opening(p, _spool_at(p, s, half))
    last = _opening(p, _spool_at(p, s, h))
    a = _rates(p, s, z, s.t, first)
    b = _rates(p, s, _moved(z, a, half), s.t + half, middle)
    c = _rates(p, s, _moved(z, b, half), s.t + half, middle)
    d = _rates(p, s, _moved(z, c, h), s.t + h, last)
    return _moved(_moved(_moved(_moved(z, a, h / 6.0), b, h / 3.0), c, h / 3.0), d, h / 6.0)


@compiled
def _accept(p: Record, s: Record, z: tuple[float, ...], h: float) -> None:
    """Make `z`, `h` [s] from now, the state."""
    s.spool = _spool_at(p, s, h)
    s.t += h
    s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged = z
    s.followed = _followed(p, s, s.position)


@compiled
def _followed(p: Record, s: Record, position: float) -> float:
    """Position behind the backlash, the actuator having come to `position` without turning round."""
    half = 0.5 * p.backlash_gap
    return min(max(s.followed, position - half), position + half)


@compiled
def _rippled(p: Record, position: float) -> float:
    """Position with the encoder's eccentricity."""
    if p.position_ripple_amplitude == 0.0:
        return position
    angle = p.position_ripple_wavenumber * position + p.position_ripple_phase
    return position + p.position_ripple_amplitude * math.sin(angle)


@compiled
def _seen(p: Record, s: Record, position: float, velocity: float) -> float:
    """What the sensor sees without its lag [unit, or unit/s]."""
    followed = _followed(p, s, position)
    if not p.measures_speed:
        return _rippled(p, followed)
    if p.backlash_gap > 0.0 and abs(position - followed) < 0.5 * p.backlash_gap * (1.0 - 1e-9):
        return 0.0
    if p.position_ripple_amplitude == 0.0:
        return velocity
    angle = p.position_ripple_wavenumber * followed + p.position_ripple_phase
    return velocity * (1.0 + p.position_ripple_amplitude * p.position_ripple_wavenumber * math.cos(angle))


@compiled
def _event(p: Record, s: Record, z: tuple[float, ...], h: float) -> float:
    """Above 0 where something has switched within the `h` [s] that ended in `z`.

    Each event has a quantity that passes zero upwards; the largest of them tells the first event.
    """
    most = -1.0
    if s.watch != 0.0:
        seen = z[6] if p.sensor_lag_time > 0.0 else _seen(p, s, z[2], z[1])
        most = max(most, s.watch * (seen - s.level - s.rate * (s.t + h)))
    if s.stopped != 0.0 or s.motion == 0.0:
        return max(most, _breaks_away(p, s, z, s.t + h))
    if _dry_friction(p) or p.backlash_gap > 0.0 or p.lugre_friction_stiffness > 0.0:
        most = max(most, -s.motion * z[1])
    if p.backlash_gap > 0.0 and p.sensor_lag_time > 0.0:
        flank = s.motion * (z[2] - s.followed) - 0.5 * p.backlash_gap
        if s.motion * (s.position - s.followed) < 0.5 * p.backlash_gap * (1.0 - 1e-9):
            most = max(most, flank)
    return max(most, z[2] - p.stop_high, p.stop_low - z[2])


@compiled
def _breaks_away(p: Record, s: Record, z: tuple[float, ...], t: float) -> float:
    """Above 0 where a load that sticks or lies at a stop is driven off."""
    coupling = 0.0
    if p.load_resonance_inertia > 0.0:
        coupling = _coupling(p, 0.0, z[2], z[3], z[4])
    drive = _drive(p, s, t, z[0], z[2], coupling)
    holds = _friction_level(p, 0.0) if p.lugre_friction_stiffness == 0.0 else 0.0
    return (abs(drive) if s.stopped == 0.0 else -s.stopped * drive) - holds


@compiled
def _locate(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, float]:
    """Times just before and just after the first event within `h` [s]."""
    low, high = 0.0, h
    at_low, at_high = _event(p, s, z, 0.0), _event(p, s, _step(p, s, z, h), h)
    weight = 0
    for _ in range(100):
        if high - low <= SHARPNESS * h:
            break
        middle = 0.5 * (low + high)
        if at_low < 0.0 and abs(weight) < 3:  # regula falsi, unless one end stands still
            middle = min(max((low * at_high - high * at_low) / (at_high - at_low), low), high)
            if middle - low < SHARPNESS * h:
                middle = low + SHARPNESS * h
            if high - middle < SHARPNESS * h:
                middle = high - SHARPNESS * h
        value = _event(p, s, _step(p, s, z, middle), middle)
        if value > 0.0:
            high, at_high = middle, value
            weight = min(weight, 0) - 1
        else:
            low, at_low = middle, value
            weight = max(weight, 0) + 1
        if abs(weight) > 3:
            weight = 0
    return low, high


@compiled
def _switch(p: Record, s: Record, z: tuple[float, ...], h: float) -> None:
    """Do what the event just passed asks for."""
    if s.watch != 0.0 and s.watch * (measured(p, s) - s.level - s.rate * s.t) >= 0.0:
        s.passed = 1.0
    if s.stopped != 0.0 or s.motion == 0.0:
        if _breaks_away(p, s, z, s.t) > 0.0:
            _break_away(p, s)
    elif s.position >= p.stop_high or s.position <= p.stop_low:
        _stop(p, s)
    elif s.motion * s.velocity <= 0.0:
        _turn_round(p, s)


@compiled
def _balance(p: Record, s: Record) -> float:
    """Acceleration of the load that stands, but for dry friction [unit/s^2]."""
    coupling = 0.0
    if p.load_resonance_inertia > 0.0:
        coupling = _coupling(p, 0.0, s.position, s.velocity2, s.position2)
    return _drive(p, s, s.t, s.pressure, s.position, coupling)


@compiled
def _break_away(p: Record, s: Record) -> None:
    s.motion = -1.0 if _balance(p, s) < 0.0 else 1.0
    s.stopped = 0.0


@compiled
def _stop(p: Record, s: Record) -> None:
    """Lie at an end stop: it takes all speed away."""
    s.stopped = 1.0 if s.position >= p.stop_high else -1.0
    s.position = p.stop_high if s.stopped > 0.0 else p.stop_low
    s.velocity = 0.0
    s.bristle = 0.0
    if p.load_resonance_inertia == 0.0:
        s.velocity2, s.position2 = 0.0, s.position


@compiled
def _turn_round(p: Record, s: Record) -> None:
    """Stick, or go the other way."""
    if not _dry_friction(p):
        s.motion = -s.motion
        return
    s.velocity = 0.0
    if p.load_resonance_inertia == 0.0:
        s.velocity2 = 0.0
    drive = _balance(p, s)
    s.motion = 0.0 if abs(drive) <= _friction_level(p, 0.0) else math.copysign(1.0, drive)


def new_state(p: np.ndarray, t: float = 0.0, position: float = 0.0) -> np.ndarray:
    """A plant at rest: array of shape (1,) of `STATE`."""
    assert p.dtype == PARAMETERS
    s = np.zeros(1, STATE)
    rest(p[0], s[0], t, position)
    return s
