"""Causes between the load and its reading."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.polynomial import Legendre

from seod.diagnose.causes.cause import (
    Cause,
    Cycle,
    Grid,
    Wave,
    linear,
    no_coordinates,
    not_searched,
    signed,
    sized,
)
from seod.diagnose.causes.valve import lag_starts, longest, same_time, shortest_lag
from sim.effects import LEAST, NEAR, SENSOR_CURVE

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.result import Array, Effects

SLOWED_BY_BACKLASH: Final = ({"*K_L": 3.0, "*omega_n": 3.0},)
"""Factors where a baseline took a limit cycle that backlash made slow for the plant's own frequency."""
GAP_SCALE, LEAST_GAP, WIDEST_GAP = 0.1, 1e-4, 12.0
"""Backlash over the oscillation that it leaves, peak to peak: size of its steps in a search, at least and at
most; chosen."""
GAPS: Final = (0.006, 0.03, 0.15, 0.5)
"""Starts of it; chosen."""
GRID_GAPS: Final = (0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92)
"""Backlash in the relay's grid, over the oscillation without it: denser where it takes nearly all."""
GRID_GAPS_PAIRED: Final = (0.15, 0.35, 0.6, 0.9)
"""The same beside friction, which makes the oscillation smaller."""
LEAST_MOVEMENT: Final = 1e-3
"""Least oscillation, peak to peak, that a backlash is a share of, over half of that without effects."""
RIPPLE_SIZE: Final = 0.01
"""Amplitude over the movement, peak to peak, in whose steps a ripple is searched; chosen."""
RIPPLE_NARROW: Final = 0.03
"""Radians over the travel by which a step of the wavenumber turns its end; chosen."""
STEPS_IN_A_WAVE: Final = 2.0
"""Of a coarse sensor to a wave, at least: at the ends of its steps a shorter one looks like a longer one."""
MOST_WAVES: Final = 1e5
"""Of a ripple over the travel: more are noise between samples; chosen."""
CURVE_SIZE: Final = 0.01
"""Part of the travel in whose steps a sensor's curve is searched; chosen."""
LARGEST_CURVE: Final = 0.3
"""Of each of its parts, over the travel: with more the reading turns round, though the load does not."""
CURVE_MARGIN: Final = 1.05
"""Half of the curve's travel over half of that of the readings, which are bent themselves; chosen."""
CURVE_POINTS: Final = 201
"""Over its travel, at which its largest deviation is looked for."""
RECTIFIED_SCALE, LARGEST_RECTIFIED = 0.1, 1.1
"""Of a rectified sensor: what half of the change below 0 is over the reading; size in whose steps it is
searched, and its limit: a fifth steeper below 0. What counts or rectifies treats both ways alike; chosen."""
POWERS: Final = (1.0, 2.0)
"""Starts of the power of such a reading: what is counted, and a pressure drop or a power."""
LEAST_POWER, LARGEST_POWER = 0.5, 3.0
"""Of a rectified sensor's reading: the simulated plant's own limits."""


def _gap(shares: Values, sizes: Values, cycle: Cycle) -> Values:
    moves = max(cycle.peak_to_peak(sizes), LEAST_MOVEMENT * cycle.half)
    return {"backlash.gap": max(shares["backlash.gap"] * moves, LEAST["backlash.gap"])}


def _widest_gap(s: Scales) -> float:
    """All of the travel: between far moves the baseline may ring, and its oscillation be small [unit]."""
    return max(WIDEST_GAP * s.peak_to_peak, s.travel)


def _repeating(s: Scales) -> tuple[float, float]:
    """Wavenumbers of a ripple [rad/unit]: longer waves are a bend, shorter ones a sensor's rounding."""
    most = 2.0 * math.pi * MOST_WAVES / s.travel
    highest = 2.0 * math.pi / (STEPS_IN_A_WAVE * s.step) if s.step > 0.0 else most
    return min(2.0 * math.pi * OVER_PLACE.fewest / s.travel, 0.5 * highest), highest


def _over_travel(effects: Effects, s: Scales) -> None:
    """A sensor's curve lies over the travel of the recordings."""
    effects["sensor_nonlinearity"] |= {"centre": s.middle, "half": max(NEAR, 0.5 * CURVE_MARGIN * s.travel)}


def _over_readings(effects: Effects, s: Scales) -> None:
    """A rectified sensor of any power shows the largest reading alike."""
    effects["rectified_sensor"]["range"] = max(NEAR, s.reading)


