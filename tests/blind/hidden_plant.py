"""A hydraulic actuator in physical units, for records that hide an effect: fast, and apart from `sim`.

Pressure, flow and torque instead of the model's normalised quantities; a fixed small step of Heun's method
instead of Runge-Kutta with located events; a plain square root; friction that sticks by Karnopp's rule
where the speed passes zero, or LuGre bristles.
Beyond the causes that a diagnosis knows it has some that none knows (`OFF_LIST`).
"""

from __future__ import annotations

import math

import numpy as np
from hidden_relay import relay
from numba import njit

SPOOL, PRESSURE, SPEED, ANGLE, SPEED2, ANGLE2, BRISTLE, LAGGED, SPOOL_SPEED = range(9)
STATES = 9

SETTLES = 0.5
"""Step over the time constant in which bristles bend as far as they do at a speed, at most."""

DEFAULTS = {
    "displacement": 1e-5,  # [m^3/rad]
    "inertia": 0.01,  # [kg m^2]
    "compliance": 1e-13,  # of the oil in the chambers [m^3/Pa]
    "leakage": 1e-12,  # [m^3/s/Pa]
    "valve": 1e-4,  # flow for each volt at nominal supply [m^3/s/V]
    "supply": math.inf,  # nominal pressure that the orifice sees [Pa]; infinite: flow does not depend on load
    "delay": 0.0,
    "limit": math.inf,
    "stamped": 0.0,  # 1: a command is worth what a list of volts says
    "play": 0.0,
    "spool_lag": 0.0,
    "spool_omega": 0.0,  # [rad/s] of a spool with mass; 0: it has none
    "slew": math.inf,  # of the spool [V/s]
    "null": 0.0,
    "overlap": 0.0,
    "unequal": 0.0,
    "air": 0.0,
    "rubbing": 0.0,  # torque for each speed [N m s]
    "weight": 0.0,  # constant torque [N m]
    "heavier": 0.0,  # by which it grows with time [N m/s]
    "spring": 0.0,  # [N m/rad]
    "centre": 0.0,
    "coulomb": 0.0,  # [N m]
    "stribeck": 0.0,
    "stribeck_speed": 1.0,
    "bristle_stiffness": 0.0,  # [N m/rad]
    "bristle_damping": 0.0,
    "inertia2": 0.0,  # part of `inertia` behind the shaft [kg m^2]
    "shaft": 0.0,  # [N m/rad]
    "shaft_damping": 0.0,
    "ripple": 0.0,  # [N m]
    "ripple_omega": 1.0,
    "ripple_phase": 0.0,
    "gap": 0.0,
    "eccentric": 0.0,
    "eccentric_waves": 1.0,
    "eccentric_phase": 0.0,
    "crank": 0.0,  # an eccentric encoder that turns only in part
    "crank_waves": 1.0,
    "crank_phase": 0.0,
    "lever": 0.0,  # 1 / its length [1/unit]: a straight sensor at its end sees the sine
    "lever_at": 0.0,
    "table_2": 0.0,  # Legendre polynomials of the order, over the travel
    "table_3": 0.0,
    "table_4": 0.0,
    "table_5": 0.0,
    "table_6": 0.0,
    "table_at": 0.0,
    "table_half": 1.0,
    "sensor_lag": 0.0,
    "count": 0.0,
    "folded": 0.0,  # of what is below 0 this part comes back twice with the other sign
    "law": 1.0,  # the sensor shows this power of what it sees, over `law_at`
    "law_at": 1.0,
    "keeps": 0.0,  # [s] for which a reading is repeated
    "drift_gain": 0.0,
    "drift_omega": 0.0,
    "drift_zeta": 0.0,
    # on no list of causes
    "drag": 0.0,  # torque for the square of speed [N m s^2]
    "hardening": 0.0,  # torque for the cube of angle [N m/rad^3]
    "relief": 0.0,  # leaves beyond `opens`, over the leakage: a relief valve between the chambers
    "opens": math.inf,  # [Pa]
    "progressive": 0.0,  # more gain the wider open [1/V]
    "volume": 0.0,  # compliance changes with the angle [1/rad]
    "curved": 0.0,  # sensor: + curved y^2 [1/unit]
    "gusts": 0.0,  # [N m] a random torque of unit size is given to `run`
    "sees_speed": 0.0,
}
OFF_LIST = ("drag", "hardening", "relief", "progressive", "volume", "curved", "gusts")

