"""The kernel: the reduced hydraulic plant with all effects, integrated from event to event.

Equations and tolerance are in `docs/model.md`. Between two commands the spool moves as an exact
ramp, exponential or damped oscillation. Where, or while, oil and load are linear a step is exact
(`sim.exact`); else pressure, load and sensor are integrated by the classic fourth-order Runge-Kutta method,
in substeps of at most `substep`. A substep in which something switches (the load stops,
sticks, breaks away, meets an end stop or the other flank of the backlash, or the measurement passes the
relay's threshold) is cut there: the right-hand side is smooth within each piece, so that the order of the
method holds.
"""

from __future__ import annotations

import math

from sim import exact, matrix_steps, physics
from sim.compiled import Record, compiled, inlined
from sim.substep import longest_substep, next_substep

SHARPNESS = 1e-13
"""Events are located to this part of a substep."""

ROUNDING = 1e-9
"""Part of a step that makes no further one."""

MOST_TRIALS = 20
"""By regula falsi to locate one event: ten or so are needed; what is still open then is bisected."""

MOST_EVENTS = 10000
"""In one call; any more are no longer located, so that it ends whatever the parameters."""


@compiled
def command(p: Record, s: Record, volts: float) -> None:
    """Have a command arrive at the valve [V]: saturation, map and hysteresis."""
    limit, play = p.valve_saturation_limit, p.valve_hysteresis_half_width
    volts = min(max(volts, -limit), limit)
    if p.static_valve_map_at_ports == 0.0:
        volts = physics.mapped(p, volts)
    s.target = min(max(s.target, volts - play), volts + play)


@compiled
def move_spool(p: Record, s: Record, h: float) -> None:
    """Bring the spool to where it is `h` [s] from now."""
    if physics.swings(p):
        s.spool, s.spool_speed = physics.swung(p, s, h)
    else:
        s.spool = physics.spool_at(p, s, h)


@compiled
def measured(p: Record, s: Record) -> float:
    """What the sensor sees now, before noise and quantisation [unit, or unit/s]."""
    return s.lagged if p.sensor_lag_time > 0.0 else physics.seen(p, s, s.position, s.velocity)


@compiled
def quantized(p: Record, value: float) -> float:
    """A reading [unit, or unit/s] in whole counts of the sensor."""
    step = p.sensor_quantization_step
    return value if step == 0.0 else step * math.floor(value / step + 0.5)


@inlined
def advance(p: Record, s: Record, t: float) -> None:
    """Bring the state to time `t` [s], the command held.

    Where a threshold is watched (`watch`) and passed, it ends there: `s.t` tells when, `s.passed` is 1.
    """
    s.passed = 0.0
    if s.velocity * s.motion < 0.0:  # nothing asked for its direction until now
        s.motion = -s.motion
    while s.t < t and _goes_freely(p, s, t):
        pass
    if s.t >= t:
        return
    events, longest = 0, longest_substep(p, s, t)
    while s.t < t:
        h, ends = next_substep(p, s, t - s.t, longest)
        now = (s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged)
        then = _step(p, s, now, h)
        if events > MOST_EVENTS or _event(p, s, then, h) <= 0.0:
            _accept(p, s, then, h)
            if ends:
                s.t = t
        else:
            high = _locate(p, s, now, h)
            then = _step(p, s, now, high)
            _accept(p, s, then, high)
            _switch(p, s, then)
            events += 1
            if s.passed != 0.0:
                break


@inlined
def _goes_freely(p: Record, s: Record, t: float) -> bool:
    """Go towards `t` [s] by one exact step, where there can be one and nothing switches; else change nothing.

    What most rows of a recording need, without all that the others do.
    """
    if s.motion == 0.0 or s.stopped != 0.0 or s.watch != 0.0 or p.longest_exact == 0.0:
        return False
    if not exact.linear_now(p, s, s.velocity):
        return False
    if p.by_matrix != 0.0:
        return _goes_by_matrix(p, s, t)
    left = t - s.t
    h = min(left, p.longest_exact)
    now = (s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged)
    then = exact.step(p, s, now, h)
    if _event(p, s, then, h) > 0.0 or not exact.linear_now(p, s, then[1]):
        return False
    s.t = t if h == left else s.t + h
    s.pressure, s.velocity, s.position, s.velocity2, s.position2 = then[:5]
    s.followed = physics.followed(p, s, s.position)
    s.spool = physics.spool_at(p, s, h) if p.valve_lag_time > 0.0 else s.target
    s.steps += exact.COST
    return True


