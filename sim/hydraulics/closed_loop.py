"""Whole runs of the physical plant: given commands, or a sampled relay. Both release the GIL.

Timing is that of recordings: row k has the time t[k], y[k] sampled then, and u[k] computed from it, which
leaves at t_u[k]. Arrays `supply`, `warmth` and `noise` have an element a row, or none.
"""

from __future__ import annotations

import math

import numpy as np

from sim.compiled import Record, compiled, inlined
from sim.hydraulics.motion import advance, command, measured, quantized, surroundings

Array = np.ndarray

INSIDE = ("pressure_a", "pressure_b", "pressure_s", "velocity", "position", "spool")
"""Columns of what `follow` and `relay` show of the inside, where they are given room for it."""


@compiled
def reach(p: Record, s: Record, t_u: Array, u: Array, given: int, made: int, t: float) -> int:
    """Come to `t` [s] with each command acting at its time; returns how many have acted."""
    while given < made and t_u[given] + p.valve_delay <= t:
        advance(p, s, max(s.t, t_u[given] + p.valve_delay))
        command(p, s, u[given])
        given += 1
    advance(p, s, t)
    return given


@compiled
def around(p: Record, s: Record, supply: Array, warmth: Array, k: int) -> None:
    """Have the surroundings of row `k`."""
    if len(supply) or len(warmth):
        now = supply[k] if len(supply) else s.supply
        warm = warmth[k] if len(warmth) else s.warmth
        if now != s.supply or warm != s.warmth:
            surroundings(p, s, now, warm)


@compiled
def look(p: Record, s: Record, noise: Array, inside: Array, k: int) -> float:
    """Reading of row `k`; what is inside goes into `inside`, shape (n, 6) or (0, 6)."""
    if len(inside):
        inside[k, 0], inside[k, 1], inside[k, 2] = s.pressure_a, s.pressure_b, s.pressure_s
        inside[k, 3], inside[k, 4], inside[k, 5] = s.velocity, s.position, s.spool
    value = measured(p, s)
    return quantized(p, value + noise[k] if len(noise) else value)


@compiled
def follow(
    p: Record,
    s: Record,
    t_u: Array,
    u: Array,
    t: Array,
    noise: Array,
    supply: Array,
    warmth: Array,
    y: Array,
    inside: Array,
) -> None:
    """Given commands `u` [V] at the times `t_u` [s]: what is measured at `t` [s], into `y`."""
    given = 0
    for k in range(len(t)):
        around(p, s, supply, warmth, k)
        given = reach(p, s, t_u, u, given, len(u), t[k])
        y[k] = look(p, s, noise, inside, k)


@inlined
def cycle(side: float, t: float, switched: float, up: float, trim: float) -> tuple[float, float]:
    """At a switch to `side`: length of the last upper half [s], and the part to move the bias by."""
    if side < 0.0:
        return t - switched, 0.0
    if up == 0.0:
        return 0.0, 0.0
    down = t - switched
    return up, trim * (up - down) / (up + down)


@compiled
def relay(
    p: Record,
    s: Record,
    r: Record,
    t: Array,
    noise: Array,
    supply: Array,
    warmth: Array,
    reference: Array,
    bias: Array,
    trim: float,
    y: Array,
    u: Array,
    t_u: Array,
    inside: Array,
) -> None:
    """A relay that looks at the ticks `t` [s]; fills `y`, `u` [V] and `t_u` [s].

    Args:
        p: Plant.
        s: Its state.
        r: `sim.runs.RELAY`: amplitude, hysteresis, two phases.
        t: Ticks [s], shape (n,).
        noise: Shape (n,) or (0,).
        supply: Over the rig file's, likewise.
        warmth: [K], likewise.
        reference: [unit, in velocity mode unit/s], shape (n,), or (0,): the relay's own.
        bias: [V], likewise.
        trim: Part of a cycle's mean relay voltage by which the bias is moved; 0: it stays.
        y: Filled, shape (n,).
        u: Filled, shape (n,).
        t_u: Filled, shape (n,).
        inside: `INSIDE`, filled, shape (n, 6) or (0, 6).
    """
    given, closed, error, area = 0, True, 0.0, 0.0
    side = 1.0  # of the relay
    put_out = 1.0  # what of it has left
    rose, whole, behind = -1.0, 0.0, 0.0  # time of the last rise, undisturbed period, lateness
    rounds, when = 0, -math.inf
    before, tick = 0.0, 0.0
    switched, up, moved = t[0], 0.0, 0.0  # last switch, time of the last upper half, bias moved so far
    for k in range(len(t)):
        around(p, s, supply, warmth, k)
        given = reach(p, s, t_u, u, given, k, t[k])
        y[k] = look(p, s, noise, inside, k)
        wish = reference[k] if len(reference) else r.reference
        if r.velocity_mode != 0.0:
            if k > 0:
                tick = t[k] - t[k - 1]
                area += 0.5 * tick * (y[k] + before) - wish * tick
            before, error = y[k], area
        else:
            error = y[k] - wish
        turned = (side > 0.0 and error > r.hysteresis) or (side < 0.0 and error < -r.hysteresis)
        if turned:
            side = -side
            when = t[k] + behind
            up, more = cycle(side, t[k], switched, up, trim)
            moved, switched = moved + more * r.e_a, t[k]
            if side > 0.0:
                if rose >= 0.0:
                    rounds += 1
                    if behind == 0.0:
                        whole = t[k] - rose
                rose = t[k]
                if r.cycles > 0.0 and rounds >= r.cycles:
                    rounds, closed = 0, not closed
                    behind = 0.0 if closed else r.shift * whole
        if t[k] >= when:
            put_out = side
        size = r.e_a if r.entry == 0.0 else r.e_a * min(1.0, (t[k] - t[0]) / r.entry)
        u[k] = (bias[k] if len(bias) else r.bias) + moved + put_out * size
        t_u[k] = t[k] + r.latency