ENTRIES = 121
"""Of a valve's list of volts."""
PHYSICAL = np.dtype(
    [(name, np.float64) for name in DEFAULTS]
    + [(name, np.float64, (ENTRIES,)) for name in ("given_volts", "worth_volts")]
)
MODES = np.dtype([(n, np.float64) for n in ("t", "played", "behind", "touches", "slides", "stuck", "given")])

GIVEN, RELAY, SERVO = range(3)


@njit(cache=True, error_model="numpy")
def clip(x, low, high):
    return min(max(x, low), high)


@njit(cache=True, error_model="numpy")
def flow(p, spool, pressure, supply, gain):
    e = spool - p.null
    opened = e - clip(e, -p.overlap, p.overlap)
    side = np.sign(opened)
    opened *= (1.0 + side * p.unequal) * (1.0 + p.progressive * abs(opened))
    if math.isinf(p.supply):
        return p.valve * gain * opened
    drop = supply - side * pressure / p.supply
    return p.valve * gain * opened * np.sign(drop) * math.sqrt(abs(drop))


@njit(cache=True, error_model="numpy")
def load_torque(p, t, w, gust):
    shaft = p.shaft * (w[ANGLE] - w[ANGLE2]) + p.shaft_damping * (w[SPEED] - w[SPEED2])
    y = w[ANGLE]
    torque = (
        p.weight
        + p.heavier * t
        + p.spring * (y - p.centre)
        + p.hardening * y * y * y
        + p.drag * w[SPEED] * abs(w[SPEED])
        + p.rubbing * (1.0 + p.drift_zeta * t) * (1.0 + p.drift_omega * t) * w[SPEED]
    )
    if p.ripple != 0.0:
        torque -= p.ripple * math.sin(p.ripple_omega * t + p.ripple_phase)
    return torque - p.gusts * gust + shaft


@njit(cache=True, error_model="numpy")
def level(p, speed):
    if p.stribeck == 0.0:
        return p.coulomb
    return p.coulomb + p.stribeck * math.exp(-((speed / p.stribeck_speed) ** 2))


@njit(cache=True, error_model="numpy")
def encoder(p, y):
    return arm(p, y) + p.eccentric * math.sin(p.eccentric_waves * y + p.eccentric_phase) + p.curved * y * y


@njit(cache=True, error_model="numpy")
def arm(p, y):
    """What is between the load and its sensor: a lever or a crank, or the table of a curve."""
    if p.lever > 0.0:
        return math.sin(p.lever * (y - p.lever_at)) / p.lever + p.lever_at
    bent = p.crank * math.sin(p.crank_waves * y + p.crank_phase)
    return y + bent + table(p, (y - p.table_at) / p.table_half)


@njit(cache=True, error_model="numpy")
def table(p, z):
    """By Bonnet's recursion; beyond the ends as it goes there."""
    if abs(z) > 1.0:
        end = np.sign(z)
        return table(p, end) + (z - end) * (table(p, end) - table(p, end * (1.0 - 1e-7))) / (end * 1e-7)
    last, this, total = 1.0, z, 0.0
    for n, part in enumerate((p.table_2, p.table_3, p.table_4, p.table_5, p.table_6), 2):
        last, this = this, ((2 * n - 1) * z * this - (n - 1) * last) / n
        total += part * this
    return total


@njit(cache=True, error_model="numpy")
def arm_slope(p, y):
    return (arm(p, y + 1e-6) - arm(p, y - 1e-6)) / 2e-6


@njit(cache=True, error_model="numpy")
def seen(p, m, w):
    y = clip(m.behind, w[ANGLE] - p.gap / 2.0, w[ANGLE] + p.gap / 2.0)
    if p.sees_speed == 0.0:
        return encoder(p, y)
    wave = p.eccentric_waves * y + p.eccentric_phase
    slope = arm_slope(p, y) + p.eccentric * p.eccentric_waves * math.cos(wave) + 2.0 * p.curved * y
    return w[SPEED] * slope if m.touches or p.gap == 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def oil_slope(p, t, w, supply):
    omega, zeta = 1.0 + p.drift_omega * t, 1.0 + p.drift_zeta * t
    q = flow(p, w[SPOOL], w[PRESSURE], supply, 1.0 + p.drift_gain * t)
    compliance = p.compliance / omega**2 * (1.0 + p.air / supply**2) / (1.0 + p.air)
    if p.volume != 0.0:
        compliance *= math.exp(p.volume * w[ANGLE])
    beyond = w[PRESSURE] - clip(w[PRESSURE], -p.opens, p.opens)
    leak = p.leakage * (zeta / omega * w[PRESSURE] + p.relief * beyond)
    return (q - p.displacement * w[SPEED] - leak) / compliance


