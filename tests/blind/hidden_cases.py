"""Records that hide one cause, two, none, or one that is on no list, made from a number."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from hidden_baseline import best_baseline
from hidden_drives import CLOCKED, EXCITATIONS, make_drive
from hidden_fair import chatters, left_beside, left_by_list, moves
from hidden_rig import GIVEN, Drive, Rig, simulate
from hidden_strength import (
    ALONE,
    BRISTLES,
    DEFECTS,
    HELD,
    LISTED,
    MEASURED,
    RECTIFIED,
    UNLISTED,
    drawn,
    effects_of,
    sizes,
)
from scipy.signal import detrend, lfilter

SLEW = "valve_rate_limit"
LISTED_SINCE = {SLEW: 22000, "sensor_nonlinearity": 31000, "static_valve_map": 31000}
"""Listed later: records of lower numbers are what they were before."""
SENSORS_SINCE = 120000
"""Sensors that rectify or repeat, a measured disturbance, mains, samplers: lower numbers have none."""
ROWS_SINCE = 134000
"""From this number on a plant is sampled slowly or quickly: before, 8 to 25 rows were a radian of it."""
FEWEST_ROWS, MOST_ROWS = 4.0, 60.0
"""Rows to a radian of the plant's own frequency."""
LONGEST_ROWS = 24000
"""Of a record."""
DOMINANT_SINCE = 135000
"""From this number on an effect may leave more than the movement itself, as of a stiff specimen."""
MOST_VISIBLE, MOST_DOMINANT = 10.0, 50.0
"""What an effect leaves of the best plant of Eq. 1, over the least that is fair, at most; then and since."""
STIFFEST = 6.0
"""Since then, of a spring over that of the oil, at most."""
RUBS_SINCE = 136000
"""From this number on a part of the damping is viscous friction, where a cause is hidden that shows it."""
SHOW_RUBBING = {"coulomb_friction", "stribeck_friction", BRISTLES, "load_resonance", "square_root_flow"}
"""Causes that do; beside a measured disturbance, too."""
A_TURN_SINCE = 132020
"""From this number on an eccentric encoder that is hidden as a curve turns no more than `MOST_TURNS`."""
MOST_TURNS = 1.25
"""Waves over the travel: more of them are a ripple, by its definition."""
NOW_NAMED = {"curved": "sensor_nonlinearity", "progressive": "static_valve_map"}
"""Off the list until then."""
OF_POSITIONS = {"sensor_nonlinearity"}
"""Hidden where the sensor sees the position alone."""
CLOCKED_SINCE = 138000
"""From this number on a clock may give two commands: a square wave, or binary noise."""
OPEN = ("multisine", "steps", *CLOCKED)
"""Excitations without a loop, of positions too: behind a sensor without sign none can be closed."""
CORRELATED = 3.0
"""Radians of the plant over which a measured disturbance keeps its value, about."""
KINDS = ("one", "two", "clean", "unlisted")
TRIES = 12
LEAST = 3.0
"""Times the noise that the best baseline leaves of an effect, at least."""
ALIKE = (
    {"valve_lag", "sensor_lag", "transport_delay", SLEW},
    {"position_ripple", "sensor_nonlinearity"},
    {"static_valve_map", "valve_deadband", "valve_saturation", "asymmetric_gain"},
    {"coulomb_friction", "stribeck_friction", BRISTLES},
    {"load_bias", "asymmetric_gain"},
)
"""Not hidden together: two of one family."""


COARSE = "sensor_quantization"
HYSTERESIS = 4.0
"""Of relays, over the noise that is expected."""
MOST_JITTER = 0.35
"""Ticks: more would exchange samples."""


@dataclass(frozen=True)
class Case:
    """What is hidden, and in what.

    Attributes:
        number: It is made from.
        kind: `one`, `two`, `clean` or `unlisted`.
        causes: Names, as a diagnosis should say them; of an unlisted one our own.
        rig: With the effects.
        visible: By cause, over the noise: what the best baseline leaves of it, beside another cause the best
            plant with that one; of an unlisted one what the best plant with a listed one leaves.
        noise: Standard deviation [unit].
        hysteresis: Of the relay, of its signal [unit, or unit s]: it must not switch on the noise.
    """

    number: int
    kind: str
    causes: tuple[str, ...]
    excitation: str
    rig: Rig
    tick: float
    duration: float
    volts: float
    noise_part: float
    latency: float
    visible: dict[str, float] = field(default_factory=dict)
    noise: float = 0.0
    hysteresis: float = 0.0
    defects: dict[str, float] = field(default_factory=dict)

    @property
    def t(self):
        return np.arange(round(self.duration / self.tick)) * self.tick


