"""Commands to a board: bounded in flight, and neutral first whenever the line was in trouble."""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import TYPE_CHECKING

from drivers import serial_counters as count
from drivers.serial_frame import NEUTRAL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers.device_clock import DeviceClock
    from drivers.serial_codec import Codec
    from drivers.serial_config import SerialOptions
    from drivers.serial_frame import BoardSample
    from drivers.serial_link import SerialLink


LATENCIES = 31
"""Commands whose median time to take effect is that of one not acknowledged yet."""


class SerialOutputs:
    """Sends the commands of one line.

    Attributes:
        trouble: Why commands have no effect ("" while they have).
        blocked: Nothing but neutral may leave until one neutral command has.
        sent: Commands that the line took.

    Args:
        options: Of the driver.
        link: The line.
        codec: Its form.
        places: Of each of the board's outputs among the values; None: it is not commanded and stays at 0.
        neutral: Neutral value of each value's channel.
        board_clock: Of the board.
        counts: The driver's health counters.
        clock: The loop's clock [s].
    """

    def __init__(
        self,
        options: SerialOptions,
        link: SerialLink,
        codec: Codec,
        places: Sequence[int | None],
        neutral: Sequence[float],
        board_clock: DeviceClock,
        counts: list[int],
        clock: Callable[[], float],
    ) -> None:
        self.trouble = ""
        self.blocked = False
        self.sent = 0
        self._room = options.max_in_flight
        self._timeout = options.confirm_timeout_s
        self._acknowledged = options.has("ack")
        self._line_s = 0.0 if options.usb else codec.command_bytes() * 10.0 / options.baud
        self._link = link
        self._codec = codec
        self._places = places
        self._neutral = neutral
        self._board_clock = board_clock
        self._counts = counts
        self._clock = clock
        self._in_flight: deque[tuple[int, float]] = deque(maxlen=256)
        self._was_neutral = True
        self._set_at = math.nan
        self._latencies: deque[float] = deque(maxlen=LATENCIES)
        self._next_probe = -math.inf

    def neutral_bytes(self, sequence: int) -> bytes:
        """The neutral command."""
        return self._bytes(sequence, self._neutral)

    def _bytes(self, sequence: int, values: Sequence[float]) -> bytes:
        return self._codec.command(sequence, [0.0 if at is None else values[at] for at in self._places])

    def write(self, t: float, values: Sequence[float]) -> float:
        """Send, if there is room; when it left [s], nan if it did not."""
        if self.blocked:
            return self._recover(t)
        if len(self._in_flight) < self._room and self._send(values):
            return self._in_flight[-1][1] if self._acknowledged else self._clock()
        self._counts[count.DEFERRED] += 1
        return math.nan

    def neutral(self, t: float) -> float:
        """Send neutral, instead of anything that has not left yet."""
        if self.blocked:
            return self._recover(t)
        if not self._send(self._neutral):
            self._link.drop_output()
            if not self._send(self._neutral, self._codec.break_):
                return math.nan
        return self._clock()

    def _send(self, values: Sequence[float], before: bytes = b"") -> bool:
        if not self._link.send(before + self._bytes(self.sent & 0xFF, values)):
            return False
        if self._acknowledged:
            self._in_flight.append((self.sent & 0xFF, self._clock()))
        self.sent += 1
        self._counts[count.COMMANDS] += 1
        return True

    def _recover(self, t: float) -> float:
        """After trouble: neutral now and then, until it is acknowledged; only then commands again."""
        if not self._link.is_open or t < self._next_probe:
            return math.nan
        self._next_probe = t + self._timeout
        self._link.drop_output()
        self._in_flight.clear()
        if not self._send(self._neutral, self._codec.break_):
            return math.nan
        if not self._acknowledged:
            self.blocked = False
        return self._clock()

    def acknowledge(self, s: BoardSample) -> None:
        """What a sample says of the commands."""
        neutral = bool(s.status & NEUTRAL)
        self._counts[count.WATCHDOG_TRIPS] += neutral and not self._was_neutral
        self._was_neutral = neutral
        if s.ack is None:
            return
        for place, (sequence, written) in enumerate(self._in_flight):
            if sequence == s.ack:
                self._confirmed(s, written, place)
                return

    def _confirmed(self, s: BoardSample, written: float, place: int) -> None:
        for _ in range(place + 1):  # the line keeps their order: earlier ones were set, too
            self._in_flight.popleft()
        self.blocked = False
        if s.age_us is not None and s.time_us is not None:
            set_us = (s.time_us - s.age_us) & 0xFFFFFFFF
            self._set_at = self._board_clock.acknowledged(set_us, written + self._line_s)
            self._latencies.append(self._set_at - written)

    def left(self) -> Sequence[float]:
        """When the last command was set [s]: as the board said, or as it is used to; nan if unknown.

        At the rate of the samples the acknowledgement of a command often comes a sample too late for its row.
        """
        at = self._set_at
        if self._in_flight:
            written = self._in_flight[-1][1]
            at = min(written + median(self._latencies), self._clock()) if self._latencies else math.nan
        return [at] * len(self._neutral)

    def judge(self, t: float) -> None:
        """Find out at time `t` [s] whether commands have an effect."""
        if self._link.down:
            self._in_flight.clear()
            self.trouble, self.blocked = "the line was lost and no neutral command has passed since", True
        elif self._in_flight and t - self._in_flight[0][1] > self._timeout:
            self._counts[count.UNCONFIRMED] += not self.blocked
            self.trouble = f"the board acknowledges no command for {self._timeout:g} s"
            self.blocked = True
        elif not self.blocked:
            self.trouble = ""
