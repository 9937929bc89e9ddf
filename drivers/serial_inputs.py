"""Samples of a board: their sequence is checked and their time converted before they are used. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers import serial_counters as count
from drivers.base import NO_SAMPLE, Sample, StampError
from drivers.device_clock import DeviceClock
from drivers.serial_frame import BROKEN, DROPPED, OVERRUN
from drivers.stamp_jitter import Jitter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.serial_config import SerialOptions
    from drivers.serial_frame import BoardSample

LATE_PERIODS = 1.5
RATE_S, RATE_OFF = 2.0, 1.25
"""Over this time samples are counted; a rate that differs by this factor is told."""
JITTER_TOLD_S = 2e-4
"""A clock that jitters by more is told: it costs more than the latency of a line (chosen)."""
UNTOLD_LATENCY_S = 5e-4
"""To this the latency is known (standard deviation) where no command's time is told: USB looks each ms."""


class SerialInputs:
    """What the board measures.

    Attributes:
        samples: The newest of each wanted input.
        taken: Samples used so far.
        notice: What is odd about their rate or times ("" where nothing is).
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
        self.notice = ""
        self.clock = DeviceClock()
        self._line_s = line_s
        self._counts = counts
        self._late_s = LATE_PERIODS / options.rate_hz
        self._sequence: int | None = None
        self._t = -math.inf
        self._looked = -math.inf
        self._period_s = 1.0 / options.rate_hz
        self._timed, self._told = options.has("time"), options.has("time", "ack", "age")
        self._rate_hz = options.rate_hz
        self._counted: tuple[float, int] | None = None
        self._arrivals = Jitter()

    def restart(self) -> None:
        """The line is new, or the board: nothing is known of its clock and sequence."""
        self.clock.restart()
        self._arrivals = Jitter()
        self._counted = None
        self._sequence = None
        self._looked = -math.inf

    def take(self, s: BoardSample, now: float) -> bool:
        """Use a sample that was read at `now` [s]; False if it is a repeat."""
        if not self._is_new(s.sequence):
            return False
        arrived = now - self._line_s
        t = self._arrived(arrived) if s.time_us is None else self.clock.heard(s.time_us, arrived)
        self._counts[count.LATE] += t < self._looked - self._late_s
        self._t = t = max(t, math.nextafter(self._t, math.inf))
        for place, (at, scale, offset) in enumerate(self._scales):
            self.samples[place] = Sample(s.numbers[at] * scale + offset, t)
        self.taken += 1
        self._count(s.status)
        return True

    def _arrived(self, t: float) -> float:
        """A sample without a time, as if its number were one."""
        x = self.taken * self._period_s
        self._arrivals.add(x, t - x, 0.0)
        return t

    def stamp_error(self) -> StampError:
        """How far the samples' times may be off: what a clock is wrong by in all counts for commands, too.

        Stamps that were put right by their arrivals follow the reader's own rhythm: that is no white noise,
        and the part that was taken away is not told as if it were.
        """
        jitter = self.clock.jitter if self._timed else self._arrivals
        scatter = jitter.sd if self._timed else jitter.arrival_sd
        return StampError(jitter.sd if self._told else math.hypot(jitter.sd, UNTOLD_LATENCY_S), scatter)

    def looked(self, now: float) -> None:
        """All that had come up to `now` [s] was read: what comes later and is older was late."""
        self._looked = now
        sent = self.taken + self._counts[count.LOST]
        if self._counted is None:
            self._counted = (now, sent) if self.taken else None
        elif now - self._counted[0] >= RATE_S:
            rate = (sent - self._counted[1]) / (now - self._counted[0])
            self.notice = self._wrong_rate(rate) or self._jitters()
            self._counted = now, sent

    def _wrong_rate(self, rate: float) -> str:
        """By all that the board sent, what was lost on the way included [1/s]."""
        told = self._rate_hz
        if told / RATE_OFF < rate < told * RATE_OFF:
            return ""
        better = f"write driver.rate_hz: {rate:.4g}, or have the board sample {told:g} times a second"
        return f"the board sends {rate:.4g} samples/s, driver.rate_hz is {told:g}: {better}"

    def _jitters(self) -> str:
        jitter = self.clock.jitter.sd
        if not jitter > JITTER_TOLD_S:
            return ""
        better = "have it take the time where it takes the sample (docs/serial.md)"
        return (
            f"the board's times jitter by {jitter * 1e3:.2g} ms, which widens what estimates state: {better}"
        )

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
