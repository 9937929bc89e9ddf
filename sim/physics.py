"""The plant's equations (`docs/model.md`), one function each: they read the records and change nothing."""

from __future__ import annotations

import math

from sim.compiled import Record, compiled, inlined

LAMINAR = 1e-2
"""Relative pressure drop below which the orifice's flow is laminar: no infinite slope at zero."""

VACUUM = 1e-3
"""Least supply pressure over nominal: without any the orifice and the oil have no equations."""

SETTLED = 1e-9
"""Part of the friction by which bristles that have settled bear more or less than all of it."""


@compiled
def corner(s: float, at: float, rounding: float) -> float:
    """0 before `at`, a line of slope 1 beyond it, and between them a parabola.

    Args:
        s: Part of the map's range, 0 to 1.
        at: Where the corner is, likewise.
        rounding: Half the parabola's width over the distance to the nearer end of the range.

    Returns:
        Part of the range.
    """
    half = rounding * min(at, 1.0 - at)
    if s <= at - half:
        return 0.0
    if s >= at + half:
        return s - at
    return (s - at + half) ** 2 / (4.0 * half)


@compiled
def cornered(p: Record, s: float, first: float, second: float, end: float) -> float:
    """Straight lines from 0 through two knots to the range's end, with rounded corners [V].

    Args:
        p: Parameters.
        s: Part of the map's range, 0 to 1.
        first: Value at the first knot [V].
        second: Value at the second [V].
        end: Value at the range's end [V].
    """
    at_1, at_2 = p.static_valve_map_knot_1, p.static_valve_map_knot_2
    begins, goes_on, ends = first / at_1, (second - first) / (at_2 - at_1), (end - second) / (1.0 - at_2)
    rounding = p.static_valve_map_rounding
    turned = (goes_on - begins) * corner(s, at_1, rounding) + (ends - goes_on) * corner(s, at_2, rounding)
    return begins * s + turned


@compiled
def mapped(p: Record, volts: float) -> float:
    """What a command, or what the spool opens, is worth by the valve's map [V]."""
    if p.static_valve_map_range == math.inf:
        return volts
    s = min(abs(volts) / p.static_valve_map_range, 1.0)
    bend = cornered(p, s, p.static_valve_map_bend_1, p.static_valve_map_bend_2, 0.0)
    tilt = cornered(p, s, p.static_valve_map_tilt_1, p.static_valve_map_tilt_2, p.static_valve_map_tilt_3)
    return volts + (-bend if volts < 0.0 else bend) + tilt


@compiled
def opening(p: Record, spool: float) -> float:
    """What the spool [V] opens, in volts of an ideal symmetric valve."""
    from_centre = spool - p.null_shift_voltage
    overlap, ratio = p.valve_deadband_half_width, p.asymmetric_gain_ratio
    if abs(from_centre) <= overlap:
        return 0.0
    side = 1.0 if from_centre > 0.0 else -1.0
    opened = from_centre - side * overlap
    if p.static_valve_map_at_ports != 0.0:
        opened = mapped(p, opened)
    return opened * (1.0 + side * ratio)


@compiled
def spool_at(p: Record, s: Record, h: float) -> float:
    """The spool `h` [s] from now [V]."""
    lag, rate = p.valve_lag_time, p.valve_rate_limit_rate
    if rate < math.inf:
        ramp = ramps_for(p, s)
        if h < ramp:
            return s.spool + math.copysign(rate * h, s.target - s.spool)
        if lag == 0.0:
            return s.target
        left = min(abs(s.target - s.spool), rate * lag) * math.exp((ramp - h) / lag)
        return s.target - math.copysign(left, s.target - s.spool)
    if lag == 0.0:
        return s.target
    if p.spool_inertia_omega < math.inf:
        return swung(p, s, h)[0]
    return s.target + (s.spool - s.target) * math.exp(-h / lag)


@compiled
def swings(p: Record) -> bool:
    """Whether the spool has a speed of its own: inertia, and no limit of its speed."""
    limited = p.valve_rate_limit_rate < math.inf
    return p.spool_inertia_omega < math.inf and p.valve_lag_time > 0.0 and not limited


@compiled
def swung(p: Record, s: Record, h: float) -> tuple[float, float]:
    """A spool with inertia `h` [s] from now [V], and its speed [V/s].

    From its target it is off by x'' + 2 d x' + omega^2 x = 0.
    """
    square = p.spool_inertia_omega * p.spool_inertia_omega
    d = 0.5 * p.valve_lag_time * square
    off, speed = s.spool - s.target, s.spool_speed
    even, odd = oscillation(d, square, h)
    push = speed + d * off
    return s.target + even * off + odd * push, even * speed - odd * (d * speed + square * off)


