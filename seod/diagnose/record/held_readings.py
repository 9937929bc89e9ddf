"""A sensor slower than the record: each of its readings is repeated in the rows until the next one comes.

Readings change at rows that lie on the sensor's own clock, an even grid; what a slow load or a coarse sensor
repeats does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask

FEWEST_READINGS: Final = 40
"""New readings without which no clock is looked for."""
LEAST_HELD: Final = 1.2
"""Rows for each reading, at least, in the median or the mean: with fewer nothing is lost."""
ON_CLOCK: Final = 0.95
"""Part of the new readings that come in the first row after a tick of the clock, at least."""
LONE_READINGS: Final = 0.5
"""Part of the clock's ticks that bring a new reading, at least: a load at rest has none."""
SINGLE_COUNTS: Final = 0.9
"""Part of the changes that are of one size, from which on they are a coarse sensor's counts."""
SAME_ROW: Final = 1e-6
"""Rows by which a reading may seem to come too early: rounding of times."""
_ROUNDS: Final = 6
"""Of fitting the clock: each one settles the numbers of ticks farther on."""


@dataclass(frozen=True, slots=True)
class Held:
    """A clock of readings.

    Attributes:
        time: From one reading to the next [s].
        sd: Its standard deviation [s].
        repeated: Rows whose reading is that of a row before, shape (n,).
        taken: When each row's reading was taken, of repeated ones the row's own time [s], shape (n,).
    """

    time: float
    sd: float
    repeated: Mask
    taken: Array


def held_readings(t: Array, y: Array) -> Held | None:
    """The clock of the readings `y` at the times `t` [s], both shape (n,); None where there is none."""
    if len(t) < FEWEST_READINGS:
        return None
    tick = float(np.median(np.diff(t)))
    present = np.isfinite(y)
    rows = np.flatnonzero(present)
    fresh = rows[np.concatenate([[True], np.diff(y[rows]) != 0.0])][1:]
    if len(fresh) < FEWEST_READINGS or len(rows) < LEAST_HELD * len(fresh) or _counts(y[rows]):
        return None
    at = (t[fresh] - t[0]) / tick
    period, first = _clock(at)
    numbers = np.ceil((at - first) / period - 0.5 - SAME_ROW) if period > 0.0 else at
    late = at - first - numbers * period
    on_clock = (late > -0.5 * SAME_ROW - 0.02) & (late < 1.02)
    ticks = numbers[-1] - numbers[0] + 1.0
    if period < LEAST_HELD or np.mean(on_clock) < ON_CLOCK or len(fresh) < LONE_READINGS * ticks:
        return None
    repeated = present.copy()
    repeated[fresh] = False
    taken = t.copy()
    taken[fresh] -= tick * np.clip(late, 0.0, 1.0 - SAME_ROW)
    return Held(period * tick, tick / max(float(numbers[-1] - numbers[0]), 1.0), repeated, taken)


def _clock(at: Array) -> tuple[float, float]:
    """Rows between ticks, and the first tick, of new readings at the rows `at`, shape (m,).

    Readings come in the first row after a tick: of all clocks in agreement the latest.
    """
    steps = np.diff(at)
    usual = steps[steps < 1.5 * float(np.median(steps))]
    period, reach = float(np.mean(usual)), 16
    for _ in range(_ROUNDS):
        near = at[: min(reach, len(at))]
        numbers = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(near) / period), 1.0))])
        if reach > 16:
            numbers = np.round((near - near[0]) / period)
        period = float(np.polyfit(numbers, near, 1)[0])
        if reach >= len(at):
            break
        reach = min(reach * max(4, math.ceil((len(at) / 16) ** (1.0 / (_ROUNDS - 2)))), len(at))
    numbers = np.round((at - at[0]) / period)
    left = at - numbers * period
    return period, float(np.min(left[left > np.median(left) - 1.0]))


def _counts(y: Array) -> bool:
    """Whether nearly all changes are of one size: a slow movement over a coarse sensor's counts."""
    changes = np.abs(np.diff(y))
    changes = changes[changes > 0.0]
    usual = float(np.median(changes))
    return bool(np.mean(np.abs(changes - usual) < 1e-3 * usual) > SINGLE_COUNTS)