@njit(cache=True, error_model="numpy")
def friction(p, m, w, d):
    if p.bristle_stiffness == 0.0:
        return m.slides * level(p, w[SPEED])
    d[BRISTLE] = w[SPEED] - p.bristle_stiffness * abs(w[SPEED]) / level(p, w[SPEED]) * w[BRISTLE]
    return p.bristle_stiffness * w[BRISTLE] + p.bristle_damping * d[BRISTLE]


@njit(cache=True, error_model="numpy")
def unsigned(p, value):
    """What a sensor that has lost the sign, or follows another law, makes of what it sees."""
    folded = abs(value) if value > 0.0 else (2.0 * p.folded - 1.0) * abs(value)
    return folded * math.pow(abs(value) / p.law_at, p.law - 1.0) if value != 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def slope(p, m, t, w, supply, gust, d):
    d[:] = 0.0
    if p.spool_omega > 0.0 and math.isinf(p.slew):
        push = m.played - w[SPOOL] - p.spool_lag * w[SPOOL_SPEED]
        d[SPOOL], d[SPOOL_SPEED] = w[SPOOL_SPEED], p.spool_omega**2 * push
    elif p.spool_lag > 0.0:
        d[SPOOL] = clip((m.played - w[SPOOL]) / p.spool_lag, -p.slew, p.slew)
    d[PRESSURE] = oil_slope(p, t, w, supply)
    if m.stuck == 0.0:
        torque = p.displacement * w[PRESSURE] - load_torque(p, t, w, gust) - friction(p, m, w, d)
        d[SPEED] = torque / (p.inertia - p.inertia2)
        d[ANGLE] = w[SPEED]
    if p.inertia2 > 0.0:
        shaft = p.shaft * (w[ANGLE] - w[ANGLE2]) + p.shaft_damping * (w[SPEED] - w[SPEED2])
        d[SPEED2], d[ANGLE2] = shaft / p.inertia2, w[SPEED2]
    if p.sensor_lag > 0.0:
        d[LAGGED] = (unsigned(p, seen(p, m, w)) - w[LAGGED]) / p.sensor_lag


@njit(cache=True, error_model="numpy")
def stick_or_slide(p, m, w, supply, gust):
    """Karnopp: at a reversal the load stays if the friction can hold it."""
    if p.coulomb + p.stribeck == 0.0 or p.bristle_stiffness > 0.0:
        m.stuck = 0.0
        return
    if m.stuck == 0.0 and w[SPEED] * m.slides > 0.0:
        return
    net = p.displacement * w[PRESSURE] - load_torque(p, m.t, w, gust)
    if abs(net) <= level(p, 0.0):
        m.stuck, m.slides, w[SPEED] = 1.0, 0.0, 0.0
    elif m.stuck or w[SPEED] * net >= 0.0:
        m.stuck, m.slides = 0.0, np.sign(net)


@njit(cache=True, error_model="numpy")
def heun(p, m, w, h, supply, gust, k):
    first, second, trial, _ = k
    slope(p, m, m.t, w, supply, gust, first)
    ramps = p.spool_lag == 0.0 and not math.isinf(p.slew)
    if ramps:  # a straight line over the step, as far as the command or as the slew allows
        first[SPOOL] = clip((m.played - w[SPOOL]) / h, -p.slew, p.slew)
    for n in range(STATES):  # whole rows would be new arrays at each step
        trial[n] = w[n] + h * first[n]
    slope(p, m, m.t + h, trial, supply, gust, second)
    if ramps:
        second[SPOOL] = first[SPOOL]
    for n in range(STATES):
        w[n] += 0.5 * h * (first[n] + second[n])
    m.t += h


