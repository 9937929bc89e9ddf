"""Samples of a board: their sequence is checked and their time converted before they are used. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers import serial_counters as count
from drivers.base import NO_SAMPLE, Sample
from drivers.device_clock import DeviceClock
from drivers.serial_frame import BROKEN, DROPPED, OVERRUN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.serial_config import SerialOptions
    from drivers.serial_frame import BoardSample

LATE_PERIODS = 1.5


class SerialInputs:
    """What the board measures.

    Attributes:
        samples: The newest of each wanted input.
        taken: Samples used so far.
        clock: The board's.

    Args:
        options: Of the driver.
        names: Inputs wanted, in the order of `samples`.
        line_s: Time that a sample needs on the line [s].
        counts: The driver's health counters.
    """

    def __init__(
        self, options: SerialOptions, names: Sequence[str], line_s: float, counts: list[int]
    ) -> None:
        places = {field.name: place for place, field in enumerate(options.inputs)}
        self._wanted = [(places[name], options.inputs[places[name]]) for name in names]
        self._scales = [(place, field.scale, field.offset) for place, field in self._wanted]
        self.samples: list[Sample] = [NO_SAMPLE] * len(names)
        self.taken = 0
        self.clock = DeviceClock()
        self._line_s = line_s
        self._counts = counts
        self._late_s = LATE_PERIODS / options.rate_hz
        self._sequence: int | None = None
        self._t = -math.inf
        self._looked = -math.inf

    def restart(self) -> None:
        """The line is new, or the board: nothing is known of its clock and sequence."""
        self.clock.restart()
        self._sequence = None
        self._looked = -math.inf

    def take(self, s: BoardSample, now: float) -> bool:
        """Use a sample that was read at `now` [s]; False if it is a repeat."""
        if not self._is_new(s.sequence):
            return False
        arrived = now - self._line_s
        t = arrived if s.time_us is None else self.clock.heard(s.time_us, arrived)
        self._counts[count.LATE] += t < self._looked - self._late_s
        self._t = t = max(t, math.nextafter(self._t, math.inf))
        for place, (at, scale, offset) in enumerate(self._scales):
            self.samples[place] = Sample(s.numbers[at] * scale + offset, t)
        self.taken += 1
        self._count(s.status)
        return True

    def looked(self, now: float) -> None:
        """All that had come up to `now` [s] was read: what comes later and is older was late."""
        self._looked = now

    def _is_new(self, sequence: int | None) -> bool:
        last, self._sequence = self._sequence, sequence
        if sequence is None or last is None:
            return True
        ahead = (sequence - last) % 256
        if ahead == 0:
            self._counts[count.REPEATED] += 1
            return False
        self._counts[count.LOST] += ahead - 1
        return True

    def _count(self, status: int) -> None:
        counts = self._counts
        counts[count.SAMPLES] += 1
        counts[count.CLOCK_RESETS] = self.clock.resets
        if status & (OVERRUN | DROPPED | BROKEN):
            counts[count.BOARD_OVERRUNS] += bool(status & OVERRUN)
            counts[count.BOARD_DROPS] += bool(status & DROPPED)
            counts[count.BOARD_ERRORS] += bool(status & BROKEN)
