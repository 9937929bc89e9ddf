"""Causes in the valve: what it does to the command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.causes.flow import null_of_load
from seod.diagnose.causes.record import (
    Alike,
    Cause,
    Grid,
    Hidden,
    Plain,
    linear,
    not_searched,
    signed,
    sized,
)
from sim.effects import LEAST_BETWEEN_KNOTS, MAP_BENDS, MAP_TILTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Array, Effects

    Worth = Callable[[Array], Array]

HALF_WIDTHS: Final = (0.004, 0.02, 0.1, 0.3)
"""Starts of a half width over the largest command: of a good valve to one that eats a third; chosen."""
HALF_WIDTH_SCALE: Final = 0.1
"""Size of a half width over the largest command, in whose steps it is searched; chosen."""
LIMITS: Final = (0.4, 0.6, 0.85)
"""Starts of a limit over the largest command; chosen."""
LEAST_LIMIT, LARGEST_LIMIT = 0.02, 1.5
"""Limit over the largest command, at least and at most: above 1 it does nothing."""
SHOWN_HALF_WIDTH, SHOWN_LIMIT = 0.1, 0.6
"""Over the largest command: sizes with which an experiment is tried out; chosen."""
LONGEST_S: Final = 0.1
LONGEST_TICKS: Final = 50.0
"""Of a delay or a lag [s], or over the sampling interval, at most: slow records are of slow rigs; chosen."""
LONGEST_START: Final = 0.5
"""Of a start over that, so that a fit may go either way."""
SHORTEST_LAG_TICKS: Final = 0.1
"""Over the sampling interval, at least: a shorter lag does not show in samples, and takes many substeps."""
SHORTEST_LAG_S: Final = 1e-5
"""Of a lag, at least [s]: the simulated plant's own limit."""
LEAST_SPOOL_DAMPING: Final = 0.3
"""Damping ratio of a spool with inertia, at least: a valve's own controller sees to it; chosen."""
CRITICAL: Final = 1.0
"""Damping ratio with which a search begins: of two lags in a row, from which either way is open."""
SLOW_LAG: Final = ({"*omega_n": 2.5, "*zeta": 0.2},)
"""Factors where a baseline took a lag for its damping, so that its plant does not oscillate; chosen."""
LIGHTEST_SPOOL_TICKS: Final = 2.0
"""Natural frequency of such a spool times the sampling interval, at most: no samples show a quicker one."""
RAMPS: Final = (0.3, 1.0, 3.0)
"""Starts of a valve of limited speed: radians of the plant for its way from one end to the other; chosen."""
LONGEST_RAMP: Final = 100.0
"""The same, at most: such a valve holds back all that the plant could do; chosen."""

NULL_SCALE, NULL_START = 0.1, 0.02
"""A valve's null over the largest command: size in whose steps it is searched, and a start; chosen."""

MAP_SIZE, LARGEST_MAP = 0.02, 1.0
"""Of what a valve's map adds, over the largest command: size in whose steps it is searched, and its limit."""
MAP_PLACE: Final = 0.1
"""Part of the range in whose steps a map's corners are searched."""
KNOTS, ROUNDING = (1.0 / 3.0, 2.0 / 3.0), 0.2
"""Corners of a map and how round they are, to begin with. From there least squares alone found three gains to
each side, drawn at random, to 0.1 % of what they add (median of 30; smooth curves to 2 %)."""
LEAST_SLOPE: Final = 0.05
"""Of a map, over its mean one, at least, with which a simpler cause begins in its place; chosen."""
LEAST_APART: Final = 2.0 * LEAST_BETWEEN_KNOTS
"""Between a map's corners, as part of its range: more than can be simulated, for the sake of rounding."""
FIRST_KNOT, LAST_KNOT = 0.05, 0.95
"""A map's corners are searched between: commands nearer to 0 or to the end are too few to tell them."""
LEVELS_OF_MAP: Final = 12
"""Different commands, more than which a map needs: two to each of its straight lines, to either side."""


def _worth(of: Mapping[str, float]) -> tuple[Array, Array, Array]:
    """Where the knots of a valve's map are, from 0 outwards, and what they are worth to either side [V]."""
    at = of["range"] * np.array([0.0, of["knot_1"], of["knot_2"], 1.0])
    size = at + np.array([0.0, *(of[name] for name in MAP_BENDS), 0.0])
    tilt = np.array([0.0, *(of[name] for name in MAP_TILTS)])
    return at, size + tilt, size - tilt