@compiled
def _goes_by_matrix(p: Record, s: Record, t: float) -> bool:
    """Likewise, of a plant whose steps are exact by a matrix: the rest of the way is cut in equal ones."""
    h = t - s.t
    ends = h <= p.longest_exact * (1.0 + ROUNDING)
    if not ends:
        h /= math.ceil(h / p.longest_exact - ROUNDING)
    k = matrix_steps.kept(p, s, h)
    if k < 0:
        return False
    now = (s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged)
    then = matrix_steps.step(p, s, now, physics.opening(p, s.target), k)
    if _event(p, s, then, h) > 0.0 or not exact.linear_now(p, s, then[1]):
        return False
    s.t = t if ends else s.t + h
    s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged = then
    s.followed = physics.followed(p, s, s.position)
    s.spool = s.target
    s.steps += matrix_steps.COST
    return True


@compiled
def _moved(z: tuple[float, ...], k: tuple[float, ...], h: float) -> tuple[float, ...]:
    """Go on from z by h k."""
    return (
        z[0] + h * k[0],
        z[1] + h * k[1],
        z[2] + h * k[2],
        z[3] + h * k[3],
        z[4] + h * k[4],
        z[5] + h * k[5],
        z[6] + h * k[6],
    )


@compiled
def _step(p: Record, s: Record, z: tuple[float, ...], h: float) -> tuple[float, ...]:
    """One step of `h` [s] from `z`: exact where the plant is linear, else by Runge and Kutta."""
    if p.linear != 0.0:
        return exact.step(p, s, z, h)
    half = 0.5 * h
    first = physics.opening(p, s.spool if physics.spool_moves(p) else s.target)
    middle = physics.opening(p, physics.spool_at(p, s, half))
    last = physics.opening(p, physics.spool_at(p, s, h))
    a = physics.rates(p, s, z, s.t, first)
    b = physics.rates(p, s, _moved(z, a, half), s.t + half, middle)
    c = physics.rates(p, s, _moved(z, b, half), s.t + half, middle)
    d = physics.rates(p, s, _moved(z, c, h), s.t + h, last)
    return _moved(_moved(_moved(_moved(z, a, h / 6.0), b, h / 3.0), c, h / 3.0), d, h / 6.0)


@compiled
def _accept(p: Record, s: Record, z: tuple[float, ...], h: float) -> None:
    """Make `z`, `h` [s] from now, the state."""
    move_spool(p, s, h)
    s.t += h
    s.pressure, s.velocity, s.position, s.velocity2, s.position2, s.bristle, s.lagged = z
    s.followed = physics.followed(p, s, s.position)
    s.steps += _cost(p)


@compiled
def _cost(p: Record) -> float:
    """Of one step, over one by Runge and Kutta."""
    return exact.COST if p.linear != 0.0 else 1.0


@compiled
def _event(p: Record, s: Record, z: tuple[float, ...], h: float) -> float:
    """Above 0 where something has switched within the `h` [s] that ended in `z`.

    Each event has a quantity that passes zero upwards; the largest of them tells the first event.
    """
    most = -1.0
    if s.watch != 0.0:
        seen = z[6] if p.sensor_lag_time > 0.0 else physics.seen(p, s, z[2], z[1])
        most = max(most, s.watch * (seen - s.level - s.rate * (s.t + h)))
    if s.stopped != 0.0 or s.motion == 0.0:
        return max(most, _breaks_away(p, s, z, s.t + h))
    if physics.dry_friction(p) or p.backlash_gap > 0.0 or p.lugre_friction_stiffness > 0.0:
        most = max(most, -s.motion * z[1])
    if p.backlash_gap > 0.0 and p.sensor_lag_time > 0.0 and not physics.in_contact(p, s):
        most = max(most, s.motion * (z[2] - s.followed) - 0.5 * p.backlash_gap)
    return max(most, z[2] - p.stop_high, p.stop_low - z[2])


