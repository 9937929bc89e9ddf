"""What every estimator takes and gives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping


class Row(NamedTuple):
    """One tick of one axis, in SI units of the axis (rad or m, V, s).

    `y` was sampled at `t`; `u` was computed from it, left at `t_u` and holds until the next row's.
    """

    t: float
    y: float
    u: float
    t_u: float
    reference: float
    """Set point of the relay's input signal e = reference - y."""
    e_a: float
    """Relay amplitude in force [V]; 0 while the relay is not exciting (entry ramp included: it ramps)."""
    bias: float
    """Voltage added behind the relay [V]."""
    exciting: bool
    """The relay is on at full amplitude: this row belongs to a limit cycle."""
    fresh: bool = True
    """False if no new sample arrived for this tick (`t`, `y` repeat the last one)."""
    K_L: float = math.nan
    """Plant gain in force [axis unit/s/V]; nan: the one of the settings."""
    saturated: bool = False
    """The sample lies where its sensor clips."""
    second: bool = False
    """The relay is in the second phase of two: its switches come late on purpose."""
    speed: float = math.nan
    """Where speed is measured, and `y` stands for its integral: that speed [axis unit/s]."""


QUALITIES = (
    "ok",
    "settling",
    "no_oscillation",
    "asymmetric",
    "nonlinear",
    "noisy",
    "saturated",
    "stale",
    "out_of_range",
    "fault",
)


class Dependence(NamedTuple):
    """How an answer differs from that at another amplitude, as parts of the latter; None: certain in both."""

    other_e_a: float
    """[V]"""
    zeta: float
    omega_n: float
    K_L: float | None
    sds: float
    """The most significant of these differences, in its standard deviations."""
    matters: bool
    """Whether one is significant and larger than allowed."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One answer of an estimator. None means undefined; never nan.

    Units: zeta [-], omega_n and frequency [rad/s], K_L [axis unit/s/V], delay_s [s], amplitude [axis unit],
    asymmetry [-] (duty of the positive half minus 1/2), mean_speed [axis unit/s], fitness [0..1].
    """

    t: float
    """End of the window [s, CLOCK_MONOTONIC]."""
    method: str
    quality: str
    zeta: float | None = None
    zeta_sd: float | None = None
    omega_n: float | None = None
    omega_n_sd: float | None = None
    K_L: float | None = None
    K_L_sd: float | None = None
    delay_s: float | None = None
    delay_sd_s: float | None = None
    """Standard deviation of `delay_s` where it is estimated [s]; 0: it is certain."""
    frequency: float | None = None
    amplitude: float | None = None
    asymmetry: float | None = None
    mean_speed: float | None = None
    fitness: float | None = None
    ps: float | None = None
    """Supply pressure [Pa]; like `temperature` [K] from the axis' sensors, not from the estimator."""
    temperature: float | None = None
    misfit: float | None = None
    """What repeats in each cycle but is not the linear plant's, as a part of the motion (RMS)."""
    lag_s: float | None = None
    """Age of the window's middle when it ended [s]: so much the answer lags behind a drifting plant."""
    correlation: Mapping[str, float] | None = None
    """Of the estimated unknowns, by pairs: "zeta,omega_n" and, where they are free, "K_L" and "delay"."""
    e_a_dependence: Dependence | None = None
    """How it differs from the answer at another amplitude of the relay; not from the estimator."""
    advice: str | None = None
    """What a person should do about a quality that is not ok."""


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """What an estimator knows beforehand.

    Attributes:
        method: `peaks`, `exact` or `wave`.
        K_L: Plant gain [axis unit/s/V], for rows that do not tell theirs.
        hysteresis: Half-width eps of the relay's hysteresis [axis unit]; switches at e = +eps and -eps.
        delay_s: Known delay between `t_u` and the actuator [s], and pure delay of the sensor.
        period_s: Nominal tick period [s].
        cycles: Window in cycles over which agreement is judged and estimates are averaged.
        lowpass_hz: Cut-off of the low-pass of section 2.3(2) for `peaks`; None for no filter.
        lag_s: Time constant of the sensor's first-order lag [s]; `exact` and `wave` take it back.
        K_L_sd: How well K_L is known [axis unit/s/V]: 0 is certain, inf is not at all.
        delay_sd: Likewise the delay [s].
        resolution: Step of the sensor [axis unit, or axis unit/s]; 0: fine.
        integrated: `Row.y` is the integral of a measured speed, `Row.speed`, to which `wave` looks.
    """

    method: str
    K_L: float
    hysteresis: float
    delay_s: float
    period_s: float
    cycles: int
    lowpass_hz: float | None
    lag_s: float = 0.0
    K_L_sd: float = 0.0
    delay_sd: float = 0.0
    resolution: float = 0.0
    integrated: bool = False


class Estimator(Protocol):
    """Fed row by row, answers each half cycle."""

    method: ClassVar[str]

    def update(self, row: Row) -> Estimate | None:
        """Take one row; an estimate when a half cycle has just ended or the state of the answer changed."""

    def reset(self) -> None:
        """Forget the plant (fault, new excitation, changed settings)."""

    def inherit(self, before: Estimator) -> None:
        """Take over what an estimator of other settings has learnt of the rig itself."""


def finite_or_none(x: float) -> float | None:
    """`x`, or None where it is nan or infinite: the stream's form of undefined."""
    return x if math.isfinite(x) else None