def _monotone(effects: Effects, s: Scales) -> None:
    """A valve's map lies over the commands of the recordings, and never falls from knot to knot."""
    of = effects["static_valve_map"]
    of["range"] = s.volts
    of["knot_1"] = min(of["knot_1"], LAST_KNOT - LEAST_APART)
    of["knot_2"] = max(of["knot_2"], of["knot_1"] + LEAST_APART)
    at, *worth = _worth(of)
    up, down = (np.maximum(np.minimum.accumulate(one[::-1])[::-1], 0.0) for one in worth)
    bend, tilt = 0.5 * (up + down) - at, 0.5 * (up - down)
    told = zip((*MAP_BENDS, *MAP_TILTS), (*bend[1:-1], *tilt[1:]), strict=True)
    of |= {name: float(value) for name, value in told}


def _load_of_null(values: Values, _: Scales) -> Values:
    """The constant load that is a null shift while the flow is straight."""
    return {"load_bias.acceleration": values["null_shift.voltage"] / null_of_load(values)}


def _worth_of(values: Values, s: Scales) -> tuple[Array, Array, Array]:
    """The same from what is searched of a map."""
    own = {place.removeprefix("static_valve_map."): value for place, value in values.items()}
    return _worth(own | {"range": s.volts})


def _as_map(values: Values, s: Scales, first: float, second: float, worth: Worth) -> Values:
    """A map of what commands are worth [V], with corners at these parts of its range, and its gain."""
    low = min(max(first, FIRST_KNOT), LAST_KNOT - LEAST_APART)
    at = s.volts * np.array([low, min(max(second, low + LEAST_APART), LAST_KNOT), 1.0])
    up, down = worth(at), -worth(-at)
    size = s.volts / max(0.5 * (up[-1] + down[-1]), LEAST_SLOPE * s.volts)
    bend, tilt = 0.5 * size * (up + down) - at, 0.5 * size * (up - down)
    told = dict(zip((*MAP_BENDS, *MAP_TILTS), (*bend[:-1], *tilt), strict=True))
    told |= {"knot_1": at[0] / s.volts, "knot_2": at[1] / s.volts, "rounding": ROUNDING}
    return {"K_L": values["K_L"] / size} | {
        f"static_valve_map.{of}": float(value) for of, value in told.items()
    }


def _of_saturation(values: Values, s: Scales) -> Values:
    """A map that saturates, with a corner before that."""
    limit = values["valve_saturation.limit"]
    return _as_map(values, s, 0.5 * limit / s.volts, limit / s.volts, lambda at: np.clip(at, -limit, limit))


def _of_overlap(values: Values, s: Scales) -> Values:
    """A map with a deadband, and a corner half way from there to its end."""
    half, part = values["valve_deadband.half_width"], values["valve_deadband.half_width"] / s.volts
    return _as_map(values, s, part, 0.5 * (1.0 + part), lambda at: at - np.clip(at, -half, half))


def _of_unequal(values: Values, s: Scales) -> Values:
    """A straight map to either side."""
    ratio = values["asymmetric_gain.ratio"]
    return _as_map(values, s, *KNOTS, lambda at: at + ratio * np.abs(at))


def _only_saturates(values: Values, s: Scales) -> Values:
    """The end that a map comes to, with the gain that it begins with.

    Of the side that opens less: commands may reach the end of one side alone.
    """
    at, up, down = _worth_of(values, s)
    gain = max(0.5 * (up[1] + down[1]) / at[1], LEAST_SLOPE)
    limit = max(min(up[-1], down[-1]), LEAST_LIMIT * s.volts) / gain
    return {"K_L": values["K_L"] * gain, "valve_saturation.limit": limit}


def _only_overlaps(values: Values, s: Scales) -> Values:
    """The command from which a map begins, with the gain that it has between its corners."""
    at, up, down = _worth_of(values, s)
    worth = 0.5 * (up + down)
    gain = max((worth[2] - worth[1]) / (at[2] - at[1]), LEAST_SLOPE)
    return {
        "K_L": values["K_L"] * gain,
        "valve_deadband.half_width": max(at[1] - worth[1] / gain, 0.0),
    }


def _only_unequal(values: Values, s: Scales) -> Values:
    """The gains that a map has at its ends."""
    return {"asymmetric_gain.ratio": values["static_valve_map.tilt_3"] / s.volts}


