"""Simulation of windows of a recording: the valve from the recording's start, the load anew in each window.

What the command does before it acts on the load (delay, saturation, hysteresis, the spool's lag) depends on
the command alone, which is known from the start. Where the load was when a window began is not: it is given.
"""

from __future__ import annotations

import math

import numpy as np

from sim.compiled import Record, compiled, inlined
from sim.kernel import advance, command, measured, move_spool
from sim.physics import dry_friction, encoded, friction_level, rectified, spool_forgets

Array = np.ndarray

MEMORY = 40.0
"""Time constants after which nothing of a spool's place is left: less than a double's rounding."""
START = ("pressure", "velocity", "position", "velocity2", "position2", "lagged", "loose")
"""Columns of a window's initial state: as in `sim.state`, but the second inertia's relative to the first, and
what is behind the sensor's lag relative to where it would be had the speed been steady; the last is how far
the load is from the flank of its play that it runs against, or its bristles from bending as far as they do in
motion [unit]."""
INSIDE = ("pressure", "velocity", "position", "followed", "loose")
"""Columns of what is inside: the load's state, its position behind the play, the last as in `START`."""


@compiled
def follow_windows(
    plant: Array,
    valve: Array,
    load: Array,
    t_u: Array,
    u: Array,
    t: Array,
    supply: Array,
    warmth: Array,
    force: Array,
    first: Array,
    last: Array,
    start: Array,
    limit: float,
    y: Array,
    inside: Array,
) -> None:
    """What is measured in each window under the commands `u` [V] that left at `t_u` [s].

    Args:
        plant: Its record, shape (1,). An array, as a record given by itself takes microseconds to unpack.
        valve: A state at rest at or before the first time, shape (1,): the valve's.
        load: A state at rest, likewise: the load's; both are used up.
        t_u: Ascending [s], shape (m,).
        u: [V], shape (m,).
        t: Times of samples [s], ascending, shape (n,).
        supply: Supply pressure over nominal, shape (n,) or (0,).
        warmth: Temperature above nominal [K], shape (n,) or (0,).
        force: What is measured of a disturbance, shape (n,) or (0,).
        first: First row of each window, ascending, shape (w,).
        last: Row after its last, at most the next window's first.
        start: Initial states, `START`, shape (w, 7).
        limit: A reading beyond it [unit] ends its window's simulation, and stands for all that follow: an
            unstable plant asks for ever shorter substeps.
        y: Without noise and quantisation, filled here, shape (n,); other rows are left alone.
        inside: `INSIDE`, filled likewise, shape (n, 5) or (0, 5).
    """
    p, v, s = plant[0], valve[0], load[0]
    reached = 0
    for w in range(len(first)):
        reached = _valve(p, v, t_u, u, reached, t[first[w]])
        _begin(p, v, s, start[w])
        given, held = reached, math.nan
        for k in range(first[w], last[w]):
            # written out, as in `sim.runs`: each array that is handed on costs two locked instructions a row
            if len(supply):
                s.supply = supply[k]
            if len(warmth):
                s.warmth = warmth[k]
            if len(force):
                s.force = force[k]
            while given < len(u) and t_u[given] + p.transport_delay_time <= t[k]:
                _arrive(p, s, t_u[given] + p.transport_delay_time, u[given], held)
                held = u[given]
                given += 1
            advance(p, s, t[k])
            y[k] = measured(p, s)
            if len(inside):
                inside[k, 0], inside[k, 1] = s.pressure, s.velocity
                inside[k, 2], inside[k, 3] = s.position, s.followed
                inside[k, 4] = _loose(p, s)
            if not abs(y[k]) <= limit:
                y[k : last[w]] = y[k]
                if len(inside):
                    inside[k : last[w]] = inside[k]
                break


@compiled
def _valve(p: Record, v: Record, t_u: Array, u: Array, reached: int, t: float) -> int:
    """Have the commands that reach the valve by `t` act on it; returns how many have by then."""
    reached = _forgotten(p, t_u, reached, t)
    while reached < len(u) and t_u[reached] + p.transport_delay_time <= t:
        _spool(p, v, t_u[reached] + p.transport_delay_time)
        command(p, v, u[reached])
        reached += 1
    _spool(p, v, t)
    return reached


@compiled
def _forgotten(p: Record, t_u: Array, reached: int, t: float) -> int:
    """The first command, from `reached` on, that the valve's state at `t` depends on.

    Play forgets none, nor does a spool of limited speed, which may never reach its target.
    """
    if p.valve_hysteresis_half_width > 0.0 or p.valve_rate_limit_rate < math.inf:
        return reached
    since = t - p.transport_delay_time - MEMORY * spool_forgets(p)
    return max(reached, np.searchsorted(t_u, since, "right") - 1)


@compiled
def _spool(p: Record, v: Record, t: float) -> None:
    if t > v.t:
        move_spool(p, v, t - v.t)
        v.t = t


@compiled
def _begin(p: Record, v: Record, s: Record, start: Array) -> None:
    """A window's first state."""
    s.t, s.target, s.spool, s.spool_speed = v.t, v.target, v.spool, v.spool_speed
    s.pressure, s.velocity, s.position = start[0], start[1], start[2]
    s.velocity2, s.position2 = s.velocity + start[3], s.position + start[4]
    s.motion = -1.0 if s.velocity < 0.0 else 1.0
    if s.velocity == 0.0 and dry_friction(p):
        s.motion = 0.0
    s.stopped = s.bristle = 0.0
    if p.lugre_friction_stiffness > 0.0 and s.velocity != 0.0:
        bent = friction_level(p, s.velocity) / p.lugre_friction_stiffness
        s.bristle = s.motion * (bent - min(max(start[6], 0.0), 2.0 * bent))
    loose = min(max(start[6], 0.0), p.backlash_gap)
    s.followed = s.position - math.copysign(1.0, s.velocity) * (0.5 * p.backlash_gap - loose)
    steady = s.velocity - p.sensor_lag_time * s.pressure
    if not p.measures_speed:
        steady = encoded(p, s.followed) - p.sensor_lag_time * s.velocity
    s.lagged = rectified(p, steady) + start[5]


@inlined
def _arrive(p: Record, s: Record, t: float, volts: float, held: float) -> None:
    """Have a command act on the plant from `t` [s] on; the one that is held changes nothing."""
    if volts != held:
        advance(p, s, max(s.t, t))
        command(p, s, volts)


@compiled
def _loose(p: Record, s: Record) -> float:
    """How far the load is from the flank that it runs against, or its bristles from their bend in motion."""
    way = math.copysign(1.0, s.velocity)
    if p.lugre_friction_stiffness > 0.0:
        return friction_level(p, s.velocity) / p.lugre_friction_stiffness - way * s.bristle
    return 0.5 * p.backlash_gap - way * (s.position - s.followed)
