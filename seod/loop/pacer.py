"""Pacers decide when a tick happens. They alone read the clock; the loop is handed the time."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from seod.processes.ring import Word

if TYPE_CHECKING:
    from drivers.base import Driver
    from seod.processes.ring import Shared


class Pacer(Protocol):
    """`now` is also the drivers' clock."""

    lateness: float
    """How much later than its time the last tick began [s]."""

    def now(self) -> float:
        """Current time [s]."""

    def next(self) -> float:
        """Wait for the next tick; returns its time [s]."""


class TimerPacer:
    """Free-running: absolute deadlines, one a period; deadlines missed while late are skipped.

    A loop that cannot keep its rate at all gives way after a while: at real-time priority it would take the
    processor from all that could tell or change it.
    """

    BREATHLESS = 100
    """More ticks than this without sleep, less those with: then there is a pause after each."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.breathless = 0
        self.deadline = time.monotonic()
        self.lateness = 0.0

    def now(self) -> float:
        """CLOCK_MONOTONIC [s]."""
        return time.monotonic()

    def next(self) -> float:
        """Sleep to the next deadline; returns the time of waking [s]."""
        self.deadline += self.period
        left = self.deadline - time.monotonic()
        if left > 0:
            time.sleep(left)
            self.breathless = max(0, self.breathless - 1)
        else:
            self._breathe()
        now = time.monotonic()
        self.lateness = now - self.deadline
        if self.lateness > self.period:
            self.deadline += (self.lateness // self.period) * self.period
        return now

    def _breathe(self) -> None:
        self.breathless = min(2 * self.BREATHLESS, self.breathless + 1)
        if self.breathless > self.BREATHLESS:
            time.sleep(self.period)


class SensorPacer:
    """A tick at each sample of the first input; without one after two periods, so that the guard sees it."""

    def __init__(self, driver: Driver, period: float) -> None:
        self.driver = driver
        self.period = period
        self.last = time.monotonic()
        self.lateness = 0.0

    def now(self) -> float:
        """CLOCK_MONOTONIC [s]."""
        return time.monotonic()

    def next(self) -> float:
        """Wait for the sample; lateness counts from one period after the tick before [s]."""
        self.driver.wait(self.last + 2.0 * self.period)
        now = time.monotonic()
        self.lateness = max(0.0, now - self.last - self.period)
        self.last = now
        return now


class SimulatedPacer:
    """As fast as it can on simulated time; waits only for the reader of the rows, so that none are lost."""

    def __init__(self, period: float, shared: Shared) -> None:
        self.period = period
        self.shared = shared
        self.start = time.monotonic()
        self.ticks = 0
        self.lateness = 0.0

    def now(self) -> float:
        """Simulated time [s]."""
        return self.start + self.ticks * self.period

    def next(self) -> float:
        """Step the simulated time by one period."""
        while self.shared.row_ring.head[0] - self.shared.words[Word.CONSUMED] > self.shared.rows // 2:
            time.sleep(1e-3)
        self.ticks += 1
        return self.now()
