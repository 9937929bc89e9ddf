"""The physics of a hydraulic plant, as rates of change: orifices, oil, supply, load. Compiled.

The equations are those of `docs/hydraulics.md`.

Pressures are above atmosphere [Pa], flows in m^3/s, the spool's opening in the volts that it answers to.
"""

from __future__ import annotations

import math

from sim.compiled import Record, inlined

ATMOSPHERE = 101325.0
"""[Pa]"""
LEAST_ABSOLUTE = 1000.0
"""Least absolute pressure for which the oil's stiffness is computed [Pa]."""
LEAST_VOLUME = 0.02
"""Least part of a chamber's volume that is left at the end of a cylinder's way."""

NEAR = 0.3
"""Part by which pressures may differ for `near`."""
KEPT = 0.1
"""Part by which a pressure may have moved before its `near` begins anew: until then it is right to 2e-8."""
CRANK_NEAR = 2e-3
"""Angle [rad] by which a crank may have turned from where `stroke_near` stands: right to 2e-9 until then."""

X, DX, PA, PB, W, Y, W2, Y2, PS, SEEN = range(10)
"""Places in the tuple that is integrated: spool, chambers, load, second inertia, supply, sensor's lag."""


@inlined
def bulk_modulus(p: Record, pressure: float) -> float:
    """Of oil with entrained air [Pa] at a pressure [Pa]: oil and air as springs in series.

    The air follows a polytropic law, its volume at atmosphere being a part of the oil's.
    """
    if p.oil_air == 0.0:
        return p.oil_bulk_modulus
    absolute = max(pressure + ATMOSPHERE, LEAST_ABSOLUTE)
    part = p.oil_air * math.exp(math.log(ATMOSPHERE / absolute) / p.oil_polytropic)
    return (
        p.oil_bulk_modulus * (1.0 + part) / (1.0 + part * p.oil_bulk_modulus / (p.oil_polytropic * absolute))
    )


@inlined
def near(p: Record, pressure: float, base: float, inverse: float, part: float) -> tuple[float, float]:
    """`bulk_modulus` near an absolute pressure: a numerator and a denominator, whose ratio is in Pa.

    The power of the pressures' ratio is taken by its Pade approximation: to 1e-5 within -30 and +40 %.
    Farther off it is taken as it is.

    Args:
        p: Parameters.
        pressure: Above atmosphere [Pa].
        base: Absolute pressure about which it is expanded [Pa].
        inverse: 1 over that [1/Pa].
        part: Of the volume that is air there [1].
    """
    if part == 0.0:
        return p.oil_bulk_modulus, 1.0
    absolute = max(pressure + ATMOSPHERE, LEAST_ABSOLUTE)
    off = (absolute - base) * inverse
    if abs(off) > NEAR:
        return bulk_modulus(p, pressure), 1.0
    n, b = p.oil_polytropic, p.minus_inverse_polytropic
    up = 1.0 + off * (0.5 * (2.0 + b) + off * ((2.0 + b) * (1.0 + b) * (1.0 / 12.0)))
    down = 1.0 + off * (0.5 * (2.0 - b) + off * ((2.0 - b) * (1.0 - b) * (1.0 / 12.0)))
    air, oil = part * up, n * absolute
    return p.oil_bulk_modulus * (down + air) * oil, oil * down + air * p.oil_bulk_modulus


@inlined
def airy(p: Record, pressure: float, base: float, inverse: float, part: float) -> tuple[float, float, float]:
    """Absolute pressure for `near` [Pa], 1 over it, the part that is air there: the old while it is near."""
    absolute = max(pressure + ATMOSPHERE, LEAST_ABSOLUTE)
    if abs(absolute - base) <= KEPT * base:
        return base, inverse, part
    if p.oil_air == 0.0:
        return absolute, 1.0 / absolute, 0.0
    power = math.exp(p.minus_inverse_polytropic * math.log(absolute / ATMOSPHERE))
    return absolute, 1.0 / absolute, p.oil_air * power


@inlined
def through(p: Record, drop: float) -> float:
    """Signed root [Pa^0.5] of a pressure drop [Pa], as turbulent flow through an orifice goes.

    Below `valve.laminar` a cubic that meets it in value and slope.
    """
    if drop >= p.valve_laminar:
        return math.sqrt(drop)
    if drop <= -p.valve_laminar:
        return -math.sqrt(-drop)
    part = drop / p.valve_laminar
    return math.sqrt(p.valve_laminar) * part * (1.25 - 0.25 * part * part)


@inlined
def opening(p: Record, spool: float) -> float:
    """Of the valve [V] at a place of its spool [V]: null and overlap taken away, ports unequal."""
    from_null = spool - p.valve_null_bias
    if from_null > p.valve_overlap:
        return (from_null - p.valve_overlap) * (1.0 + p.valve_asymmetry)
    if from_null < -p.valve_overlap:
        return (from_null + p.valve_overlap) * (1.0 - p.valve_asymmetry)
    return 0.0


