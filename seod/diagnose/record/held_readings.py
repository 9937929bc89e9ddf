"""A sensor slower than the record: each of its readings is repeated in the rows until the next one comes.

Readings change at rows that lie on the sensor's own clock, an even grid; what a slow load or a coarse sensor
repeats does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.record import HELD_READINGS

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Mask


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
    if len(t) < HELD_READINGS.fewest_readings:
        return None
    tick = float(np.median(np.diff(t)))
    present = np.isfinite(y)
    rows = np.flatnonzero(present)
    fresh = rows[np.concatenate([[True], np.diff(y[rows]) != 0.0])][1:]
    if (
        len(fresh) < HELD_READINGS.fewest_readings
        or len(rows) < HELD_READINGS.least_held * len(fresh)
        or _counts(y[rows])
    ):
        return None
    at = (t[fresh] - t[0]) / tick
    period, first = _clock(at)
    numbers = np.ceil((at - first) / period - 0.5 - HELD_READINGS.same_row) if period > 0.0 else at
    late = at - first - numbers * period
    off = HELD_READINGS.off_clock
    on_clock = (late > -0.5 * HELD_READINGS.same_row - off) & (late < 1.0 + off)
    ticks = numbers[-1] - numbers[0] + 1.0
    if (
        period < HELD_READINGS.least_held
        or np.mean(on_clock) < HELD_READINGS.on_clock
        or len(fresh) < HELD_READINGS.lone_readings * ticks
    ):
        return None
    repeated = present.copy()
    repeated[fresh] = False
    taken = t.copy()
    taken[fresh] -= tick * np.clip(late, 0.0, 1.0 - HELD_READINGS.same_row)
    return Held(period * tick, tick / max(float(numbers[-1] - numbers[0]), 1.0), repeated, taken)


def _clock(at: Array) -> tuple[float, float]:
    """Rows between ticks, and the first tick, of new readings at the rows `at`, shape (m,).

    Readings come in the first row after a tick: of all clocks in agreement the latest.
    """
    steps = np.diff(at)
    usual = steps[steps < HELD_READINGS.usual_steps * float(np.median(steps))]
    first_reach = HELD_READINGS.first_reach
    period, reach = float(np.mean(usual)), first_reach
    grows = math.ceil((len(at) / first_reach) ** (1.0 / (HELD_READINGS.rounds - 2)))
    for _ in range(HELD_READINGS.rounds):
        near = at[: min(reach, len(at))]
        numbers = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(near) / period), 1.0))])
        if reach > first_reach:
            numbers = np.round((near - near[0]) / period)
        period = float(np.polyfit(numbers, near, 1)[0])
        if reach >= len(at):
            break
        reach = min(reach * max(HELD_READINGS.least_growth, grows), len(at))
    numbers = np.round((at - at[0]) / period)
    left = at - numbers * period
    return period, float(np.min(left[left > np.median(left) - 1.0]))


def _counts(y: Array) -> bool:
    """Whether nearly all changes are of one size: a slow movement over a coarse sensor's counts."""
    changes = np.abs(np.diff(y))
    changes = changes[changes > 0.0]
    usual = float(np.median(changes))
    same = np.abs(changes - usual) < HELD_READINGS.same_size * usual
    return bool(np.mean(same) > HELD_READINGS.single_counts)