class Invisible(Exception):
    """The cause cannot be made visible with this plant and excitation."""


def draw(
    number: int,
    kind: str | None = None,
    causes=None,
    excitation=None,
    sees_speed=None,
    noise_part=0.01,
    duration=None,
):
    """A case; what is not given is drawn. Combinations that cannot be seen are drawn anew."""
    random = np.random.default_rng([number, 77])
    kind = kind or str(random.choice(KINDS, p=[0.6, 0.2, 0.1, 0.1]))
    for _ in range(TRIES):
        chosen = tuple(causes) if causes is not None else _causes(kind, random, number)
        if len(chosen) > 1 and set(chosen) & set(ALONE):
            raise Invisible(f"{chosen}: {', '.join(ALONE)} are hidden alone")
        hides = "one" if kind == "unlisted" and chosen[0] in LISTED else kind
        case = _bare(number, hides, chosen, excitation, sees_speed, noise_part, random)
        case = case if duration is None else replace(case, duration=duration)
        case = case if number < ROWS_SINCE else _in_rows(case)
        case = case if number < RUBS_SINCE else _rubbing(case)
        try:
            return _strong(case, random)
        except Invisible:
            continue
    raise Invisible(f"case {number}: {kind} {causes} under {excitation} cannot be seen")


def _in_rows(case: Case) -> Case:
    """Sampled at another rate for its plant, but for times that jitter, and for as long as rows allow."""
    if "timing_jitter" in case.causes:
        return case
    spread = math.log(FEWEST_ROWS), math.log(MOST_ROWS)
    rows = math.exp(np.random.default_rng([case.number, 14]).uniform(*spread))
    tick = 1.0 / (rows * case.rig.omega_n)
    return replace(case, tick=tick, duration=min(case.duration, LONGEST_ROWS * tick))


def _rubbing(case: Case) -> Case:
    """With damping by leakage, by viscous friction, or by both: one as likely as the other."""
    if not {*SHOW_RUBBING, "measured_disturbance"}.intersection(case.causes):
        return case
    random = np.random.default_rng([case.number, 15])
    share = float(random.choice([0.0, 1.0, random.uniform()]))
    return replace(case, rig=replace(case.rig, rubs=share))


def known(number: int) -> tuple[str, ...]:
    """Causes that are listed in records of this number."""
    return tuple(name for name in LISTED if number >= LISTED_SINCE.get(name, 0))


def unknown(number: int) -> list[str]:
    """Those off the list."""
    if number < LISTED_SINCE[SLEW]:
        return [SLEW if one == "relief" else one for one in UNLISTED]
    return [one for one in UNLISTED if NOW_NAMED.get(one) not in known(number)]


def _causes(kind, random, number) -> tuple[str, ...]:
    if kind == "clean":
        return ()
    if kind == "unlisted":
        return (str(random.choice(unknown(number))),)
    if kind == "one":
        alone = ALONE if number >= SENSORS_SINCE else ()
        return (str(random.choice([*known(number), *DEFECTS, BRISTLES, *alone])),)
    while True:
        pair = {str(x) for x in random.choice(known(number), 2, replace=False)}
        if not any(pair <= family for family in ALIKE):
            return tuple(sorted(pair))


def _bare(number, kind, causes, excitation, sees_speed, noise_part, random) -> Case:
    omega_n = float(np.exp(random.uniform(np.log(40.0), np.log(250.0))))
    rig = Rig(
        float(random.uniform(5.0, 30.0)),
        omega_n,
        float(np.exp(random.uniform(np.log(0.12), np.log(1.0)))),
        {},
        bool(random.random() < 0.35) if sees_speed is None else sees_speed,
        float(np.exp(random.uniform(-12.0, -9.0))),
        float(np.exp(random.uniform(-6.0, 0.0))),
    )
    if OF_POSITIONS.intersection(causes):
        rig = replace(rig, sees_speed=False)
    tick = 1e-3 if omega_n < 100.0 else 5e-4
    if "timing_jitter" in causes:  # seen where the signal runs far within the jitter
        tick = min(0.3 / omega_n, 4e-3)
    duration = 20.0 if omega_n > 80.0 else 30.0
    latency = float(random.choice([0.0, 0.0, 3e-4]))
    if "timing_jitter" in causes:  # a command follows from a sample, late as that may be
        latency = tick
    drives = (*EXCITATIONS, *(CLOCKED if number >= CLOCKED_SINCE else ()))
    kind_of_drive = excitation or str(random.choice(drives))
    if RECTIFIED in causes and kind_of_drive not in OPEN:
        if excitation is not None:
            raise Invisible(f"{RECTIFIED} under {excitation}: no loop can be closed behind it")
        kind_of_drive = str(random.choice([each for each in drives if each in OPEN]))
    volts = float(np.exp(random.uniform(-1.0, 1.0)))
    return Case(number, kind, causes, kind_of_drive, rig, tick, duration, volts, noise_part, latency)