@inlined
def ports(p: Record, s: Record, spool: float, ps: float, pa: float, pb: float) -> tuple[float, float, float]:
    """Flows into chamber a, into chamber b, and out of the supply [m^3/s].

    Args:
        p: Parameters.
        s: State; its conductance counts.
        spool: Where it is [V].
        ps: Supply pressure [Pa].
        pa: Of chamber a [Pa].
        pb: Of chamber b [Pa].
    """
    o, c, tank = opening(p, spool), p.clearance, p.supply_tank
    if c == 0.0:
        if o == 0.0:
            return 0.0, 0.0, 0.0
        k = s.conductance * o
        if o > 0.0:
            fed = k * through(p, ps - pa)
            return fed, -k * through(p, pb - tank), fed
        fed = -k * through(p, ps - pb)
        return k * through(p, pa - tank), fed, fed
    forth, back = s.conductance * (max(o, 0.0) + c), s.conductance * (max(-o, 0.0) + c)
    to_a, to_b = forth * through(p, ps - pa), back * through(p, ps - pb)
    from_a, from_b = back * through(p, pa - tank), forth * through(p, pb - tank)
    return to_a - from_a, to_b - from_b, to_a + to_b


@inlined
def stroke(p: Record, y: float) -> tuple[float, float]:
    """Of a cylinder [m] from the middle of its way at a position `y` [unit], and its change [m/unit].

    Behind a crank by the law of cosines.
    """
    if p.cylinder_arm == 0.0:
        return y, 1.0
    angle, both = p.crank_angle + y, p.cylinder_base * p.cylinder_arm
    now = math.sqrt(p.crank_square - 2.0 * both * math.cos(angle))
    return now - p.cylinder_length, both * math.sin(angle) / now


@inlined
def expand_stroke(p: Record, s: Record) -> None:
    """Have `stroke_near` stand where the load is."""
    both = p.cylinder_base * p.cylinder_arm
    way, s.lever = stroke(p, s.position)
    s.crank_at, s.way = s.position, way
    inverse = 1.0 / (way + p.cylinder_length)
    s.lever_1 = (both * math.cos(p.crank_angle + s.position) - s.lever * s.lever) * inverse
    s.lever_2 = -s.lever * (1.0 + 3.0 * s.lever_1 * inverse)


@inlined
def stroke_near(p: Record, s: Record, y: float) -> tuple[float, float]:
    """`stroke` at a position `y` [unit]; close to where `expand_stroke` was asked by a Taylor series."""
    if p.cylinder_arm == 0.0:
        return y, 1.0
    off = y - s.crank_at
    if abs(off) > CRANK_NEAR:
        return stroke(p, y)
    lever = s.lever + off * (s.lever_1 + off * 0.5 * s.lever_2)
    return s.way + off * (s.lever + off * (0.5 * s.lever_1 + off * (1.0 / 6.0) * s.lever_2)), lever


@inlined
def friction_level(p: Record, w: float) -> float:
    """Dry friction at a speed `w` [unit/s], without its sign [N unit]."""
    if p.load_stribeck == 0.0:
        return p.load_coulomb
    ratio = w / p.load_stribeck_speed
    return p.load_coulomb + p.load_stribeck * math.exp(-ratio * ratio)


@inlined
def set_pressure(p: Record, s: Record, t: float) -> float:
    """Of a stiff supply at `t` [s], and of the relief valve without ripple [Pa]."""
    level = p.supply_pressure * s.supply
    if p.supply_droop == 0.0 and p.supply_ripple > 0.0:
        level *= 1.0 + p.supply_ripple * math.sin(p.supply_ripple_omega * (t - s.origin))
    return level


@inlined
def fed(p: Record, s: Record, t: float) -> float:
    """What the supply has from outside at `t` [s].

    Returns:
        The pump's flow [m^3/s], or where the supply is stiff its pressure [Pa].
    """
    if p.supply_droop == 0.0:
        return set_pressure(p, s, t)
    if p.supply_ripple == 0.0:
        return p.supply_flow
    return p.supply_flow * (1.0 + p.supply_ripple * math.sin(p.supply_ripple_omega * (t - s.origin)))


@inlined
def shaken(p: Record, s: Record, t: float) -> float:
    """A periodic force on the load at `t` [s], positive the way that it moves [N unit]."""
    if p.load_shake == 0.0:
        return 0.0
    return p.load_shake * math.sin(p.load_shake_omega * (t - s.origin) + p.load_shake_phase)


@inlined
def force(p: Record, y: float) -> float:
    """On the load at a position `y` [unit] against positive movement: weight and spring [N unit]."""
    if p.load_spring == 0.0:
        return p.load_force
    return p.load_force + p.load_spring * (y - p.load_spring_centre)


@inlined
def encoded(p: Record, y: float) -> float:
    """A position [unit] as an eccentric encoder, or the ripple of a converter, has it."""
    if p.position_ripple_amplitude == 0.0:
        return y
    return y + p.position_ripple_amplitude * math.sin(
        p.position_ripple_wavenumber * y + p.position_ripple_phase
    )


