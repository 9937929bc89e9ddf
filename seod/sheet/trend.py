"""How a quantity went over the days, against its reference period and its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.calibrate.value import Value, measured
from seod.sheet.limits import DRIFT, GOOD
from seod.sheet.segments import Period

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date, datetime

    from seod.sheet.limits import Limit
    from seod.sheet.segments import Segment


class Estimate(NamedTuple):
    """One segment's: when it began, its value, its standard deviation."""

    t: datetime
    value: float
    sd: float


class Day(NamedTuple):
    """The mean of a day's estimates, and how many they are; `alarm`: it is beyond a limit."""

    day: date
    mean: Value
    estimates: int
    alarm: bool


class Reference(NamedTuple):
    """What a quantity is compared with: its mean over a period of so many estimates."""

    first: date
    last: date
    mean: Value
    estimates: int


@dataclass(frozen=True, slots=True)
class Trend:
    """A quantity of one axis over the sheet's period.

    Attributes:
        name: zeta, omega_n or K_L.
        unit: Its unit.
        estimates: Of all segments whose estimate is good.
        days: Means of each day.
        reference: None where there are no estimates in the reference period.
        drift: Last day over the reference, less 1; None without reference.
        limit: That was given, in place of the drift's.
        alarm: A sentence; "" where all is well.
    """

    name: str
    unit: str
    estimates: tuple[Estimate, ...]
    days: tuple[Day, ...]
    reference: Reference | None
    drift: Value | None
    limit: Limit | None
    alarm: str


def pooled(values: Sequence[float], sds: Sequence[float]) -> Value:
    """Mean of estimates that may differ by more than their standard deviations say (random effects).

    What they scatter beyond that is a variance that each has besides (DerSimonian and Laird 1986); the
    interval is then Student's.
    """
    x, own = np.asarray(values, float), np.asarray(sds, float) ** 2
    w = 1.0 / own
    n, mean = len(x), float(w @ x / w.sum())
    scale = float(w.sum() - (w @ w) / w.sum())
    between = max(0.0, (float(w @ (x - mean) ** 2) - (n - 1)) / scale) if n > 1 else 0.0
    w = 1.0 / (own + between)
    return measured(float(w @ x / w.sum()), 1.0 / math.sqrt(float(w.sum())), n - 1 if between else math.inf)


def half(value: Value) -> float:
    """Half the width of its 95 % interval."""
    return 0.5 * (value.interval[1] - value.interval[0])


def relative(value: Value, to: Value) -> Value:
    """One over the other, less 1, of independent means."""
    ratio = value.value / to.value
    sd = abs(ratio) * math.hypot(value.sd / value.value, to.sd / to.value)
    wide = abs(ratio) * math.hypot(half(value) / value.value, half(to) / to.value)
    return Value(ratio - 1.0, sd, (ratio - 1.0 - wide, ratio - 1.0 + wide))


def estimates(found: Sequence[Segment], name: str) -> tuple[Estimate, ...]:
    """Those of good quality."""
    good = (each for each in found if each.quality == GOOD and name in each.values)
    return tuple(Estimate(each.begin, *each.values[name]) for each in good)


def trend(
    name: str,
    unit: str,
    known: Sequence[Segment],
    period: Period,
    reference: Period | None,
    limit: Limit | None,
) -> Trend:
    """A quantity's course over `period`.

    Args:
        name: zeta, omega_n or K_L.
        unit: Its unit.
        known: All segments of the axis, of any time.
        period: Of the sheet.
        reference: To compare with; None: the first day of the period with good estimates.
        limit: In place of the drift's.
    """
    every = estimates(known, name)
    within = tuple(each for each in every if period.holds(each.t.date()))
    if reference is None and within:
        first = within[0].t.date()
        reference = Period(first, first)
    compared = [each for each in every if reference is not None and reference.holds(each.t.date())]
    standard = None
    if compared:
        span = compared[0].t.date(), compared[-1].t.date()
        standard = Reference(*span, _mean(compared), len(compared))
    days = tuple(
        _day(day, list(group), name, standard, limit)
        for day, group in groupby(within, key=lambda each: each.t.date())
    )
    drift = relative(days[-1].mean, standard.mean) if days and standard else None
    return Trend(name, unit, within, days, standard, drift, limit, _alarm(name, days, standard, limit))


def _mean(several: Sequence[Estimate]) -> Value:
    return pooled([each.value for each in several], [each.sd for each in several])


def _day(
    day: date, several: Sequence[Estimate], name: str, standard: Reference | None, limit: Limit | None
) -> Day:
    mean = _mean(several)
    return Day(day, mean, len(several), beyond(mean, name, standard, limit))


def beyond(mean: Value, name: str, standard: Reference | None, limit: Limit | None) -> bool:
    """The rule: the whole 95 % interval, of the value by a limit, of the drift by `DRIFT`, lies outside."""
    if limit is not None:
        return mean.interval[1] < limit.low or mean.interval[0] > limit.high
    if standard is None:
        return False
    low, high = relative(mean, standard.mean).interval
    return high < -DRIFT[name] or low > DRIFT[name]


def _alarm(name: str, days: Sequence[Day], standard: Reference | None, limit: Limit | None) -> str:
    alarming = [each for each in days if each.alarm]
    if not alarming:
        return ""
    count = f"{len(alarming)} of {len(days)} days"
    when = f"on {count}, first {alarming[0].day}, last {alarming[-1].day}"
    if limit is not None:
        return f"{name} is outside {limit.low:g} to {limit.high:g}, with its whole interval, {when}"
    assert standard is not None  # noqa: S101 - without a limit only a drift alarms
    drifts = [100.0 * relative(each.mean, standard.mean).value for each in alarming]
    worst = max(drifts, key=abs)
    return f"{name} has moved by up to {worst:+.3g} %, by more than {100.0 * DRIFT[name]:g} % {when}"
