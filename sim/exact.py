"""Steps without any integration error, for plants that are linear from one event to the next.

Oil and load, da/dt = omega_n^2 (q - v) - 2 zeta omega_n a and dv/dt = a + b, have a solution in closed form
where the load's further acceleration b is constant and the flow q is constant or fades with the spool's lag.
`sim.parameters.is_linear` tells which plants these are.
"""

from __future__ import annotations

import math

from sim import physics
from sim.compiled import Record, compiled

SAME = 1e-10
"""Part by which two steps may differ in length and have the same factors: a recording's rows differ by the
rounding of their times."""

COST = 0.25
"""Of a step, over a Runge-Kutta step. Measured: 17 ns in place of 65 (`bench/kernel.py`)."""


@compiled
def step(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, ...]:
    """The state `h` [s] after `z`, in its order (`physics.rates`); no event is within."""
    pressure, velocity, position, velocity2, position2, bristle, lagged = z
    flow, fading, rate, gone = _flow(p, s, h)
    square, damping = p.omega_n * p.omega_n, p.zeta * p.omega_n
    if s.motion == 0.0 or s.stopped != 0.0:
        settles = -math.expm1(-2.0 * damping * h)
        after = pressure + (square * flow / (2.0 * damping) - pressure) * settles
        if fading != 0.0:
            after += square * fading * (gone - 1.0 + settles) / (2.0 * damping - rate)
        return after, velocity, position, velocity2, position2, bristle, lagged

    push = physics.drive(p, s, s.t, 0.0, position, 0.0) - s.motion * physics.friction_level(p, velocity)
    ends = flow + 2.0 * damping * push / square
    swept = ends * h
    off, pull = velocity - ends, pressure + push
    if fading != 0.0:
        lags = square * fading / (rate * (rate - 2.0 * damping) + square)
        off, pull = off - lags, pull + rate * lags
        ends, swept = ends + lags * gone, swept + lags * (1.0 - gone) / rate
        push += rate * lags * gone
    even, odd, area = _factors(p, s, h)
    after = (even - damping * odd) * pull - square * odd * off - push
    speeds = ends + (even + damping * odd) * off + odd * pull
    goes = swept + (odd + 2.0 * damping * area) * off + area * pull
    second = velocity2 + (speeds - velocity), position2 + goes
    return after, speeds, position + goes, *second, bristle, lagged


@compiled
def _flow(p: Record, s: Record, h: float) -> tuple[float, float, float, float]:
    """Flow through the valve: what stays, what fades [unit/s], how fast [1/s], what of it is left then."""
    lag = p.valve_lag_time
    if lag == 0.0:
        return p.K_L * physics.opening(p, s.target), 0.0, 0.0, 0.0
    off, halfway = s.spool - s.target, math.exp(-0.5 * h / lag)
    middle = s.target + off * halfway
    fading = physics.opens(p, middle) * off
    stays = physics.opening(p, middle) - fading * halfway
    return p.K_L * stays, p.K_L * fading, 1.0 / lag, halfway * halfway


@compiled
def _factors(p: Record, s: Record, h: float) -> tuple[float, float, float]:
    """`physics.oscillation` of the load, and the area under its second; kept for two lengths of step.

    Rows that come in step, and a delay that cuts each of them in two, need no more.
    """
    if p.omega_n != s.kept_omega_n or p.zeta != s.kept_zeta:
        s.kept_omega_n, s.kept_zeta = p.omega_n, p.zeta
        s.kept_h, s.spare_h = 0.0, 0.0
    if abs(h - s.kept_h) <= SAME * h:
        return s.kept_even, s.kept_odd, s.kept_area
    if abs(h - s.spare_h) <= SAME * h:
        return s.spare_even, s.spare_odd, s.spare_area
    s.spare_h, s.spare_even, s.spare_odd, s.spare_area = s.kept_h, s.kept_even, s.kept_odd, s.kept_area
    s.kept_h = h
    s.kept_even, s.kept_odd, s.kept_area = _made(p, h)
    return s.kept_even, s.kept_odd, s.kept_area


@compiled
def _made(p: Record, h: float) -> tuple[float, float, float]:
    square, damping = p.omega_n * p.omega_n, p.zeta * p.omega_n
    even, odd = physics.oscillation(damping, square, h)
    return even, odd, (1.0 - even - damping * odd) / square
