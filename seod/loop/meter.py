"""What the loop publishes of itself: lateness, execution time, sample age, overruns, driver counters."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING

from seod.processes.ring import Word, bin_edges_us

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.base import Driver, Sample
    from seod.loop.pacer import Pacer
    from seod.processes.ring import Shared

EDGES_US = tuple(bin_edges_us())
COUNTERS_EVERY = 50
"""Ticks between copies of the driver's counters and stamp errors into the shared memory."""


class TickMeter:
    """Writes one loop's figures into the shared memory; the maxima are this loop process's own.

    Args:
        shared: Where to.
        driver: Whose counters.
        period: Nominal tick period [s].
    """

    def __init__(self, shared: Shared, driver: Driver, period: float) -> None:
        self.shared = shared
        self.driver = driver
        self.period = period
        self.lateness_max = self.execution_max = self.age_max = 0.0
        self.publish_stamp_error()

    def note(self, t: float, pacer: Pacer, samples: Sequence[Sample]) -> None:
        """Account for the tick that began at `t` [s] and has just ended."""
        shared, lateness = self.shared, pacer.lateness
        execution = pacer.now() - t
        shared.lateness[histogram_bin(lateness)] += 1
        shared.execution[histogram_bin(execution)] += 1
        floats = shared.floats
        floats[Word.TICK_TIME_D] = t
        if lateness > self.lateness_max:
            self.lateness_max = floats[Word.LATENESS_MAX_D] = lateness
        if execution > self.execution_max:
            self.execution_max = floats[Word.EXECUTION_MAX_D] = execution
        age = t - min([sample.t for sample in samples])
        floats[Word.SAMPLE_AGE_D] = age
        if self.age_max < age < math.inf:
            self.age_max = floats[Word.SAMPLE_AGE_MAX_D] = age
        if lateness > self.period:
            shared.words[Word.OVERRUNS] += 1
        if shared.words[Word.TICKS] % COUNTERS_EVERY == 0:
            self.publish_counters()
            self.publish_stamp_error()

    def publish_counters(self) -> None:
        """Copy the driver's counters."""
        for index, value in enumerate(self.driver.counters):
            self.shared.counters[index] = value

    def publish_stamp_error(self) -> None:
        """Tell how far the samples' times may be off."""
        floats = self.shared.floats
        floats[Word.STAMP_COMMON_D], floats[Word.STAMP_SCATTER_D] = self.driver.stamp_error()


def histogram_bin(seconds: float) -> int:
    """Index of the bin for a time [s]; bins as in `seod.processes.ring.bin_edges_us`."""
    return bisect_left(EDGES_US, seconds * 1e6)
