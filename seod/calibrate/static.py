"""Gain and null from the steady speeds at several voltages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.calibrate.value import Value, measured

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.calibrate.recording import Recording

SAME_PRESSURE = 0.03
"""Pressures that differ by less than this share belong to one group."""


UNSETTLED = 1e-4
"""What is left of the step response where a drive counts as steady, in parts of the speed: it is in all
points alike, so that no scatter shows it."""


@dataclass(frozen=True, slots=True)
class Point:
    """One steady speed: volts [V], speed and its standard deviation [axis unit/s], supply pressure [Pa]."""

    volts: float
    speed: float
    sd: float
    ps: float = math.nan


@dataclass(frozen=True, slots=True)
class Line:
    """speed = K_L (volts - zero), outside the deadband.

    Attributes:
        K_L: Gain [axis unit/s/V].
        zero: Voltage at which the line meets no speed [V].
        dof: Degrees of freedom that the standard deviations stand on.
        scatter: Scatter about the line in units of what the samples' noise explains; near 1 if all is well.
    """

    K_L: Value
    zero: Value
    dof: int
    scatter: float


@dataclass(frozen=True, slots=True)
class Static:
    """Static characteristic: gain, mean and by direction (None where not driven), null [V], pressure [Pa]."""

    K_L: Value
    null: Value
    up: Line | None
    down: Line | None
    ps: float


def steady_speed(drive: Recording, after: float, measures_speed: bool) -> Point:
    """Speed of a drive from `after` [s] past its step on: the slope of a position, the mean of a speed.

    Raises:
        ValueError: Too little is left to measure.
    """
    steady = drive.t >= drive.step_t + after
    t, y = drive.t[steady], drive.y[steady]
    if len(t) < 8:
        raise ValueError(f"only {len(t)} samples of a drive at {drive.volts:g} are steady")
    order = 0 if measures_speed else 1
    centred = t - t.mean()
    coefficients = np.polynomial.polynomial.polyfit(centred, y, order)
    residual = y - np.polynomial.polynomial.polyval(centred, coefficients)
    noise = math.sqrt(float(residual @ residual) / (len(t) - order - 1))
    weight = math.sqrt(len(t)) if measures_speed else math.sqrt(float(centred @ centred))
    return Point(drive.volts, float(coefficients[order]), max(noise, 1e-12) / weight, drive.ps)


def fit_line(points: Sequence[Point]) -> Line:
    """Weighted line; standard deviations from the scatter about it.

    Raises:
        ValueError: Fewer than three points, or no gain in them.
    """
    if len(points) < 3:
        raise ValueError(f"{len(points)} speeds are too few for a line")
    volts, speed, sd = np.array([(p.volts, p.speed, p.sd) for p in points]).T
    w = 1.0 / sd**2
    middle = float(w @ volts / w.sum())
    x = volts - middle
    level, spread = float(w @ speed / w.sum()), float(w @ x**2)
    if spread == 0.0:
        raise ValueError("all speeds were measured at one voltage: they have no slope")
    gain = float(w @ (x * speed)) / spread
    if gain == 0.0:
        raise ValueError("the speed does not depend on the voltage")
    dof = len(points) - 2
    scatter = math.sqrt(float(w @ (speed - level - gain * x) ** 2) / dof)
    gain_sd, level_sd = scatter / math.sqrt(spread), scatter / math.sqrt(float(w.sum()))
    gain_sd = math.hypot(gain_sd, UNSETTLED * gain)
    zero_sd = math.hypot(level_sd, level / gain * gain_sd) / abs(gain)
    zero = measured(middle - level / gain, zero_sd, dof)
    return Line(measured(gain, gain_sd, dof), zero, dof, scatter)


def characteristic(points: Sequence[Point], centre: float) -> Static:
    """Static characteristic from points outside the deadband, above and below `centre` [V].

    Null is the middle between the zeros of both directions; with one direction alone, its zero.
    """
    lines = []
    for above in (True, False):
        side = [point for point in points if (point.volts > centre) == above]
        lines.append(fit_line(side) if side else None)
    up, down = lines
    known = [line for line in lines if line is not None]
    dof = sum(line.dof for line in known)
    K_L = _middle([line.K_L for line in known], dof)
    null = _middle([line.zero for line in known], dof)
    return Static(K_L, null, up, down, float(np.mean([point.ps for point in points])))


def _middle(values: list[Value], dof: int) -> Value:
    """Middle of one value or two that are independent."""
    n = len(values)
    return measured(sum(v.value for v in values) / n, math.hypot(*(v.sd for v in values)) / n, dof)


def by_pressure(statics: Sequence[Static]) -> list[Static]:
    """One for each supply pressure, ascending; of those at about the same pressure one counts."""
    kept: list[Static] = []
    for static in sorted(statics, key=lambda each: each.ps):
        if not kept or not abs(static.ps - kept[-1].ps) <= SAME_PRESSURE * kept[-1].ps:
            kept.append(static)
    return kept