@compiled
def _breaks_away(p: Record, s: Record, z: tuple[float, ...], t: float) -> float:
    """Above 0 where a load that sticks or lies at a stop is driven off."""
    coupling = 0.0
    if p.load_resonance_inertia > 0.0:
        coupling = physics.coupling(p, 0.0, z[2], z[3], z[4])
    drive = physics.drive(p, s, t, z[0], z[2], coupling)
    holds = physics.friction_level(p, 0.0) if p.lugre_friction_stiffness == 0.0 else 0.0
    return (abs(drive) if s.stopped == 0.0 else -s.stopped * drive) - holds


@compiled
def _locate(p: Record, s: Record, z: tuple[float, ...], h: float) -> float:
    """Time just after the first event within `h` [s], by the Illinois form of regula falsi."""
    low, high, sharp = 0.0, h, SHARPNESS * h
    at_low, at_high = _event(p, s, z, 0.0), _event(p, s, _step(p, s, z, h), h)
    side = 0
    for trial in range(4 * MOST_TRIALS):
        if high - low <= sharp:
            break
        middle = 0.5 * (low + high)
        if trial <= MOST_TRIALS and at_high > at_low:  # of denormal numbers both may have become 0
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            middle = min(max(middle, low + 0.5 * sharp), high - 0.5 * sharp)
        s.steps += _cost(p)
        value = _event(p, s, _step(p, s, z, middle), middle)
        if value > 0.0:
            high, at_high = middle, value
            at_low *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, at_low = middle, value
            at_high *= 0.5 if side < 0 else 1.0
            side = -1
    return high


@compiled
def _switch(p: Record, s: Record, z: tuple[float, ...]) -> None:
    """Do what the event just passed asks for."""
    if s.watch != 0.0 and s.watch * (measured(p, s) - s.level - s.rate * s.t) >= 0.0:
        s.passed = 1.0
    if s.stopped != 0.0 or s.motion == 0.0:
        if _breaks_away(p, s, z, s.t) > 0.0:
            _break_away(p, s)
    elif s.position >= p.stop_high or s.position <= p.stop_low:
        _stop(p, s)
    elif s.motion * s.velocity <= 0.0:
        _turn_round(p, s)


@compiled
def _balance(p: Record, s: Record) -> float:
    """Acceleration of the load that stands, but for dry friction [unit/s^2]."""
    coupling = 0.0
    if p.load_resonance_inertia > 0.0:
        coupling = physics.coupling(p, 0.0, s.position, s.velocity2, s.position2)
    return physics.drive(p, s, s.t, s.pressure, s.position, coupling)


@compiled
def _break_away(p: Record, s: Record) -> None:
    s.motion = -1.0 if _balance(p, s) < 0.0 else 1.0
    s.stopped = 0.0


@compiled
def _stop(p: Record, s: Record) -> None:
    """Lie at an end stop: it takes all speed away."""
    s.stopped = 1.0 if s.position >= p.stop_high else -1.0
    s.position = p.stop_high if s.stopped > 0.0 else p.stop_low
    s.velocity = 0.0
    s.followed = physics.followed(p, s, s.position)
    s.bristle = 0.0
    if p.load_resonance_inertia == 0.0:
        s.velocity2, s.position2 = 0.0, s.position


@compiled
def _turn_round(p: Record, s: Record) -> None:
    """Stick, or go the other way."""
    if not physics.dry_friction(p):
        s.motion = -s.motion
        return
    s.velocity = 0.0
    if p.load_resonance_inertia == 0.0:
        s.velocity2 = 0.0
    drive = _balance(p, s)
    s.motion = 0.0 if abs(drive) <= physics.friction_level(p, 0.0) else math.copysign(1.0, drive)
