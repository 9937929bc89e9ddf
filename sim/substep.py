"""How long the kernel's next substep may be, so that the tolerance of `docs/model.md` holds."""

from __future__ import annotations

import math

from sim import physics
from sim.compiled import Record, compiled

HALVINGS = 43
"""Of a substep, until a spool's passing of an edge is located to 1e-13 of it."""

PASSES = 0.05
"""Of the range of a map of the ports, in one substep. Measured: without, a case of the tests is 1e-4 off."""


@compiled
def longest_substep(p: Record, s: Record, t: float) -> float:
    """Longest substep until `t` [s]: shorter where drift or pressure have made the plant quicker."""
    quicker = math.sqrt(physics.stiffness(p, s))
    rate, thermal = p.parameter_drift_omega_n, p.parameter_drift_omega_n_thermal
    if rate != 0.0 or thermal != 0.0:
        quicker *= physics.drifted(rate, thermal, (t if rate > 0.0 else s.t) - s.origin, s.warmth)
    rate, thermal = p.parameter_drift_zeta, p.parameter_drift_zeta_thermal
    if rate != 0.0 or thermal != 0.0:
        damping = physics.drifted(rate, thermal, (t if rate > 0.0 else s.t) - s.origin, s.warmth)
        quicker *= max(1.0, damping)
    return p.substep / max(1.0, quicker)


@compiled
def next_substep(p: Record, s: Record, left: float, longest: float) -> tuple[float, bool]:
    """How far to go now, and whether that is the whole of `left`.

    Args:
        p: Parameters.
        s: State.
        left: Time to go [s].
        longest: `longest_substep` [s].

    Returns:
        Length [s], and whether nothing is left after it.
    """
    if p.square_root_flow_supply < math.inf:
        longest = min(longest, max(_within_orifice(p, s, longest), p.shortest * longest))
    if p.lugre_friction_stiffness > 0.0 and not physics.settled(p, s):
        longest = min(longest, _within_bristles(p, s, longest))
    if p.static_valve_map_at_ports != 0.0 and physics.spool_moves(p):
        longest = min(longest, _within_ports(p, s))
    longest = max(longest, 1e-9)
    pieces = math.ceil(left / longest - 1e-9)
    h = left / pieces if pieces > 1.0 else left
    edge = _next_edge(p, s, h)
    if edge < h:
        return edge, False
    return h, pieces <= 1.0


@compiled
def _within_orifice(p: Record, s: Record, longest: float) -> float:
    """Substep [s] in which the orifice's slope changes little: by its own rate, and by the pressure's."""
    speed = abs(p.K_L) * (abs(physics.opening(p, s.spool)) + abs(physics.opening(p, s.target)))
    if speed == 0.0:
        return longest
    full = p.square_root_flow_supply
    soft = physics.LAMINAR + abs(1.0 - abs(s.pressure) / (full * max(s.supply, physics.VACUUM)))
    rate = max(speed / math.sqrt(soft), (speed + abs(s.velocity)) / soft)
    quicker = p.omega_n * p.substep / longest
    return 0.5 * full / (quicker * quicker * rate)


@compiled
def _within_ports(p: Record, s: Record) -> float:
    """Substep [s] in which the spool passes little of the map of its ports; inf where it has none."""
    speed = abs(s.target - s.spool) / max(p.valve_lag_time, 1e-300)
    if physics.swings(p):
        speed = abs(s.spool_speed) + p.spool_inertia_omega * abs(s.target - s.spool)
    speed = min(speed, p.valve_rate_limit_rate)
    return PASSES * p.static_valve_map_range / (speed + 1e-300)


@compiled
def _within_bristles(p: Record, s: Record, longest: float) -> float:
    """Substep [s] in which the load goes no further than the bristles bend, however it is pushed."""
    ratio, stiff = p.load_resonance_inertia, p.lugre_friction_stiffness / p.coulomb_friction_level
    coupled = 0.0
    if ratio > 0.0:
        coupled = physics.coupling(p, s.velocity, s.position, s.velocity2, s.position2)
    rise = p.omega_n * p.omega_n * abs(p.K_L * s.target) * longest  # of the pressure, at most
    push = rise + abs(physics.drive(p, s, s.t, s.pressure, s.position, coupled))
    push += p.lugre_friction_stiffness * abs(s.bristle) + p.lugre_friction_damping * abs(s.velocity)
    rate = stiff * abs(s.velocity)
    return 2.0 / (rate + math.sqrt(rate * rate + 4.0 * stiff * (1.0 + ratio) * push) + 1e-300)


@compiled
def _next_edge(p: Record, s: Record, h: float) -> float:
    """When the spool next has a kink in its flow or its way [s]; inf: never, or not within `h` [s].

    At an edge of its overlap, and where it no longer goes as fast as it can.
    """
    if not physics.spool_moves(p):
        return math.inf
    nearest = math.inf
    if p.valve_rate_limit_rate < math.inf:
        ramp = physics.ramps_for(p, s)
        if ramp > 1e-9 * p.valve_lag_time:
            nearest = ramp
    bent = p.valve_deadband_half_width > 0.0 or p.asymmetric_gain_ratio != 0.0
    bent = bent or p.static_valve_map_at_ports != 0.0
    if not bent and p.square_root_flow_supply == math.inf:
        return nearest
    for side in (-1.0, 1.0):
        edge = p.null_shift_voltage + side * p.valve_deadband_half_width
        if physics.swings(p):
            nearest = min(nearest, _swings_past(p, s, edge, h))
            continue
        before, after = s.spool - s.target, edge - s.target
        if before * after > 0.0 and abs(after) < abs(before) * (1.0 - 1e-9):
            nearest = min(nearest, _passes(p, abs(before), abs(after)))
    return nearest


@compiled
def _swings_past(p: Record, s: Record, edge: float, h: float) -> float:
    """When a spool with inertia has just passed `edge` [V]; inf: not within `h` [s]."""
    before = s.spool - edge
    if before * (physics.swung(p, s, h)[0] - edge) >= 0.0:
        return math.inf
    low, high = 0.0, h
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if before * (physics.swung(p, s, middle)[0] - edge) < 0.0:
            high = middle
        else:
            low = middle
    return high


@compiled
def _passes(p: Record, before: float, after: float) -> float:
    """When the spool, `before` [V] from its target, is no more than `after` from it [s]."""
    lag, rate = p.valve_lag_time, p.valve_rate_limit_rate
    if rate == math.inf:
        return lag * math.log(before / after)
    knee = rate * lag
    if after >= knee:
        return (before - after) / rate
    return max(0.0, before - knee) / rate + lag * math.log(min(before, knee) / after)