def _off(effects: Effects) -> float:
    """Most that a command is worth more or less [V]."""
    at, *worth = _worth(effects["static_valve_map"])
    return float(max(np.max(np.abs(one - at)) for one in worth))


def lag_starts(*radians: float) -> Callable[[Scales], tuple[tuple[float, ...], ...]]:
    """Times of so many radians of the plant's own frequency."""
    return lambda s: tuple((min(x * (1.0 / s.omega_n), LONGEST_START * longest(s)),) for x in radians)


def longest(s: Scales) -> float:
    """Of a delay or a lag, at most [s]."""
    return max(LONGEST_S, LONGEST_TICKS * s.tick_s)


def shortest_lag(s: Scales) -> float:
    """Least time of a lag [s]."""
    return max(SHORTEST_LAG_TICKS * s.tick_s, SHORTEST_LAG_S)


def same_time(own: str, *others: str) -> tuple[Alike, ...]:
    """Other causes that delay, alike at the same time; under a relay also a valve of limited speed."""

    def alike(other: str) -> Alike:
        return Alike(other, lambda values, _: {f"{other}.time": values[f"{own}.time"]})

    slow = Alike(
        "valve_rate_limit",
        lambda values, s: {"valve_rate_limit.rate": s.volts / max(values[f"{own}.time"], SHORTEST_LAG_S)},
        always=False,
    )
    return (*(alike(other) for other in others), slow)


def same_delay(*others: str) -> tuple[Alike, ...]:
    """Causes that delay as long as the middle of a ramp from one end of a relay's command to the other."""

    def alike(other: str) -> Alike:
        time = f"{other}.time"
        return Alike(other, lambda values, s: {time: s.volts / values["valve_rate_limit.rate"]}, always=False)

    return tuple(alike(other) for other in others)


def ramping(s: Scales, radians: float) -> float:
    """Speed [V/s] of a valve that needs so many radians of the plant from one end to the other."""
    return 2.0 * s.volts * s.omega_n / radians


def _spool_omega(time: float, damping: float) -> float:
    """Natural frequency [rad/s] of a spool with inertia, from its lag [s] and its damping ratio."""
    return 2.0 * damping / time


def _damped(effects: Effects, _: Scales) -> None:
    """A spool with inertia hardly oscillates."""
    spool = effects["spool_inertia"]
    spool["omega"] = max(spool["omega"], _spool_omega(effects["valve_lag"]["time"], LEAST_SPOOL_DAMPING))


def _spool_damping(effects: Effects) -> float:
    return 0.5 * effects["valve_lag"]["time"] * effects["spool_inertia"]["omega"]


def _shown(place: str, part: float) -> Callable[[float], Values]:
    return lambda volts: {place: part * volts}


