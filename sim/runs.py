"""Whole runs of the kernel: given commands, a sampled relay in the loop, an ideal relay. All release the GIL.

Timing is that of recordings: row k has the time t[k], y[k] sampled then, and u[k] computed from it, which
leaves at t_u[k] and holds until the next. The plant's own transport delay comes on top, exactly.
Arrays `supply` (supply pressure over nominal), `warmth` (temperature above nominal [K]) and `force` (what is
measured of a disturbance) have an element a row, or none: then they stay as they are. `noise` [unit, or
unit/s] likewise. No array is handed to a function row by row: that costs two locked instructions each, which
together took more than the plant.
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


ON_TIME = 1e-9
"""Part of the time for which readings are held, by which a row may be early and still have the new one."""


@compiled
def _reading(p: Record, s: Record, noise: float) -> float:
    return quantized(p, measured(p, s) + noise)


@compiled
def _shown(p: Record, s: Record, noise: float) -> float:
    """What the sensor shows: a new reading, or the one that it holds."""
    return s.reading if s.taken > -math.inf else _reading(p, s, noise)


@compiled
def _due(p: Record, s: Record, t: float) -> float:
    """When a sensor that holds its readings took the one that it shows at `t` [s]; inf: it shows what is."""
    hold = p.held_readings_time
    if hold == 0.0:
        return math.inf
    due = min(s.origin + math.floor((t - s.origin) / hold + ON_TIME) * hold, t)
    return due if due > s.taken + 0.5 * hold else math.inf


@compiled
def _go_on(p: Record, s: Record, t: float, noise: float) -> None:
    """Bring the state to `t` [s]; on the way a sensor that holds its readings takes the one that is due."""
    due = _due(p, s, t)
    if due < math.inf:
        advance(p, s, due)
        s.reading, s.taken = _reading(p, s, noise), due
    advance(p, s, t)


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
    """Given commands: what is measured, into `y`.

    Args:
        p: Plant.
        s: Its state.
        t_u: When commands leave [s], ascending, shape (m,).
        u: Commands [V], shape (m,).
        t: Times of samples [s], ascending, shape (n,).
        noise: Of the sensor [unit, or unit/s], shape (n,) or (0,).
        supply: Supply pressure over nominal, likewise.
        warmth: Temperature above nominal [K], likewise.
        force: What is measured of a disturbance, likewise.
        y: Filled [unit, or unit/s], shape (n,).
    """
    given = 0
    for k in range(len(t)):
        if len(supply):
            s.supply = supply[k]
        if len(warmth):
            s.warmth = warmth[k]
        if len(force):
            s.force = force[k]
        heard = noise[k] if len(noise) else 0.0
        while given < len(u) and t_u[given] + p.transport_delay_time <= t[k]:
            _go_on(p, s, max(s.t, t_u[given] + p.transport_delay_time), heard)
            command(p, s, u[given])
            given += 1
        _go_on(p, s, t[k], heard)
        y[k] = _shown(p, s, heard)


@inlined
def _followed(r: Record, signal: float, before: float, y: float, tick: float) -> float:
    """What the relay sees: the reading's error, or in velocity mode its integral."""
    if r.velocity_mode == 0.0:
        return y - r.reference
    return signal + (0.5 * (before + y) - r.reference) * tick


@inlined
def _closed(r: Record, cycle: float, count: int, period: float, late: float) -> tuple[int, float, float]:
    """When a cycle of `cycle` [s] has closed (NaN: it is the first upward crossing).

    Returns:
        Cycles of this phase, the last undisturbed period [s], by how much switches are late from now on [s].
    """
    if math.isnan(cycle):
        return count, period, late
    count, period = count + 1, cycle if late == 0.0 else period
    if 0.0 < r.cycles <= count:
        return 0, period, 0.0 if late > 0.0 else r.shift * period
    return count, period, late


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
    """A relay that looks at the ticks; fills `y`, `u` and `t_u`.

    With `cycles` the relay's phase alternates: that many cycles as they are, that many with each switch late
    by `shift` periods of the first.

    Args:
        p: Plant.
        s: Its state.
        r: `RELAY`.
        t: Ticks [s], shape (n,).
        noise: Of the sensor [unit, or unit/s], shape (n,) or (0,).
        supply: Supply pressure over nominal, likewise.
        warmth: Temperature above nominal [K], likewise.
        force: What is measured of a disturbance, likewise.
        y: Filled with readings [unit, or unit/s], shape (n,).
        u: Filled with commands [V], shape (n,).
        t_u: Filled with when these leave [s], shape (n,).
    """
    given, sign, signal, shown = 0, 1.0, 0.0, 1.0
    crossed, period, late = math.nan, 0.0, 0.0  # last upward crossing, last undisturbed period, lateness now
    count, due = 0, -math.inf  # cycles of this phase; when the shown sign follows
    for k in range(len(t)):
        if len(supply):
            s.supply = supply[k]
        if len(warmth):
            s.warmth = warmth[k]
        if len(force):
            s.force = force[k]
        heard = noise[k] if len(noise) else 0.0
        while given < k and t_u[given] + p.transport_delay_time <= t[k]:
            _go_on(p, s, max(s.t, t_u[given] + p.transport_delay_time), heard)
            command(p, s, u[given])
            given += 1
        _go_on(p, s, t[k], heard)
        y[k] = _shown(p, s, heard)
        last = max(k - 1, 0)
        signal = _followed(r, signal, y[last], y[k], t[k] - t[last])
        wanted = -1.0 if signal > r.hysteresis else 1.0 if signal < -r.hysteresis else sign
        if wanted != sign:
            sign, due = wanted, t[k] + late
            if sign > 0.0:
                count, period, late = _closed(r, t[k] - crossed, count, period, late)
                crossed = t[k]
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
        t: Times of the samples in `y` [s], shape (n,).
        y: What is measured then [unit], filled here, shape (n,).
        switches: When the threshold was passed [s], filled here as far as it reaches, shape (m,).

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