def _strong(case: Case, random) -> Case:
    """The case with effects of a drawn visibility, 3.3 to 30 times the noise, or to 150 times."""
    base, u = run(case)
    z = sizes(base, u, case.tick, sees_speed=case.rig.sees_speed)
    case = replace(case, hysteresis=HYSTERESIS * case.noise_part * z.place)
    effects, visible = {}, {}
    most = MOST_VISIBLE if case.number < DOMINANT_SINCE else MOST_DOMINANT
    for cause in case.causes:
        wanted = math.exp(random.uniform(math.log(1.1 * LEAST), math.log(most * LEAST)))
        if cause in DEFECTS:
            noise = case.noise_part * float(np.std(detrend(base)))
            case = replace(case, defects=_defect(cause, wanted, noise, z, case.tick, random))
            visible[cause] = wanted
            continue
        one, visible[cause] = _of_visibility(case, cause, wanted, z, drawn(cause, random))
        effects.update(one)
    rig = replace(case.rig, effects=effects)
    return _fair(replace(case, rig=rig, visible=visible))


def _fair(case: Case) -> Case:
    """The case with its noise and what is visible in its record, if that is a fair test."""
    y, quiet = run(case)
    if case.number >= A_TURN_SINCE and turns(case, y) > MOST_TURNS:
        raise Invisible(f"{case.causes}: the load moves so far that the curve is a ripple")
    noise = case.noise_part * float(np.std(detrend(y)))
    random = np.random.default_rng([case.number, 4]).normal(0.0, noise, len(y))
    seen, u = run(case, random)
    relay = case.excitation in {"relay", "two-phase"}
    if not moves(seen, noise) or (relay and chatters(u, quiet)):
        raise Invisible(f"{case.causes}: the load is stuck, or the relay follows the noise")
    left = {
        name: _left_of(case, name, _quiet(case, seen, random, u), u, LEAST * noise) / noise
        for name in case.causes
        if name not in DEFECTS
    }
    if min(left.values(), default=LEAST) < LEAST:
        raise Invisible(str(case.causes))
    return replace(case, noise=noise, visible=case.visible | left)


def turns(case: Case, y) -> float:
    """Of an eccentric encoder that is hidden as a curve, over what is read; 0: there is none."""
    curve = case.rig.effects.get("sensor_nonlinearity", {})
    return curve.get("wavenumber", 0.0) * float(np.ptp(y)) / math.tau


def _quiet(case: Case, seen, noise, u):
    """The readings without their noise, of which some are repeated where they are held."""
    if HELD not in case.causes:
        return seen - noise
    given = Drive(GIVEN, u)
    return simulate(case.rig, case.t, given, None, supply_of(case), torque_of(case), case.latency)[0]


def _left_of(case: Case, cause: str, y, u, seen: float) -> float:
    """The rms that is left of a cause in this record, without noise; beside a coarse sensor before rounding.

    Exact from `seen` on: less is not looked into.

    Rounding makes both sides jump: no refit gets hold of it, and a twentieth of a step looks like a fifth.
    """
    if cause != COARSE and COARSE in case.rig.effects:
        rest = {name: group for name, group in case.rig.effects.items() if name != COARSE}
        case = replace(case, kind="one", causes=(cause,), rig=replace(case.rig, effects=rest))
        y, u = simulate(case.rig, case.t, Drive(GIVEN, u), None, supply_of(case), None, case.latency)
    alone, given = _left(case, y, u), {"supply": supply_of(case), "latency": case.latency}
    if alone < LEAST * case.noise_part * float(np.std(detrend(y))):
        return alone
    if case.kind == "unlisted":
        return min(alone, left_by_list(case.rig, known(case.number), y, u, case.t, seen, **given))
    return alone if case.kind == "one" else left_beside(case.rig, cause, y, u, case.t, **given)


