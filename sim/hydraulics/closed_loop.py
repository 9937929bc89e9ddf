"""Whole runs of the physical plant: given commands, or a sampled relay. Both release the GIL.

Timing is that of recordings: row k has the time t[k], y[k] sampled then, and u[k] computed from it, which
leaves at t_u[k]. Arrays `supply`, `warmth` and `noise` have an element a row, or none. As in `sim.runs`, no
array is handed to a function row by row but `inside`, where it is wanted.
"""

from __future__ import annotations

import math

import numpy as np

from sim.compiled import Record, compiled, inlined
from sim.hydraulics.motion import advance, command, measured, quantized, surroundings

Array = np.ndarray

INSIDE = ("pressure_a", "pressure_b", "pressure_s", "velocity", "position", "spool")
"""Columns of what `follow` and `relay` show of the inside, where they are given room for it."""


@inlined
def reach(p: Record, s: Record, t: float, volts: float) -> None:
    """Have a command act from `t` [s] on, or from now where that is later."""
    advance(p, s, max(s.t, t))
    command(p, s, volts)


@inlined
def around(p: Record, s: Record, supply: float, warmth: float) -> None:
    """Have the supply at `supply` times the rig file's pressure, `warmth` [K] above nominal."""
    if supply != s.supply or warmth != s.warmth:
        surroundings(p, s, supply, warmth)


@inlined
def show(s: Record, inside: Array, k: int) -> None:
    """Row `k` of what is inside: `INSIDE`, in the units of `motion.STATE`."""
    inside[k, 0], inside[k, 1], inside[k, 2] = s.pressure_a, s.pressure_b, s.pressure_s
    inside[k, 3], inside[k, 4], inside[k, 5] = s.velocity, s.position, s.spool


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
    """Given commands: what is measured, into `y`.

    Args:
        p: Plant.
        s: Its state.
        t_u: When commands leave [s], ascending, shape (m,).
        u: Commands [V], shape (m,).
        t: Times of samples [s], ascending, shape (n,).
        noise: Of the sensor [unit, or unit/s], shape (n,) or (0,).
        supply: Over the rig file's, likewise.
        warmth: Temperature above nominal [K], likewise.
        y: Filled [unit, or unit/s], shape (n,).
        inside: `INSIDE`, filled, shape (n, 6) or (0, 6).
    """
    given = 0
    for k in range(len(t)):
        around(p, s, supply[k] if len(supply) else s.supply, warmth[k] if len(warmth) else s.warmth)
        while given < len(u) and t_u[given] + p.valve_delay <= t[k]:
            reach(p, s, t_u[given] + p.valve_delay, u[given])
            given += 1
        advance(p, s, t[k])
        y[k] = quantized(p, measured(p, s) + (noise[k] if len(noise) else 0.0))
        if len(inside):
            show(s, inside, k)


@inlined
def watched(r: Record, error: float, before: float, y: float, wish: float, tick: float) -> float:
    """The error that the relay sees: of a position, or of a speed the integral [unit].

    Args:
        r: `sim.runs.RELAY`.
        error: At the last tick [unit].
        before: Reading of the last tick [unit, or unit/s].
        y: Reading of this one.
        wish: Position or speed that is wanted.
        tick: Time between both [s].
    """
    return y - wish if r.velocity_mode == 0.0 else error + 0.5 * tick * (y + before) - wish * tick


@inlined
def cycle(side: float, t: float, switched: float, up: float, trim: float) -> tuple[float, float]:
    """At a switch to `side`: length of the last upper half [s], and the part to move the bias by [1].

    Args:
        side: -1, 1: where the relay goes.
        t: Now [s].
        switched: When it last did [s].
        up: Length of the last upper half [s]; 0: there was none.
        trim: Part by which unequal halves move the bias.
    """
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
    given, closed, error = 0, True, 0.0
    side = 1.0  # of the relay
    put_out = 1.0  # what of it has left
    rose, whole, behind = -1.0, 0.0, 0.0  # time of the last rise, undisturbed period, lateness
    rounds, when = 0, -math.inf
    switched, up, moved = t[0], 0.0, 0.0  # last switch, time of the last upper half, bias moved so far
    for k in range(len(t)):
        around(p, s, supply[k] if len(supply) else s.supply, warmth[k] if len(warmth) else s.warmth)
        while given < k and t_u[given] + p.valve_delay <= t[k]:
            reach(p, s, t_u[given] + p.valve_delay, u[given])
            given += 1
        advance(p, s, t[k])
        y[k] = quantized(p, measured(p, s) + (noise[k] if len(noise) else 0.0))
        if len(inside):
            show(s, inside, k)
        wish = reference[k] if len(reference) else r.reference
        last = max(k - 1, 0)
        error = watched(r, error, y[last], y[k], wish, t[k] - t[last])
        turned = (side > 0.0 and error > r.hysteresis) or (side < 0.0 and error < -r.hysteresis)
        if turned:
            side = -side
            when = t[k] + behind
            up, more = cycle(side, t[k], switched, up, trim)
            moved, switched = moved + more * r.e_a, t[k]
            if side > 0.0:
                if rose >= 0.0:
                    rounds += 1
                    whole = t[k] - rose if behind == 0.0 else whole
                rose = t[k]
                if r.cycles > 0.0 and rounds >= r.cycles:
                    rounds, closed = 0, not closed
                    behind = 0.0 if closed else r.shift * whole
        if t[k] >= when:
            put_out = side
        size = r.e_a if r.entry == 0.0 else r.e_a * min(1.0, (t[k] - t[0]) / r.entry)
        u[k] = (bias[k] if len(bias) else r.bias) + moved + put_out * size
        t_u[k] = t[k] + r.latency