@compiled
def oscillation(d: float, square: float, h: float) -> tuple[float, float]:
    """exp(-d h) times cos(k h), and times sin(k h) / k [s], with k^2 = square - d^2 of either sign.

    The solution of x'' + 2 d x' + square x = 0 in its two parts; of an overdamped one hyperbolic.

    Args:
        d: Half the damping [1/s].
        square: Natural frequency squared [rad^2/s^2].
        h: Time [s].
    """
    beyond = d * d - square
    if beyond > 0.0:
        k = math.sqrt(beyond)
        slow = math.exp(-h * square / (d + k))
        odd = slow * -math.expm1(-2.0 * k * h) / (2.0 * k)
        return slow - k * odd, odd
    fading = math.exp(-d * h)
    if beyond == 0.0:
        return fading, fading * h
    k = math.sqrt(-beyond)
    return fading * math.cos(k * h), fading * math.sin(k * h) / k


@compiled
def spool_forgets(p: Record) -> float:
    """Slowest time constant of the spool [s]."""
    lag, omega = p.valve_lag_time, p.spool_inertia_omega
    return max(lag, 2.0 / (omega * omega * lag)) if swings(p) else lag


@compiled
def ramps_for(p: Record, s: Record) -> float:
    """How long the spool goes as fast as it can, from now on [s]; its speed is limited."""
    rate = p.valve_rate_limit_rate
    return max(0.0, abs(s.target - s.spool) - rate * p.valve_lag_time) / rate


@compiled
def spool_moves(p: Record) -> bool:
    """Whether the spool takes time to follow its command."""
    return p.valve_lag_time > 0.0 or p.valve_rate_limit_rate < math.inf


@compiled
def flow(p: Record, s: Record, opened: float, pressure: float, gain: float) -> float:
    """Flow through the valve as the speed that it would give a load without pressure [unit/s].

    Args:
        p: Parameters.
        s: State; its supply pressure counts.
        opened: Opening, in volts of an ideal symmetric valve.
        pressure: Load pressure as acceleration [unit/s^2].
        gain: K_L as it is now [unit/s/V].
    """
    most = p.square_root_flow_supply
    if most == math.inf:
        return gain * opened
    supply = max(s.supply, VACUUM)
    speed = gain * opened
    drop = 1.0 - math.copysign(pressure, speed * pressure) / (most * supply)
    square = (1.0 + LAMINAR * LAMINAR) / (drop * drop + LAMINAR * LAMINAR)
    return speed * drop * math.sqrt(supply * math.sqrt(square))


@compiled
def drifted(rate: float, thermal: float, t: float, warmth: float) -> float:
    """Factor of a drifting parameter [1]; never below a twentieth.

    Args:
        rate: Part by which it grows with time [1/s].
        thermal: Part by which it grows with temperature [1/K].
        t: Since the start [s].
        warmth: Temperature above nominal [K].
    """
    return max(0.05, 1.0 + rate * t + thermal * warmth)


@compiled
def stiffness(p: Record, s: Record) -> float:
    """Stiffness of the oil over that at nominal supply pressure [1]."""
    air = p.pressure_dependent_stiffness_air
    if air == 0.0:
        return 1.0
    supply = max(s.supply, VACUUM)
    return (1.0 + air) / (1.0 + air / (supply * supply))


@compiled
def drive(p: Record, s: Record, t: float, pressure: float, position: float, coupled: float) -> float:
    """Acceleration of the whole load by everything but friction [unit/s^2].

    Args:
        p: Parameters.
        s: State.
        t: Time [s].
        pressure: Load pressure as acceleration [unit/s^2].
        position: Of the load [unit].
        coupled: `coupling` [unit/s^2]; 0 without a second inertia.
    """
    total = steady_drive(p, s, t, pressure, position)
    if p.periodic_disturbance_amplitude != 0.0:
        angle = p.periodic_disturbance_omega * (t - s.origin) + p.periodic_disturbance_phase
        total += p.periodic_disturbance_amplitude * math.sin(angle)
    ratio = p.load_resonance_inertia
    return total - ratio / (1.0 + ratio) * coupled


