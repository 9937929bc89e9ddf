"""Commands that repeat: what repeats with them is an answer, not a disturbance from outside."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.record import PERIOD

if TYPE_CHECKING:
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def in_step(cut: Cut, omega: float) -> bool:
    """Whether `omega` [rad/s] is a harmonic of a command, as far as its recording can tell."""
    return any(_in_step(recording, omega) for recording in cut.series)


def _in_step(recording: Series, omega: float) -> bool:
    period, lowest = relay_period_s(recording.t, recording.u), PERIOD.lowest_of_relay
    if period is None:
        period, lowest = command_period_s(recording.t, recording.u), PERIOD.lowest
    if period is None:
        return False
    order = omega * period / (2.0 * math.pi)
    if not lowest < order < PERIOD.harmonics + 0.5:
        return False
    return abs(order - round(order)) < min(period / float(recording.t[-1] - recording.t[0]), 0.5)


def relay_period_s(t: Array, u: Array) -> float | None:
    """Mean period of a command of two values that switches regularly [s], None of any other."""
    low, high = float(np.min(u)), float(np.max(u))
    if not np.all((u == low) | (u == high)):
        return None
    periods = np.diff(rises(t, u))
    if len(periods) < PERIOD.regular_cycles:
        return None
    regular = periods[np.abs(periods / np.median(periods) - 1.0) < PERIOD.irregular]
    return float(np.mean(regular)) if len(regular) > PERIOD.mostly_regular * len(periods) else None


def rises(t: Array, u: Array) -> Array:
    """When a command goes up [s]."""
    return np.asarray(t[1:][np.diff(u) > 0.0])


def command_period_s(t: Array, u: Array, shortest_s: float = PERIOD.shortest_s) -> float | None:
    """Period of a command that repeats itself at least three times [s], None if it does not."""
    rows = PERIOD.grid_rows
    even = np.linspace(t[0], t[-1], rows)
    x = np.interp(even, t, u)
    x = x - np.mean(x)
    power = np.abs(np.fft.rfft(x, 2 * rows)) ** 2
    alike = np.fft.irfft(power)[:rows] / np.arange(rows, 0, -1) / max(float(np.var(x)), 1e-300)
    tick = float(even[1] - even[0])
    below = np.flatnonzero(alike < PERIOD.unlike)
    if not len(below):
        return None
    first = max(int(below[0]), math.ceil(shortest_s / tick))
    last = int(rows / PERIOD.fewest_periods)
    if first >= last:
        return None
    near = first + np.flatnonzero(
        alike[first:last] > max(PERIOD.repeats_alike, PERIOD.near_best * float(np.max(alike[first:last])))
    )
    if not len(near):
        return None
    best = near[0] + int(np.argmax(alike[near[0] : near[0] + int(PERIOD.same_peak * near[0]) + 1]))
    return float(best * tick)


def finer_period_s(t: Array, u: Array, period: float) -> float:
    """A period by the sample at which the command is most alike, ever more periods later [s]."""
    tick, x = float(np.median(np.diff(t))), u - np.mean(u)
    lasts = t[-1] - t[0]
    reach, most = math.ceil(lasts / PERIOD.grid_rows / tick) + 1, int(PERIOD.compared_part * lasts / period)
    count = 1
    while count <= most:
        about = round(count * period / tick)
        lags = [lag for lag in range(about - reach, about + reach + 1) if 0 < lag < len(x)]
        if not lags:
            break
        miss = [float(np.mean((x[lag:] - x[: len(x) - lag]) ** 2)) for lag in lags]
        period, reach = lags[int(np.argmin(miss))] * tick / count, PERIOD.compared_rows
        count *= PERIOD.growth
    return period
