"""Steps without any integration error, for plants that are linear from one event to the next.

Oil and load, da/dt = omega_n^2 (q - v) - 2 zeta omega_n a and dv/dt = a + b, have a solution in closed form
where the flow q and the load's further acceleration b are constant. `sim.parameters.is_linear` tells which
plants these are. All that a step changes is written as a change: what rounding does to it vanishes with its
length, as a relay without hysteresis that begins at its threshold needs it.
"""

from __future__ import annotations

import math

from sim import physics
from sim.compiled import Record, compiled

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
    square, leaks = p.omega_n * p.omega_n, 2.0 * p.zeta * p.omega_n
    if s.motion == 0.0 or s.stopped != 0.0:
        settles = -math.expm1(-leaks * h)
        after = pressure + (square * flow / leaks - pressure) * settles
        return after, velocity, position, velocity2, position2, bristle, lagged

    push = physics.drive(p, s, s.t, 0.0, position, 0.0) - s.motion * physics.friction_level(p, velocity)
    pull = pressure + push
    off = square * (velocity - flow) - leaks * push
    answer, area, volume = _factors(p, s, h)
    faster = answer * pull - area * off
    goes = velocity * h + area * pull - volume * off
    after = pressure - (square * area + leaks * answer) * pull - answer * off
    return after, velocity + faster, position + goes, velocity2 + faster, position2 + goes, bristle, lagged


@compiled
def _factors(p: Record, s: Record, h: float) -> tuple[float, float, float]:
    """The load's answer to an impulse [s], its integral [s^2], and that one's; kept for two lengths of step.

    Rows that come in step, and a delay that cuts each of them in two, need no more.
    """
    if p.omega_n != s.kept_omega_n or p.zeta != s.kept_zeta:
        s.kept_omega_n, s.kept_zeta = p.omega_n, p.zeta
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
    s.kept_answer, s.kept_area, s.kept_volume = factors(p.omega_n * p.omega_n, p.zeta * p.omega_n, h)
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
