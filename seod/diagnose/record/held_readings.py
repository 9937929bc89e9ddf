"""A sensor slower than the record: each of its readings is repeated in the rows until the next one comes.

Readings change at rows that lie on the sensor's own clock, an even grid; what a slow load or a coarse sensor
repeats does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.tuning.record import HELD_READINGS

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    clock = max(
        _clocks(at), key=lambda each: (round(_kept_to(each, at), 2), each.period), default=_Clock(1.0, 0.0)
    )
    if _kept_to(clock, at) < HELD_READINGS.on_clock:
        return None
    numbers, late = clock.ticks(at)
    repeated = present.copy()
    repeated[fresh] = False
    taken = t.copy()
    taken[fresh] -= tick * np.clip(late, 0.0, 1.0 - HELD_READINGS.same_row)
    return Held(clock.period * tick, tick / max(float(numbers[-1] - numbers[0]), 1.0), repeated, taken)


class _Clock(NamedTuple):
    """Rows from tick to tick, and the first tick."""

    period: float
    first: float

    def ticks(self, at: Array) -> tuple[Array, Array]:
        """Numbers of ticks that brought new readings at the rows `at`, and how long before; shape (m,)."""
        numbers = np.floor((at - self.first + HELD_READINGS.off_clock) / self.period)
        return numbers, at - self.first - numbers * self.period


def _kept_to(clock: _Clock, at: Array) -> float:
    """Part of the new readings, at the rows `at`, shape (m,), that come first and alone after a tick.

    0 where most ticks bring none.
    """
    numbers, late = clock.ticks(at)
    ticks = numbers[-1] - numbers[0] + 1.0
    if clock.period < HELD_READINGS.least_held or len(at) < HELD_READINGS.lone_readings * ticks:
        return 0.0
    first = late < 1.0 + HELD_READINGS.off_clock
    return float(np.mean(first & np.append(True, np.diff(numbers) > 0.0)))


def _clocks(at: Array) -> Iterator[_Clock]:
    """Clocks that new readings at the rows `at`, shape (m,), may come from.

    The rows of new readings have a line at the clock's frequency, which looks like what that is short of one
    tick in a row.
    """
    near = at[at - at[0] < HELD_READINGS.first_rows]
    if len(near) < HELD_READINGS.fewest_readings or not np.median(np.diff(at)) > 0.0:
        return
    new = np.bincount(np.round(near - at[0]).astype(np.int64)).astype(np.float64)
    lines = HELD_READINGS.finer * len(new)
    spectrum = np.abs(np.fft.rfft(new - np.mean(new), lines))
    usual = 1.0 / float(np.median(np.diff(at)))
    slowest = min(HELD_READINGS.slowest * usual, 1.0 - 1.0 / HELD_READINGS.least_held)
    first, last = max(1, int(slowest * lines)), int(HELD_READINGS.fastest * usual * lines) + 2
    line = (first + float(np.argmax(spectrum[first:last]))) / lines
    for per_row in (line, 1.0 - line):
        yield _fitted(at, 1.0 / per_row)


def _fitted(at: Array, period: float) -> _Clock:
    """Fitted to more and more of the new readings: each time numbers of ticks farther on are settled.

    Readings come in the first row after a tick: of all clocks in agreement the latest.
    """
    reach = int(np.searchsorted(at - at[0], HELD_READINGS.first_rows))
    while True:
        near = at[:reach]
        numbers = _numbers(near, period)
        if numbers[-1] > numbers[0]:
            period = float(np.polyfit(numbers, near, 1)[0])
        if reach >= len(at):
            break
        reach = HELD_READINGS.growth * reach
    left = at - _numbers(at, period) * period
    return _Clock(period, float(np.min(left[left > np.median(left) - 1.0])))


def _numbers(at: Array, period: float) -> Array:
    """Of ticks about which the rows `at`, shape (m,), lie: wherever the first of them does."""
    turns = at / period
    middle = np.angle(np.mean(np.exp(2j * np.pi * turns))) / (2.0 * np.pi)
    return np.asarray(np.round(turns - middle))


def _counts(y: Array) -> bool:
    """Whether nearly all changes are of one size: a slow movement over a coarse sensor's counts."""
    changes = np.abs(np.diff(y))
    changes = changes[changes > 0.0]
    usual = float(np.median(changes))
    same = np.abs(changes - usual) < HELD_READINGS.same_size * usual
    return bool(np.mean(same) > HELD_READINGS.single_counts)
