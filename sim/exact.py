"""Steps without any integration error, for plants that are linear from one event to the next, or for a while.

Oil and load, da/dt = omega_n^2 (q - v) - l a and dv/dt = a + b - r v, with l + r = 2 zeta omega_n of leakage
and viscous friction, have a solution in closed form where the flow q is constant or fades towards a constant,
and the load's further acceleration b is constant or swings. `sim.parameters.linear_at_times` tells which
plants these are. All that a step changes is written as a change: what rounding does to it vanishes with its
length, as a relay without hysteresis that begins at its threshold needs it.
"""

from __future__ import annotations

import math

from sim import physics
from sim.compiled import Record, compiled, inlined

SAME = 1e-10
"""Part by which two steps may differ in length and have the same factors: a recording's rows differ by the
rounding of their times."""

SMALL = 0.1
"""Angle of a step up to which its factors are power series: above, their closed forms lose three digits at
most."""

TERMS = 12
"""Of the series: at that angle the next is less than a double's rounding."""

COST = 0.25
"""Of a step, over a Runge-Kutta step. Measured: 17 ns in place of 65 (`bench/kernel.py`)."""

PASSED = 4.0
"""Speed over Stribeck's from which on the friction no longer falls: by 1e-7 of its level at most."""


@inlined
def linear_now(p: Record, s: Record, velocity: float) -> bool:
    """Whether oil and load are linear at this speed [unit/s], in a plant that need not always be so.

    Friction has fallen as far as it does, bristles have settled. A spool of limited speed has arrived, and
    one with a lag passes no edge of its overlap.
    """
    if p.linear != 0.0:
        return True
    if s.motion * velocity < PASSED * p.stribeck_friction_speed and p.stribeck_friction_level > 0.0:
        return False
    if p.lugre_friction_stiffness > 0.0 and not physics.settled(p, s):
        return False
    if p.valve_lag_time > 0.0:
        return _on_one_side(p, s)
    return bool(p.valve_rate_limit_rate == math.inf or s.spool == s.target)


@compiled
def _on_one_side(p: Record, s: Record) -> bool:
    """Whether the spool's flow has no kink between where it is and where it goes."""
    if p.static_valve_map_at_ports != 0.0:  # what it opens is no part of its way
        return False
    edge = p.valve_deadband_half_width
    if edge == 0.0 and p.asymmetric_gain_ratio == 0.0:
        return True
    low, high = min(s.spool, s.target) - p.null_shift_voltage, max(s.spool, s.target) - p.null_shift_voltage
    return bool(low >= edge or high <= -edge or (low >= -edge and high <= edge))


@compiled
def step(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, ...]:
    """The state `h` [s] after `z`; no event is within.

    Args:
        p: Parameters of a plant that is linear from event to event.
        s: State at the beginning.
        z: As `physics.rates` takes it, in its order and units.
        h: Length [s].

    Returns:
        The same at the end.
    """
    pressure, velocity, position, velocity2, position2, bristle, lagged = z
    flow = p.K_L * physics.opening(p, s.target)
    leaks, rubs, square = damped(p)
    if s.motion == 0.0 or s.stopped != 0.0:
        rises = p.omega_n * p.omega_n * flow - leaks * pressure
        after = pressure + rises * (-math.expm1(-leaks * h) / leaks if leaks > 0.0 else h)
        return after, velocity, position, velocity2, position2, bristle, lagged

    push = physics.steady_drive(p, s, s.t, 0.0, position) - s.motion * physics.friction_level(p, velocity)
    answer, area, volume = _factors(p, s, h)
    driven = (0.0, 0.0, 0.0, 0.0, 0.0)
    if p.periodic_disturbance_amplitude != 0.0 or p.valve_lag_time > 0.0:
        driven = _driven(p, s, flow, h)
    apart = velocity - driven[1]
    pull = pressure - driven[0] + push - rubs * apart
    off = square * apart - p.omega_n * p.omega_n * flow - leaks * push
    faster = answer * pull - area * off
    goes = apart * h + area * pull - volume * off + driven[4]
    after = pressure - (square * area + (leaks + rubs) * answer) * pull - answer * off
    after += rubs * faster + driven[2]
    faster += driven[3]
    return after, velocity + faster, position + goes, velocity2 + faster, position2 + goes, bristle, lagged


@compiled
def damped(p: Record) -> tuple[float, float, float]:
    """Leakage and viscous friction [1/s], and the frequency squared [rad^2/s^2] of both together."""
    damping = 2.0 * p.zeta * p.omega_n
    rubs = p.viscous_friction_share * damping
    return damping - rubs, rubs, p.omega_n * p.omega_n + (damping - rubs) * rubs


