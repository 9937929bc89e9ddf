"""A valve's gain by level and direction: a map of what commands are worth, and simpler causes in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.causes.cause import Cause, Elsewhere, Plain, linear, signed
from seod.diagnose.causes.valve import LEAST_LIMIT
from sim.effects import LEAST_BETWEEN_KNOTS, MAP_BENDS, MAP_TILTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Array, Effects

    Worth = Callable[[Array], Array]

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
COMPARED, WIDEST_BAND = 101, 0.9
"""Commands at which a map is compared with a deadband, and the widest of these over the range; chosen."""
LEVELS_OF_MAP: Final = 12
"""Different commands, more than which a map needs: two to each of its straight lines, to either side."""

BEFORE_THE_PORTS: Final = frozenset({"valve_hysteresis", "valve_lag", "spool_inertia", "valve_rate_limit"})
"""Causes between the command and the spool's ports: beside one of them it shows which of both a map is of."""


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
    of |= _apart(of)
    at, *worth = _worth(of)
    up, down = (np.maximum(np.minimum.accumulate(one[::-1])[::-1], 0.0) for one in worth)
    bend, tilt = 0.5 * (up + down) - at, 0.5 * (up - down)
    told = zip((*MAP_BENDS, *MAP_TILTS), (*bend[1:-1], *tilt[1:]), strict=True)
    of |= {name: float(value) for name, value in told}


def _worth_of(values: Values, s: Scales) -> tuple[Array, Array, Array]:
    """The same from what is searched."""
    own = {place.removeprefix("static_valve_map."): value for place, value in values.items()}
    return _worth(own | {"range": s.volts} | _apart(own))


def _apart(of: Mapping[str, float]) -> dict[str, float]:
    """Corners in order, as parts of the range, as far from each other as is simulated."""
    first = min(of["knot_1"], LAST_KNOT - LEAST_APART)
    return {"knot_1": first, "knot_2": max(of["knot_2"], first + LEAST_APART)}


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


def _of_deadband(values: Values, s: Scales) -> Values:
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


def _only_deadband(values: Values, s: Scales) -> Values:
    """The deadband and gain that come nearest to a map, whatever corner either of them has."""
    at, up, down = _worth_of(values, s)
    u, worth = np.linspace(0.0, at[-1], COMPARED), 0.5 * (up + down)
    slopes = np.maximum(np.diff(worth) / np.diff(at), LEAST_SLOPE)
    halves = np.clip(np.r_[u, at[1:] - worth[1:] / slopes], 0.0, WIDEST_BAND * at[-1])
    worth, beyond = np.interp(u, at, worth), np.maximum(u - halves[:, None], 0.0)
    gains = np.maximum(beyond @ worth / np.sum(beyond**2, axis=1), LEAST_SLOPE)
    best = int(np.argmin(np.sum((worth - gains[:, None] * beyond) ** 2, axis=1)))
    return {"K_L": values["K_L"] * float(gains[best]), "valve_deadband.half_width": float(halves[best])}


def _only_unequal(values: Values, s: Scales) -> Values:
    """The gains that a map has at its ends."""
    return {"asymmetric_gain.ratio": values["static_valve_map.tilt_3"] / s.volts}


def _only_shifted(values: Values, _: Scales) -> Values:
    """A null elsewhere: what a map adds of one sign, the mean of it."""
    tilts = [values[f"static_valve_map.{of}"] for of in MAP_TILTS]
    return {"null_shift.voltage": -sum(tilts) / len(tilts)}


def _off(effects: Effects) -> float:
    """Most that a command is worth more or less [V]."""
    at, *worth = _worth(effects["static_valve_map"])
    return float(max(np.max(np.abs(one - at)) for one in worth))


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
        Plain("valve_saturation", becomes=_only_saturates, grows=_of_saturation, adds=False),
        Plain("valve_deadband", becomes=_only_deadband, grows=_of_deadband, adds=False),
        Plain("asymmetric_gain", becomes=_only_unequal, grows=_of_unequal, adds=False),
        Plain("null_shift", becomes=_only_shifted, adds=False),
    ),
    elsewhere=Elsewhere("at_ports", BEFORE_THE_PORTS),
    mirrored=MAP_TILTS,
    figure=_off,
    tells_lags_apart=False,
)
VALVE_MAP: Final = (STATIC_VALVE_MAP,)
