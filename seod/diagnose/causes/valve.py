"""Causes in the valve: what it does to the command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from seod.diagnose.causes.cause import (
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
from seod.diagnose.causes.flow import null_of_load

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Effects

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
LONGEST_RADIANS: Final = 4.0
"""Of a delay or a lag [s], over the sampling interval, or in radians of the baseline's plant, the longest of
these, at most: slow records are of slow rigs, and a slow rig may be recorded quickly; chosen."""
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


def _load_of_null(values: Values, _: Scales) -> Values:
    """The constant load that is a null shift while the flow is straight."""
    return {"load_bias.acceleration": values["null_shift.voltage"] / null_of_load(values)}


def lag_starts(*radians: float) -> Callable[[Scales], tuple[tuple[float, ...], ...]]:
    """Starts of a time [s]: of so many radians of the plant's own frequency each."""
    return lambda s: tuple((min(x * (1.0 / s.omega_n), LONGEST_START * longest(s)),) for x in radians)


def longest(s: Scales) -> float:
    """Of a delay or a lag, at most [s]."""
    return max(LONGEST_S, LONGEST_TICKS * s.tick_s, LONGEST_RADIANS / s.omega_n)


def shortest_lag(s: Scales) -> float:
    """Least time of a lag [s]."""
    return max(SHORTEST_LAG_TICKS * s.tick_s, SHORTEST_LAG_S)


def same_time(own: str, *others: str, lag: str = "") -> tuple[Alike, ...]:
    """Other causes that delay, alike at the same time; at two commands and no more also a limited speed.

    Args:
        own: Name of this one.
        others: Names of those.
        lag: Of those the one that is such a lag, too, elsewhere in the signal's way; "" of a delay.
    """

    def alike(other: str) -> Alike:
        time = f"{other}.time"
        return Alike(other, lambda values, _: {time: values[f"{own}.time"]}, commutes=other == lag)

    slow = Alike(
        "valve_rate_limit",
        lambda values, s: {"valve_rate_limit.rate": s.volts / max(values[f"{own}.time"], SHORTEST_LAG_S)},
        two_commands_only=True,
    )
    return (*(alike(other) for other in others), slow)


def same_delay(*others: str) -> tuple[Alike, ...]:
    """Causes, by name, that delay as long as the middle of a ramp from one of two commands to the other."""

    def alike(other: str) -> Alike:
        time = f"{other}.time"
        return Alike(
            other, lambda values, s: {time: s.volts / values["valve_rate_limit.rate"]}, two_commands_only=True
        )

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
    pure_delay="time",
    tells_lags_apart=False,
)
VALVE_SATURATION: Final = Cause(
    name="valve_saturation",
    says="The valve or its amplifier has an end: more voltage opens no further.",
    coordinates=lambda s: (sized("limit", LEAST_LIMIT * s.volts, LARGEST_LIMIT * s.volts),),
    starts=lambda s: tuple((x * s.volts,) for x in LIMITS),
    searched=lambda s: not s.two_commands,
    hidden=Hidden(_shown("valve_saturation.limit", SHOWN_LIMIT), "six tenths as limit"),
    tells_lags_apart=False,
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
    tells_lags_apart=False,
)
VALVE_LAG: Final = Cause(
    name="valve_lag",
    says="The valve's spool follows its command as a first-order lag.",
    coordinates=lambda s: (linear("time", 1.0 / s.omega_n, shortest_lag(s), longest(s)),),
    starts=lag_starts(0.1, 0.5),
    remote=lambda _: SLOW_LAG,
    alike=same_time("valve_lag", "sensor_lag", "transport_delay", lag="sensor_lag"),
    delays=True,
    tells_lags_apart=False,
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
    tells_lags_apart=False,
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
    ramps="rate",
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
    tells_lags_apart=False,
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
    alike=(
        Alike(
            "coulomb_friction",
            lambda v, _: {
                "coulomb_friction.level": abs(v["valve_deadband.half_width"] / null_of_load(v)),
            },
        ),
    ),
)
VALVE: Final = (
    TRANSPORT_DELAY,
    VALVE_SATURATION,
    VALVE_HYSTERESIS,
    VALVE_LAG,
    SPOOL_INERTIA,
    VALVE_RATE_LIMIT,
    NULL_SHIFT,
    VALVE_DEADBAND,
)