@compiled
def _driven(p: Record, s: Record, flow: float, h: float) -> tuple[float, float, float, float, float]:
    """How the load moves by what changes within a step, and always did.

    Returns:
        Pressure [unit/s^2] and speed [unit/s] now, and what `h` [s] add to pressure, speed and position
        [unit].
    """
    if p.valve_lag_time == 0.0:
        return _swing(p, s, h)
    a = _fade(p, s, flow, h)
    if p.periodic_disturbance_amplitude == 0.0:
        return a
    b = _swing(p, s, h)
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4]


@compiled
def _swing(p: Record, s: Record, h: float) -> tuple[float, float, float, float, float]:
    """`_driven` by a disturbance of amplitude A at omega w.

    v = A (l + j w) / (omega_n^2 + l r - w^2 + j (l + r) w), its integral, and a = (j w + r) v - A: imaginary
    parts of these times exp(j angle).
    """
    w, amplitude = p.periodic_disturbance_omega, p.periodic_disturbance_amplitude
    leaks, rubs, square = damped(p)
    below, lost = square - w * w, (leaks + rubs) * w
    each = amplitude / (below * below + lost * lost)
    along, ahead = each * (leaks * below + w * lost), each * (w * below - leaks * lost)
    half = 0.5 * w * h
    middle = w * (s.t - s.origin) + p.periodic_disturbance_phase + half
    sine, cosine, odd, even = math.sin(middle), math.cos(middle), math.sin(half), math.cos(half)
    begins, level = sine * even - cosine * odd, cosine * even + sine * odd
    rises, falls = 2.0 * odd * cosine, -2.0 * odd * sine
    pushed, held = rubs * along - w * ahead - amplitude, rubs * ahead + w * along
    return (
        pushed * begins + held * level,
        along * begins + ahead * level,
        pushed * rises + held * falls,
        along * rises + ahead * falls,
        (ahead * rises - along * falls) / w,
    )


@compiled
def _fade(p: Record, s: Record, flow: float, h: float) -> tuple[float, float, float, float, float]:
    """`_driven` by a flow that fades to `flow` [unit/s] by the spool's lag T.

    What it has too much, q, fades as exp(-t / T).
    v = omega_n^2 q / (1 / T^2 - (l + r) / T + omega_n^2 + l r), its integral, and a = (r - 1 / T) v.
    """
    leaks, rubs, square = damped(p)
    rate = 1.0 / p.valve_lag_time
    excess = p.K_L * physics.opening(p, s.spool) - flow
    velocity = p.omega_n * p.omega_n * excess / (rate * (rate - leaks - rubs) + square)
    gone = math.expm1(-rate * h)
    faster = velocity * gone
    return (rubs - rate) * velocity, velocity, (rubs - rate) * faster, faster, -p.valve_lag_time * faster


@compiled
def _factors(p: Record, s: Record, h: float) -> tuple[float, float, float]:
    """The load's answer to an impulse [s], its integral [s^2], and that one's; kept for two lengths of step.

    Rows that come in step, and a delay that cuts each of them in two, need no more.
    """
    leaks, rubs, square = damped(p)
    if square != s.kept_square or leaks + rubs != s.kept_damping:
        s.kept_square, s.kept_damping = square, leaks + rubs
        s.kept_h, s.spare_h = 0.0, 0.0
    if abs(h - s.kept_h) <= SAME * h:
        return s.kept_answer, s.kept_area, s.kept_volume
    if abs(h - s.spare_h) <= SAME * h:
        return s.spare_answer, s.spare_area, s.spare_volume
    s.spare_h, s.spare_answer, s.spare_area, s.spare_volume = (
        s.kept_h,
        s.kept_answer,
        s.kept_area,
        s.kept_volume,
    )
    s.kept_h = h
    s.kept_answer, s.kept_area, s.kept_volume = factors(square, 0.5 * (leaks + rubs), h)
    return s.kept_answer, s.kept_area, s.kept_volume


@compiled
def factors(square: float, d: float, h: float) -> tuple[float, float, float]:
    """At `h` the f with f'' + 2 d f' + square f = 0, f(0) = 0 and f'(0) = 1, its integral, and that one's.

    Args:
        square: Natural frequency squared [rad^2/s^2].
        d: Half the damping [1/s].
        h: Time [s].

    Returns:
        In s, s^2 and s^3.
    """
    if h * (2.0 * d + math.sqrt(square)) < SMALL:
        return _series(square, d, h)
    even, odd = physics.oscillation(d, square, h)
    area = (1.0 - even - d * odd) / square
    return odd, area, (h - odd - 2.0 * d * area) / square


@compiled
def _series(square: float, d: float, h: float) -> tuple[float, float, float]:
    answer, area, volume = 0.0, 0.0, 0.0
    before, now, power = 0.0, 1.0, h  # derivatives at 0, and h^n / n!
    for n in range(1, TERMS):
        answer += now * power
        area += now * power * h / (n + 1.0)
        volume += now * power * h * h / ((n + 1.0) * (n + 2.0))
        before, now = now, -2.0 * d * now - square * before
        power *= h / (n + 1.0)
    return answer, area, volume