def _unbent(y: Array, start: Values, s: Scales) -> Array:
    """Readings as a straight sensor would show them."""
    size = s.reading * (np.abs(y) / s.reading) ** (1.0 / start["rectified_sensor.power"])
    return np.asarray(np.copysign(size, y))


def _bend(effects: Effects) -> float:
    """Largest deviation of a sensor's curve from a straight line [unit]."""
    curve = Legendre([0.0, 0.0, *(effects["sensor_nonlinearity"][f"order_{n}"] for n in SENSOR_CURVE)])
    return float(np.max(np.abs(curve(np.linspace(-1.0, 1.0, CURVE_POINTS)))))


OVER_PLACE: Final = Wave("wavenumber", "place", fewest=1.0, unrepeated="sensor_nonlinearity")
BACKLASH: Final = Cause(
    name="backlash",
    says="There is backlash between the actuator and what is measured: a turn shows once the gap is used up.",
    coordinates=lambda s: (
        linear("gap", GAP_SCALE * s.peak_to_peak, LEAST_GAP * s.peak_to_peak, _widest_gap(s)),
    ),
    starts=lambda s: tuple((x * s.peak_to_peak,) for x in GAPS),
    remote=lambda _: SLOWED_BY_BACKLASH,
    grid=Grid(
        sizes=_gap,
        alone=tuple({"backlash.gap": x} for x in GRID_GAPS),
        paired=tuple({"backlash.gap": x} for x in GRID_GAPS_PAIRED),
    ),
    states=("loose",),
    gap="gap",
)
POSITION_RIPPLE: Final = Cause(
    name="position_ripple",
    says="The sensor's error repeats over the travel: an eccentric encoder, a pole pitch.",
    coordinates=lambda s: OVER_PLACE.coordinates(
        "position_ripple", RIPPLE_SIZE * s.peak_to_peak, RIPPLE_NARROW / s.travel, *_repeating(s)
    ),
    states=("position",),
    wave=OVER_PLACE,
)
SENSOR_NONLINEARITY: Final = Cause(
    name="sensor_nonlinearity",
    says="The reading is a curve over the position, {figure} (unit of position) off a straight line: "
    "a linkage, or an eccentric encoder.",
    coordinates=lambda s: tuple(
        signed(f"order_{n}", CURVE_SIZE * s.travel, LARGEST_CURVE * s.travel) for n in SENSOR_CURVE
    ),
    starts=lambda _: ((0.0,) * len(SENSOR_CURVE),),
    searched=lambda s: not s.sees_speed,
    within=_over_travel,
    figure=_bend,
)
SENSOR_LAG: Final = Cause(
    name="sensor_lag",
    says="The sensor or its converter follows as a low-pass of first order.",
    coordinates=lambda s: (linear("time", 1.0 / s.omega_n, shortest_lag(s), longest(s)),),
    starts=lag_starts(0.1, 0.5),
    alike=same_time("sensor_lag", "transport_delay", "valve_lag", lag="valve_lag"),
    delays=True,
    states=("lagged",),
    tells_lags_apart=False,
)
RECTIFIED_SENSOR: Final = Cause(
    name="rectified_sensor",
    says="The sensor is not straight: it reads the absolute value, or a power, of what moves.",
    coordinates=lambda _: (
        linear("part", RECTIFIED_SCALE, 0.0, LARGEST_RECTIFIED),
        sized("power", LEAST_POWER, LARGEST_POWER),
    ),
    starts=lambda _: tuple((1.0, power) for power in POWERS),
    within=_over_readings,
    unsigned=_unbent,
)
SENSOR_QUANTIZATION: Final = Cause(
    name="sensor_quantization",
    says="The sensor reads in steps, which the samples themselves show.",
    coordinates=no_coordinates,
    searched=not_searched,
    tells_lags_apart=False,
)
HELD_READINGS: Final = Cause(
    name="held_readings",
    says="The sensor is slower than the recording: rows repeat its last reading until the next one.",
    coordinates=no_coordinates,
    searched=not_searched,
)
SENSOR: Final = (
    BACKLASH,
    POSITION_RIPPLE,
    SENSOR_NONLINEARITY,
    SENSOR_LAG,
    RECTIFIED_SENSOR,
    HELD_READINGS,
    SENSOR_QUANTIZATION,
)