@compiled
def steady_drive(p: Record, s: Record, t: float, pressure: float, position: float) -> float:
    """Likewise, without what oscillates and without a second inertia."""
    total = pressure - p.load_bias_acceleration - p.load_spring_stiffness * (position - p.load_spring_centre)
    total -= p.load_bias_drift * (t - s.origin)
    return total + p.measured_disturbance_gain * (s.force - p.measured_disturbance_zero)


@compiled
def coupling(p: Record, velocity: float, position: float, velocity2: float, position2: float) -> float:
    """Acceleration [unit/s^2] of the second inertia (`velocity2`, `position2`) by its spring and damper."""
    omega, zeta = p.load_resonance_omega, p.load_resonance_zeta
    return omega * omega * (position - position2) + 2.0 * zeta * omega * (velocity - velocity2)


@compiled
def friction_level(p: Record, speed: float) -> float:
    """Coulomb and Stribeck friction at a speed [unit/s], without its sign [unit/s^2].

    As g(v) of LuGre friction: Canudas de Wit and others, IEEE Trans. Automatic Control 40 (1995), p. 419.
    """
    level = p.coulomb_friction_level
    if p.stribeck_friction_level > 0.0:
        relative = speed / p.stribeck_friction_speed
        level += p.stribeck_friction_level * math.exp(-relative * relative)
    return level


@compiled
def dry_friction(p: Record) -> bool:
    """Whether the load can stick."""
    return p.lugre_friction_stiffness == 0.0 and p.coulomb_friction_level + p.stribeck_friction_level > 0.0


@inlined
def settled(p: Record, s: Record) -> bool:
    """Whether bristles bend as far as they do in motion, until the load turns round: as plain friction.

    They bear the friction level to `SETTLED` then.
    """
    if p.stribeck_friction_level > 0.0:
        return False
    bears = s.motion * p.lugre_friction_stiffness * s.bristle
    return abs(bears - p.coulomb_friction_level) <= SETTLED * p.coulomb_friction_level


@inlined
def rates(
    p: Record, s: Record, z: tuple[float, ...], t: float, opened: float
) -> tuple[float, float, float, float, float, float, float]:
    """Time derivatives of the state `z`: the right-hand side of all equations.

    Args:
        p: Parameters.
        s: State, for what stays the same within a substep.
        z: Pressure [unit/s^2], velocity [unit/s] and position [unit], those two of the second inertia, what
            the bristles bend by [unit], reading behind the sensor's lag [unit, or unit/s].
        t: Time [s].
        opened: Opening, in volts of an ideal symmetric valve.

    Returns:
        That of each, per second, in the same order.
    """
    pressure, velocity, position, velocity2, position2, bristle, lagged = z
    since, warmth = t - s.origin, s.warmth
    gain = p.K_L * drifted(p.parameter_drift_K_L, p.parameter_drift_K_L_thermal, since, warmth)
    omega = p.omega_n * drifted(p.parameter_drift_omega_n, p.parameter_drift_omega_n_thermal, since, warmth)
    zeta = p.zeta * drifted(p.parameter_drift_zeta, p.parameter_drift_zeta_thermal, since, warmth)
    speed = flow(p, s, opened, pressure, gain)
    rubs = p.viscous_friction_share * 2.0 * zeta * omega
    leaks = 2.0 * zeta * omega - rubs
    d_pressure = stiffness(p, s) * (omega * omega * (speed - velocity) - leaks * pressure)

    ratio = p.load_resonance_inertia
    coupled = coupling(p, velocity, position, velocity2, position2) if ratio > 0.0 else 0.0
    friction, d_bristle = 0.0, 0.0
    if p.lugre_friction_stiffness > 0.0 and not settled(p, s):
        level = friction_level(p, velocity)
        d_bristle = velocity - p.lugre_friction_stiffness * abs(velocity) / level * bristle
        friction = p.lugre_friction_stiffness * bristle + p.lugre_friction_damping * d_bristle
    elif s.motion != 0.0:
        friction = s.motion * friction_level(p, velocity)
    d_velocity, d_velocity2 = 0.0, coupled
    if s.motion != 0.0 and s.stopped == 0.0:
        d_velocity = (1.0 + ratio) * (
            drive(p, s, t, pressure, position, coupled) - rubs * velocity - friction
        )

    d_lagged = 0.0
    if p.sensor_lag_time > 0.0:
        d_lagged = (seen(p, s, position, velocity) - lagged) / p.sensor_lag_time
    if ratio == 0.0:  # one inertia: the second goes with it
        d_velocity2, velocity2 = d_velocity, velocity
    return d_pressure, d_velocity, velocity, d_velocity2, velocity2, d_bristle, d_lagged