TRANSPORT_DELAY: Final = Cause(
    name="transport_delay",
    says="The command reaches the valve late: a bus, an amplifier's electronics, or the loop's own tick.",
    coordinates=lambda s: (linear("time", 1.0 / s.omega_n, 0.0, longest(s)),),
    starts=lag_starts(0.05, 0.3),
    alike=same_time("transport_delay", "sensor_lag", "valve_lag"),
    delays=True,
)
VALVE_SATURATION: Final = Cause(
    name="valve_saturation",
    says="The valve or its amplifier has an end: more voltage opens no further.",
    coordinates=lambda s: (sized("limit", LEAST_LIMIT * s.volts, LARGEST_LIMIT * s.volts),),
    starts=lambda s: tuple((x * s.volts,) for x in LIMITS),
    searched=lambda s: not s.two_commands,
    hidden=Hidden(_shown("valve_saturation.limit", SHOWN_LIMIT), "six tenths as limit"),
)
STATIC_VALVE_MAP: Final = Cause(
    name="static_valve_map",
    says="The valve's gain differs by level and direction: a command is worth up to {figure} V more or less.",
    coordinates=lambda s: (
        *(signed(of, MAP_SIZE * s.volts, LARGEST_MAP * s.volts) for of in (*MAP_BENDS, *MAP_TILTS)),
        *(linear(of, MAP_PLACE, FIRST_KNOT, LAST_KNOT) for of in ("knot_1", "knot_2")),
        linear("rounding", MAP_PLACE, 0.0, 1.0),
    ),
    starts=lambda _: ((*(0.0 for _ in (*MAP_BENDS, *MAP_TILTS)), *KNOTS, ROUNDING),),
    searched=lambda s: s.levels > LEVELS_OF_MAP,
    within=_monotone,
    plain=(
        Plain("valve_saturation", becomes=_only_saturates, grows=_of_saturation, beside=False),
        Plain("valve_deadband", becomes=_only_overlaps, grows=_of_overlap, beside=False),
        Plain("asymmetric_gain", becomes=_only_unequal, grows=_of_unequal, beside=False),
    ),
    mirrored=MAP_TILTS,
    figure=_off,
)
VALVE_HYSTERESIS: Final = Cause(
    name="valve_hysteresis",
    says="The valve's spool lags behind where the command turns: magnetic hysteresis, or a spool that rubs.",
    coordinates=lambda s: (linear("half_width", HALF_WIDTH_SCALE * s.volts, 0.0, s.volts),),
    starts=lambda s: tuple((x * s.volts,) for x in HALF_WIDTHS),
    searched=lambda s: not s.two_commands,
    hidden=Hidden(
        _shown("valve_hysteresis.half_width", SHOWN_HALF_WIDTH), "a tenth of the command as half width"
    ),
)
VALVE_LAG: Final = Cause(
    name="valve_lag",
    says="The valve's spool follows its command as a first-order lag.",
    coordinates=lambda s: (linear("time", 1.0 / s.omega_n, shortest_lag(s), longest(s)),),
    starts=lag_starts(0.1, 0.5),
    remote=SLOW_LAG,
    alike=same_time("valve_lag", "sensor_lag", "transport_delay"),
    delays=True,
)
SPOOL_INERTIA: Final = Cause(
    name="spool_inertia",
    says="The spool's lag is of second order, with a damping ratio of {figure}.",
    coordinates=lambda s: (
        sized("omega", _spool_omega(longest(s), LEAST_SPOOL_DAMPING), LIGHTEST_SPOOL_TICKS / s.tick_s),
    ),
    starts=lambda s: tuple((_spool_omega(time, CRITICAL),) for (time,) in lag_starts(0.5)(s)),
    within=_damped,
    plain=(
        Plain(
            "valve_lag",
            becomes=None,
            grows=lambda v, _: {"spool_inertia.omega": _spool_omega(v["valve_lag.time"], CRITICAL)},
        ),
    ),
    figure=_spool_damping,
)
VALVE_RATE_LIMIT: Final = Cause(
    name="valve_rate_limit",
    says="The valve's spool goes no faster: its pilot stage, or the current of its motor, is at its end.",
    coordinates=lambda s: (
        sized("rate", ramping(s, LONGEST_RAMP), 2.0 * s.volts / (SHORTEST_LAG_TICKS * s.tick_s)),
    ),
    starts=lambda s: tuple((ramping(s, x),) for x in RAMPS),
    alike=same_delay("sensor_lag", "transport_delay", "valve_lag"),
    grid=Grid(ramps=lambda lasts, height: {"valve_rate_limit.rate": height / lasts}),
)
NULL_SHIFT: Final = Cause(
    name="null_shift",
    says="The valve is closed at another voltage than 0.",
    coordinates=lambda s: (signed("voltage", NULL_SCALE * s.volts, s.volts),),
    starts=lambda s: ((NULL_START * s.volts,),),
    searched=not_searched,
    plain=(Plain("load_bias", becomes=_load_of_null),),
    alike=(Alike("load_bias", _load_of_null),),
    mirrored=("voltage",),
)
VALVE_DEADBAND: Final = Cause(
    name="valve_deadband",
    says="The valve's spool overlaps its ports: around its centre it opens nothing.",
    coordinates=lambda s: (linear("half_width", HALF_WIDTH_SCALE * s.volts, 0.0, s.volts),),
    starts=lambda s: tuple((x * s.volts,) for x in HALF_WIDTHS),
    searched=lambda s: not s.two_commands,
    hidden=Hidden(
        _shown("valve_deadband.half_width", SHOWN_HALF_WIDTH), "a tenth of the command as half width"
    ),
)
VALVE: Final = (
    TRANSPORT_DELAY,
    VALVE_SATURATION,
    STATIC_VALVE_MAP,
    VALVE_HYSTERESIS,
    VALVE_LAG,
    SPOOL_INERTIA,
    VALVE_RATE_LIMIT,
    NULL_SHIFT,
    VALVE_DEADBAND,
)