@njit(cache=True, error_model="numpy")
def step(p, m, w, h, supply, gust, k):
    """Heun's method, halted where sliding ends; then what jumps: the play and whether the load sticks."""
    start, begin = k[3], m.t
    for n in range(STATES):
        start[n] = w[n]
    heun(p, m, w, h, supply, gust, k)
    before = start[SPEED]
    if p.bristle_stiffness == 0.0 and m.slides * before > 0.0 and m.slides * w[SPEED] < 0.0:
        part = before / (before - w[SPEED])
        w[:], m.t = start, begin
        heun(p, m, w, part * h, supply, gust, k)
        w[SPEED] = 0.0
        stick_or_slide(p, m, w, supply, gust)
        heun(p, m, w, (1.0 - part) * h, supply, gust, k)
    stick_or_slide(p, m, w, supply, gust)
    behind = clip(m.behind, w[ANGLE] - p.gap / 2.0, w[ANGLE] + p.gap / 2.0)
    m.touches = 1.0 if behind != m.behind else 0.0
    m.behind = behind


@njit(cache=True, error_model="numpy")
def worth(p, volts):
    """By the list of volts, straight between its entries and beyond its ends as far off as there."""
    x, y, last = p.given_volts, p.worth_volts, ENTRIES - 1
    if volts <= x[0]:
        return volts + y[0] - x[0]
    for k in range(last):
        if volts <= x[k + 1]:
            return y[k] + (y[k + 1] - y[k]) * (volts - x[k]) / (x[k + 1] - x[k])
    return volts + y[last] - x[last]


@njit(cache=True, error_model="numpy")
def arrive(p, m, w, volts):
    volts = clip(volts, -p.limit, p.limit)
    if p.stamped:
        volts = worth(p, volts)
    m.played = clip(m.played, volts - p.play, volts + p.play)
    if p.spool_lag == 0.0 and math.isinf(p.slew):
        w[SPOOL] = m.played


@njit(cache=True, error_model="numpy")
def go(p, m, w, until, longest, supply, gust, k):
    """In even steps, short enough for bristles, which bend the quicker the faster the load slides."""
    if until <= m.t:
        return
    if p.bristle_stiffness > 0.0:
        rate = p.bristle_stiffness * abs(w[SPEED]) / level(p, w[SPEED])
        longest = min(longest, SETTLES / max(rate, 1.0))
    count = math.ceil((until - m.t) / longest)
    h = (until - m.t) / count
    for _ in range(count):
        step(p, m, w, h, supply, gust, k)
    m.t = until


@njit(cache=True, error_model="numpy")
def driven(p, m, w, t, u, given, made, until, latency, longest, supply, gust, k4):
    """Go on with the commands that arrive on the way; returns how many have."""
    while given < made and t[given] + latency + p.delay <= until:
        go(p, m, w, t[given] + latency + p.delay, longest, supply, gust, k4)
        arrive(p, m, w, u[given])
        given += 1
    go(p, m, w, until, longest, supply, gust, k4)
    return given


@njit(cache=True, error_model="numpy")
def shown(p, m, w, noise):
    value = (w[LAGGED] if p.sensor_lag > 0.0 else unsigned(p, seen(p, m, w))) + noise
    return math.floor(value / p.count + 0.5) * p.count if p.count > 0.0 else value


@njit(cache=True, error_model="numpy")
def run(p, m, w, t, seen_at, u, kind, c, noise, supply, gusts, latency, longest, y):
    """Rows of a record: fills `y`, and `u` unless it is given. `c` is the controller's.

    Samples are taken at `seen_at`; commands leave at the times `t`, `latency` later.

    Relay: amplitude, bias, cycles, reference, hysteresis; servo: gain, and the references in `u`.
    """
    k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    memory, given, looked = np.zeros(8), 0, -1.0
    for k in range(len(t)):
        look = seen_at[k]
        if p.keeps > 0.0:
            look = min(look, t[0] + p.keeps * math.floor((look - t[0]) / p.keeps + 1e-6))
        if look > looked + 0.5 * p.keeps:
            looked = look
            given = driven(p, m, w, t, u, given, k, look, latency, longest, supply[k], gusts[k], k4)
            y[k] = shown(p, m, w, noise[k])
        else:
            y[k] = y[k - 1]
        given = driven(p, m, w, t, u, given, k, seen_at[k], latency, longest, supply[k], gusts[k], k4)
        if kind == RELAY:
            signal = y[k] - c[3]
            if p.sees_speed and k > 0:
                memory[7] += (0.5 * (y[k] + y[k - 1]) - c[3]) * (t[k] - t[k - 1])
            u[k] = relay(c, memory, t[k], memory[7] if p.sees_speed else signal, k)
        elif kind == SERVO:
            u[k] = clip(c[0] * (u[k] - y[k]), -c[1], c[1])