def _defect(cause, wanted, noise, z, tick, random) -> dict[str, float]:
    if cause == "outliers":
        return {"rate": float(random.uniform(0.002, 0.02)), "size": 4.0 * wanted * noise}
    if cause == "missing_samples":
        return {"part": float(random.uniform(0.002, 0.05)), "length": float(random.uniform(1.0, 10.0))}
    jitter = wanted * noise / z.slope
    if jitter > MOST_JITTER * tick:
        raise Invisible(cause)
    return {"jitter": jitter}


def _of_visibility(case, cause, wanted, z, d):
    """Effects and what the baseline leaves of them over the noise: nearest to `wanted` of eight tries."""
    stiff = cause == "load_spring" and case.number >= DOMINANT_SINCE
    low, high, best = 1e-4, STIFFEST if stiff else 1.0, None
    for attempt in range(8):
        s = math.sqrt(low * high) if attempt else high
        effects = effects_of(cause, s, d, z, case.rig.omega_n, case.duration)
        trial = replace(case, causes=(cause,), rig=replace(case.rig, effects=effects))
        y, u = run(trial)
        found = _left(trial, y, u) / (case.noise_part * float(np.std(detrend(y))))
        if not attempt and not found >= LEAST * 1.05:
            raise Invisible(cause)
        if found >= LEAST and (
            best is None or abs(math.log(found / wanted)) < abs(math.log(best[1] / wanted))
        ):
            best = effects, found
        low, high = (s, high) if found < wanted else (low, s)
        if best and abs(math.log(best[1] / wanted)) < 0.15:
            break
    return best


def _left(case: Case, y, u) -> float:
    start = case.rig.K_L, case.rig.omega_n, case.rig.zeta
    bias = "load_bias" not in case.causes
    return best_baseline(y, u, case.tick, start, sees_speed=case.rig.sees_speed, bias=bias).rms


def supply_of(case: Case):
    """Relative supply pressure: moving where the stiffness depends on it."""
    if "pressure_dependent_stiffness" not in case.causes:
        return None
    random = np.random.default_rng([case.number, 5])
    swing = random.uniform(0.2, 0.4)
    return 0.9 + swing * np.sin(2.0 * math.pi * random.uniform(1.0, 2.5) / case.duration * case.t)


def run(case: Case, noise=None):
    """Readings and commands, without noise unless it is given."""
    t = case.t
    random = np.random.default_rng([case.number, 1])
    drive = make_drive(case.excitation, case.rig, t, case.volts, random, case.hysteresis)
    return simulate(case.rig, t, drive, noise, supply_of(case), torque_of(case), case.latency, seen_at(case))


def torque_of(case: Case):
    """What pushes the load from outside on the way to each row, as `simulate` takes it; None: nothing."""
    gusts = _gusts(case) if "gusts" in case.rig.effects else None
    if MEASURED not in case.rig.effects:
        return gusts
    f = channel_of(case)
    middle = 0.5 * (f + np.r_[f[:1], f[:-1]]) - np.median(f)
    pushed = case.rig.effects[MEASURED]["gain"] * middle
    return pushed if gusts is None else pushed + case.rig.effects["gusts"]["strength"] * gusts


def channel_of(case: Case):
    """The measured disturbance, of deviation 1 about a median for which the valve has been set; or None."""
    if MEASURED not in case.causes:
        return None
    random = np.random.default_rng([case.number, 6])
    keep = math.exp(-case.tick * case.rig.omega_n / CORRELATED)
    white = random.normal(0.0, math.sqrt(1.0 - keep * keep), len(case.t) + 1000)
    return random.uniform(-3.0, 3.0) + lfilter([1.0], [1.0, -keep], white)[1000:]


def seen_at(case: Case):
    """When samples are really taken; None: when the record says."""
    if "jitter" not in case.defects:
        return None
    late = np.random.default_rng([case.number, 2]).normal(0.0, case.defects["jitter"], len(case.t))
    return np.maximum.accumulate(np.maximum(case.t + late, 0.0))


def _gusts(case: Case):
    """A random torque of unit size that keeps its value for about 1 / omega_n."""
    random = np.random.default_rng([case.number, 3])
    keep = math.exp(-case.tick * case.rig.omega_n)
    white = random.normal(0.0, math.sqrt(1.0 - keep * keep), round(case.duration / case.tick))
    return lfilter([1.0], [1.0, -keep], white)
