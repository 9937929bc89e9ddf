"""Kernel time stamps on the loop's clock.

Kernels and adapters stamp frames with CLOCK_REALTIME, which jumps when somebody sets the time; the loop lives
on CLOCK_MONOTONIC. The difference is measured again and again, so that slewing does no harm. A frame stamped
before a jump and read after it is placed by the difference that held before.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

STEP_S = 1e-3
"""A change of the difference that no slewing makes between two frames."""
SLACK_S = 2e-3
"""A frame may be stamped this long before it can be read (delayed soft interrupts, receiving threads)."""


class StampClock:
    """Turns stamps of one connection into times of the loop's clock.

    Attributes:
        steps: Jumps of the real-time clock seen so far.

    Args:
        monotonic: The loop's clock [s].
        realtime: The clock of the stamps [s].
        trusted: False where the stamps are of some other clock: then the time of reading counts.
    """

    def __init__(
        self, monotonic: Callable[[], float], realtime: Callable[[], float] = time.time, trusted: bool = True
    ) -> None:
        self.steps = 0
        self._monotonic = monotonic
        self._realtime = realtime
        self._trusted = trusted
        self._now = self._drained_at = monotonic()
        self._offset = self._offset_before = realtime() - self._now

    def drained(self) -> None:
        """Everything that had come was read: what comes now is stamped later."""
        self._drained_at = self._now
        self._offset_before = self._offset

    def to_loop(self, stamp: float) -> float:
        """The time of a stamp [s] on the loop's clock: after the last `drained`, and never in the future.

        The clocks are looked at only for a stamp later than the last look: mostly once a tick.
        """
        if not self._trusted or not stamp > 0.0:
            return self._monotonic()
        earliest = self._drained_at - SLACK_S
        t = stamp - self._offset
        if earliest < t <= self._now:
            return t
        self._look()
        t = stamp - self._offset
        if earliest < t <= self._now:
            return t
        t_before_step = stamp - self._offset_before
        if earliest < t_before_step <= self._now:
            return t_before_step
        return min(max(t, self._drained_at), self._now)

    def _look(self) -> None:
        """Read both clocks, and keep the difference within what the readings allow."""
        before = self._monotonic()
        real = self._realtime()
        self._now = self._monotonic()
        offset = min(max(self._offset, real - self._now), real - before)
        if abs(offset - self._offset) > STEP_S:
            self.steps += 1
        self._offset = offset
