"""Whole runs of the kernel: given commands, a sampled relay in the loop, an ideal relay. All release the GIL.

Timing is that of recordings: row k has the time t[k], y[k] sampled then, and u[k] computed from it, which
leaves at t_u[k] and holds until the next. The plant's own transport delay comes on top, exactly.
Arrays `supply` (supply pressure over nominal), `warmth` (temperature above nominal [K]) and `force` (what is
measured of a disturbance) have an element a row, or none: then they stay as they are. `noise` [unit, or
unit/s] likewise.
"""

from __future__ import annotations

import math

import numpy as np

from sim.compiled import Record, compiled, inlined
from sim.kernel import advance, command, measured, quantized

Array = np.ndarray

RELAY = np.dtype(
    [
        (name, np.float64)
        for name in (
            "e_a",  # [V] amplitude
            "hysteresis",  # [unit] half-width
            "bias",  # [V]
            "reference",  # [unit] position to swing about, or [unit/s] speed
            "entry",  # [s] in which the amplitude rises from 0 to e_a
            "latency",  # [s] from the sample, or from the ideal crossing, to the command's leaving
            "velocity_mode",  # 1: the relay sees the integral of the speed error (Fig. 6b)
            "cycles",  # cycles of each phase; 0: one phase only
            "shift",  # periods of the first phase by which the relay is late in the second
        )
    ]
)


@compiled
def condition(s: Record, supply: Array, warmth: Array, force: Array, k: int) -> None:
    """Have the surroundings of row `k` from now on."""
    if len(supply):
        s.supply = supply[k]
    if len(warmth):
        s.warmth = warmth[k]
    if len(force):
        s.force = force[k]


ON_TIME = 1e-9
"""Part of the time for which readings are held, by which a row may be early and still have the new one."""


@compiled
def _read(p: Record, s: Record, noise: Array, k: int) -> float:
    if s.taken > -math.inf:
        return s.reading
    value = measured(p, s)
    return quantized(p, value + noise[k] if len(noise) else value)


@compiled
def _due(p: Record, s: Record, t: float) -> float:
    """When a sensor that holds its readings took the one that it shows at `t` [s]; inf: it shows what is."""
    hold = p.held_readings_time
    if hold == 0.0:
        return math.inf
    due = min(s.origin + math.floor((t - s.origin) / hold + ON_TIME) * hold, t)
    return due if due > s.taken + 0.5 * hold else math.inf


@inlined
def _sampled(
    p: Record, s: Record, t_u: Array, u: Array, given: int, made: int, t: float, noise: Array, k: int
) -> int:
    """`_deliver`; on the way a sensor that holds its readings takes the one of row `k`."""
    due = _due(p, s, t)
    if due < math.inf:
        given = _deliver(p, s, t_u, u, given, made, due)
        s.taken = -math.inf
        s.reading = _read(p, s, noise, k)
        s.taken = due
    return _deliver(p, s, t_u, u, given, made, t)


@inlined
def _deliver(p: Record, s: Record, t_u: Array, u: Array, given: int, made: int, t: float) -> int:
    """Have the commands that reach the valve by `t` act, each at its time; returns how many have by then."""
    while given < made and t_u[given] + p.transport_delay_time <= t:
        advance(p, s, max(s.t, t_u[given] + p.transport_delay_time))
        command(p, s, u[given])
        given += 1
    advance(p, s, t)
    return given


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
    force: Array,
    y: Array,
) -> None:
    """Given commands `u` [V] at the times `t_u` [s]: what is measured at the times `t` [s], into `y`."""
    given = 0
    for k in range(len(t)):
        condition(s, supply, warmth, force, k)
        given = _sampled(p, s, t_u, u, given, len(u), t[k], noise, k)
        y[k] = _read(p, s, noise, k)


@compiled
def sampled_relay(
    p: Record,
    s: Record,
    r: Record,
    t: Array,
    noise: Array,
    supply: Array,
    warmth: Array,
    force: Array,
    y: Array,
    u: Array,
    t_u: Array,
) -> None:
    """A relay that looks at the ticks `t` [s]; fills `y`, `u` [V] and `t_u` [s].

    With `cycles` the relay's phase alternates: that many cycles as they are, that many with each switch late
    by `shift` periods of the first.
    """
    given, sign, signal, shown = 0, 1.0, 0.0, 1.0
    crossed, period, late = math.nan, 0.0, 0.0  # last upward crossing, last undisturbed period, lateness now
    count, due = 0, -math.inf  # cycles of this phase; when the shown sign follows
    for k in range(len(t)):
        condition(s, supply, warmth, force, k)
        given = _sampled(p, s, t_u, u, given, k, t[k], noise, k)
        y[k] = _read(p, s, noise, k)
        if r.velocity_mode == 0.0:
            signal = y[k] - r.reference
        elif k > 0:
            signal += (0.5 * (y[k] + y[k - 1]) - r.reference) * (t[k] - t[k - 1])
        wanted = -1.0 if signal > r.hysteresis else 1.0 if signal < -r.hysteresis else sign
        if wanted != sign:
            sign, due = wanted, t[k] + late
            if sign > 0.0:
                if not math.isnan(crossed):
                    count += 1
                    period = t[k] - crossed if late == 0.0 else period
                crossed = t[k]
                if 0.0 < r.cycles <= count:
                    count, late = 0, 0.0 if late > 0.0 else r.shift * period
        if t[k] >= due:
            shown = sign
        rise = 1.0 if r.entry == 0.0 else min(1.0, (t[k] - t[0]) / r.entry)
        u[k] = r.bias + shown * rise * r.e_a
        t_u[k] = t[k] + r.latency


@compiled
def ideal_relay(p: Record, s: Record, r: Record, t: Array, y: Array, switches: Array) -> int:
    """A relay that sees every instant: switches where the measured position passes the threshold.

    Args:
        p: Plant; it must measure position, in velocity mode too (the integral of the speed error is
            position - reference t).
        s: Its state.
        r: The relay; `entry` and `cycles` do not apply. Latency and delay must be less than half a period.
        t: Times of the samples in `y` [s].
        y: What is measured then, filled here.
        switches: When the threshold was passed [s], filled here as far as it reaches.

    Returns:
        How many switches there were.
    """
    sign, count, start, due = 1.0, 0, s.t, math.inf  # due: when the last switch acts
    command(p, s, r.bias + r.e_a)
    s.rate = r.reference if r.velocity_mode else 0.0
    centre = s.position if r.velocity_mode else r.reference
    for k in range(len(t)):
        while s.t < t[k]:
            s.watch = sign if due == math.inf else 0.0
            s.level = centre + sign * r.hysteresis - s.rate * start
            advance(p, s, min(due, t[k]))
            if s.passed != 0.0:
                if count < len(switches):
                    switches[count] = s.t
                count += 1
                sign = -sign
                due = s.t + r.latency + p.transport_delay_time
                s.passed = 0.0
            if s.t >= due:
                command(p, s, r.bias + sign * r.e_a)
                due = math.inf
        y[k] = measured(p, s)
    s.watch = 0.0
    return count