@inlined
def seen(p: Record, y: float, w: float) -> float:
    """What the sensor sees before its lag [unit, or unit/s]; `y` is the position [unit], `w` the speed."""
    if p.measures_speed == 0.0:
        return encoded(p, y)
    if p.position_ripple_amplitude == 0.0:
        return w
    wave = p.position_ripple_wavenumber
    return w * (1.0 + p.position_ripple_amplitude * wave * math.cos(wave * y + p.position_ripple_phase))


@inlined
def drive(p: Record, s: Record, z: tuple[float, ...], shake: float) -> float:
    """Force that would accelerate the first inertia but for dry friction [N unit].

    Args:
        p: Parameters.
        s: State, about which a crank is expanded.
        z: Numbers that are integrated, by `X` to `SEEN`.
        shake: `shaken` [N unit].
    """
    return drive_by(p, z, shake, 1.0 if p.rotary != 0.0 else stroke_near(p, s, z[Y])[1])


@inlined
def drive_by(p: Record, z: tuple[float, ...], shake: float, lever: float) -> float:
    """`drive` where the lever [m/unit] is known."""
    found = lever * (p.area_a * z[PA] - p.area_b * z[PB]) - p.load_viscous * z[W] - force(p, z[Y]) + shake
    if p.load_second > 0.0:
        found -= p.load_inertia * p.load_second / (1.0 + p.load_second) * _pull(p, z)
    return found


@inlined
def _pull(p: Record, z: tuple[float, ...]) -> float:
    """Acceleration of the second inertia."""
    omega = p.load_second_omega
    return omega * omega * (z[Y] - z[Y2]) + 2.0 * p.load_second_zeta * omega * (z[W] - z[W2])


@inlined
def rates(p: Record, s: Record, z: tuple[float, ...], feed: float, shake: float) -> tuple[float, ...]:
    """Rates of change of `z`; a load that sticks or lies at a stop (`s.motion` 0) stays.

    Args:
        p: Parameters.
        s: State, for what stays the same within a step.
        z: Numbers that are integrated, by `X` to `SEEN`: units as in `motion.STATE`.
        feed: `fed` at this instant [m^3/s, or Pa].
        shake: `shaken` at this instant [N unit].

    Returns:
        That of each, per second, in the same order.
    """
    dx = min(max(z[DX], -p.valve_rate), p.valve_rate)
    ddx = p.valve_omega * (p.valve_omega * (s.target - z[X]) - 2.0 * p.valve_zeta * dx)
    pa, pb, w = z[PA], z[PB], z[W]
    ps = z[PS] if p.supply_droop > 0.0 else feed
    qa, qb, qs = ports(p, s, z[X], ps, pa, pb)
    lever, va, vb = 1.0, p.volume_a, p.volume_b
    if p.rotary == 0.0:
        way, lever = stroke_near(p, s, z[Y])
        va = max(va + p.area_a * way, LEAST_VOLUME * va)
        vb = max(vb - p.area_b * way, LEAST_VOLUME * vb)
    across, outside = s.thinner * p.leakage_cross * (pa - pb), s.thinner * p.leakage_external
    speed = lever * w
    over, under = near(p, pa, s.absolute_a, s.inverse_a, s.air_a)
    dpa = over / (under * va) * (qa - p.area_a * speed - across - outside * (pa - p.supply_tank))
    over, under = near(p, pb, s.absolute_b, s.inverse_b, s.air_b)
    dpb = over / (under * vb) * (qb + p.area_b * speed + across - outside * (pb - p.supply_tank))
    if pa <= p.oil_vapour and dpa < 0.0:
        dpa = 0.0
    if pb <= p.oil_vapour and dpb < 0.0:
        dpb = 0.0
    dw = 0.0
    if s.motion != 0.0:
        push = drive_by(p, z, shake, lever) - s.motion * friction_level(p, w)
        dw = (1.0 + p.load_second) / p.load_inertia * push
    dw2, dy2 = 0.0, 0.0
    if p.load_second > 0.0:
        dw2, dy2 = _pull(p, z), z[W2]
    dps = 0.0
    if p.supply_droop > 0.0:
        dps = _supply(p, s, ps, feed, qs)
    lag = 0.0
    if p.sensor_lag_time > 0.0:
        lag = (seen(p, z[Y], w) - z[SEEN]) / p.sensor_lag_time
    return dx, ddx, dpa, dpb, dw, w, dw2, dy2, dps, lag


@inlined
def _supply(p: Record, s: Record, ps: float, pumped: float, demand: float) -> float:
    """Rate of the supply pressure: pump, relief valve, demand."""
    cracks = p.supply_pressure * s.supply - p.supply_droop * p.supply_flow
    relieved = max(0.0, ps - cracks) * p.relief
    over, under = near(p, ps, s.absolute_s, s.inverse_s, s.air_s)
    return over / (under * p.supply_volume) * (pumped - demand - relieved)