@compiled
def followed(p: Record, s: Record, position: float) -> float:
    """Position behind the backlash [unit], the actuator having come to `position` without turning round."""
    half = 0.5 * p.backlash_gap
    return min(max(s.followed, position - half), position + half)


@compiled
def in_contact(p: Record, s: Record) -> bool:
    """Whether the actuator, as it moves, takes along what is behind the backlash."""
    half, rounding = 0.5 * p.backlash_gap, 1e-15 * abs(s.position)
    return s.motion * (s.position - s.followed) >= half * (1.0 - 1e-9) - rounding


@compiled
def rippled(p: Record, position: float) -> float:
    """Position [unit] with the encoder's eccentricity."""
    if p.position_ripple_amplitude == 0.0:
        return position
    angle = p.position_ripple_wavenumber * position + p.position_ripple_phase
    return position + p.position_ripple_amplitude * math.sin(angle)


@inlined
def bends(p: Record) -> bool:
    """Whether the sensor has a curve."""
    return (
        p.sensor_nonlinearity_order_2 != 0.0
        or p.sensor_nonlinearity_order_3 != 0.0
        or p.sensor_nonlinearity_order_4 != 0.0
        or p.sensor_nonlinearity_order_5 != 0.0
        or p.sensor_nonlinearity_order_6 != 0.0
    )


@inlined
def bend(p: Record, position: float) -> tuple[float, float]:
    """What the sensor's curve adds to a position [unit], and its slope [1]: Legendre polynomials."""
    along = (position - p.sensor_nonlinearity_centre) / p.sensor_nonlinearity_half
    z = min(max(along, -1.0), 1.0)
    z2 = z * z
    z4 = z2 * z2
    a, b, c = p.sensor_nonlinearity_order_2, p.sensor_nonlinearity_order_3, p.sensor_nonlinearity_order_4
    d, e = p.sensor_nonlinearity_order_5, p.sensor_nonlinearity_order_6
    value = a * (1.5 * z2 - 0.5) + b * z * (2.5 * z2 - 1.5) + c * (4.375 * z4 - 3.75 * z2 + 0.375)
    value += d * z * (7.875 * z4 - 8.75 * z2 + 1.875)
    value += e * (14.4375 * z4 * z2 - 19.6875 * z4 + 6.5625 * z2 - 0.3125)
    slope = a * 3.0 * z + b * (7.5 * z2 - 1.5) + c * z * (17.5 * z2 - 7.5)
    slope += d * (39.375 * z4 - 26.25 * z2 + 1.875) + e * z * (86.625 * z4 - 78.75 * z2 + 13.125)
    return value + slope * (along - z), slope / p.sensor_nonlinearity_half


@inlined
def encoded(p: Record, position: float) -> float:
    """What the sensor makes of a position [unit]."""
    return rippled(p, position) + bend(p, position)[0] if bends(p) else rippled(p, position)


@compiled
def sensed(p: Record, s: Record, position: float, velocity: float) -> float:
    """What the sensor sees of a position [unit] or a speed [unit/s], its sign included; in the same unit."""
    behind = followed(p, s, position)
    if not p.measures_speed:
        return encoded(p, behind)
    if p.backlash_gap > 0.0 and not in_contact(p, s):
        return 0.0
    slope = 1.0 + bend(p, behind)[1] if bends(p) else 1.0
    if p.position_ripple_amplitude == 0.0:
        return velocity * slope
    angle = p.position_ripple_wavenumber * behind + p.position_ripple_phase
    return velocity * (slope + p.position_ripple_amplitude * p.position_ripple_wavenumber * math.cos(angle))


@compiled
def rectified(p: Record, value: float) -> float:
    """What the sensor shows of a value that it sees [unit, or unit/s]."""
    if p.rectified_sensor_power != 1.0:
        bent = p.rectified_sensor_range * (abs(value) / p.rectified_sensor_range) ** p.rectified_sensor_power
        value = math.copysign(bent, value)
    return value if value >= 0.0 else (1.0 - 2.0 * p.rectified_sensor_part) * value


@compiled
def seen(p: Record, s: Record, position: float, velocity: float) -> float:
    """What the sensor shows of a position [unit] or a speed [unit/s] without its lag; in the same unit."""
    return rectified(p, sensed(p, s, position, velocity))
