"""Sensor frames: each is checked against its sequence counter before its values are used. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers.base import Sample
from drivers.can_counters import CHECKSUM_ERRORS, FRAMES_RECEIVED, LATE, LOST, REORDERED, REPEATED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.can_codec import Decoded

LATE_PERIODS = 1.5
LARGEST_STEP_BACK = 8
"""A counter this far behind, at most, is an older frame; farther behind, a gap has wrapped the counter."""


class InputFrame:
    """One message that is read.

    Args:
        period: Number of values of its sequence counter, 0 for none.
        rate_hz: Nominal rate, None where unknown.
        signals: Signals wanted, each with its place in `samples`.
        samples: The driver's samples; the newest values are put there.
        counts: The driver's health counters.
    """

    def __init__(
        self,
        period: int,
        rate_hz: float | None,
        signals: Sequence[tuple[str, int]],
        samples: list[Sample],
        counts: list[int],
    ) -> None:
        self.period = period
        self.step_back = min(period // 4, LARGEST_STEP_BACK)
        self.longest_gap = LATE_PERIODS / rate_hz if rate_hz else math.inf
        self.signals = signals
        self.samples = samples
        self.counts = counts
        self.counter: int | None = None
        self.t = -math.inf

    def accept(self, decoded: Decoded, t: float) -> bool:
        """Use a frame that was taken at `t`; False if it is broken, old, or without anything wanted."""
        if not decoded.checksum_ok:
            self.counts[CHECKSUM_ERRORS] += 1
            return False
        if decoded.counter is not None and not self._is_next(decoded.counter):
            return False
        if t <= self.t:  # stamps may coincide; a new sample is known by its new time
            t = math.nextafter(self.t, math.inf)
        if t - self.t > self.longest_gap and self.t > -math.inf:
            self.counts[LATE] += 1
        self.t = t
        self.counts[FRAMES_RECEIVED] += 1
        return self._store(decoded, t)

    def _store(self, decoded: Decoded, t: float) -> bool:
        stored = False
        for signal, index in self.signals:
            if signal in decoded.values:  # a multiplexed signal is not in every frame
                self.samples[index] = Sample(decoded.values[signal], t)
                stored = True
        return stored

    def _is_next(self, counter: int) -> bool:
        last = self.counter
        if last is not None:
            ahead = (counter - last) % self.period
            if ahead == 0:
                self.counts[REPEATED] += 1
                return False
            if ahead >= self.period - self.step_back:
                self.counts[REORDERED] += 1
                return False
            self.counts[LOST] += ahead - 1
        self.counter = counter
        return True
