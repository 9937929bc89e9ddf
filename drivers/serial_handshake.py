"""Getting a board to sample: ASK until HELLO, then START until samples come. Pure; time is handed in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from drivers import serial_counters as count
from drivers.serial_frame import VERSION

if TYPE_CHECKING:
    from drivers.serial_config import SerialOptions
    from drivers.serial_frame import Hello

AGAIN_S = 0.1
"""Time between two ASKs, or two STARTs."""
SILENT_S, SILENT_PERIODS = 0.25, 20.0
"""A board that has not sampled for the longer of these has stopped."""

SHOWN_BYTES = 24
"""Of what a stranger sent, in the message."""

State = Literal["asking", "starting", "sampling", "refused"]


class Handshake:
    """Where the daemon and its board stand.

    Attributes:
        state: `asking` for HELLO, `starting` until samples come, `sampling`; `refused`: not our board.
        refusal: Why it was refused.

    Args:
        options: Of the driver.
        counts: Its health counters.
    """

    def __init__(self, options: SerialOptions, counts: list[int]) -> None:
        self.state: State = "asking"
        self.refusal = ""
        self._options = options
        self._counts = counts
        self._silent = max(SILENT_S, SILENT_PERIODS / options.rate_hz)
        self._next = self._heard = -math.inf
        self._begun = math.inf
        self._strange, self._first = 0, b""

    def begin(self, t: float) -> None:
        """From the start, at time `t` [s]: the line is new, or the board has stopped."""
        self.state = "asking" if self._options.format == "binary" else "starting"
        self.refusal = ""
        self._begun = t
        self._next = self._heard = -math.inf
        self._strange, self._first = 0, b""

    def due(self, t: float) -> Literal["", "ask", "start"]:
        """What should be sent now, at time `t` [s]."""
        if self.state == "sampling" and t - self._heard > self._silent:
            self.begin(t)
        if self.state in ("sampling", "refused") or t < self._next:
            return ""
        self._next = t + AGAIN_S
        return "ask" if self.state == "asking" else "start"

    def heard(self, data: bytes) -> None:
        """Bytes came: of the board, or of whoever is on the line while no board has answered."""
        if self.state != "sampling":
            self._strange += len(data)
            self._first = (self._first + data)[:SHOWN_BYTES]

    def greeted(self, hello: Hello) -> None:
        """A HELLO came."""
        self.refusal = self._judge(hello)
        if self.refusal:
            self._counts[count.REFUSED] += self.state != "refused"
            self.state = "refused"
        elif self.state == "asking":
            self._counts[count.HANDSHAKES] += 1
            self.state = "starting"
            self._next = -math.inf

    def _judge(self, hello: Hello) -> str:
        o, name = self._options, f"the board {hello.name}".rstrip()
        if hello.version != VERSION:
            return f"{name} speaks version {hello.version} of the line, seod {VERSION}: update the older"
        if hello.layout != o.layout:
            return f"{name} has the layout {hello.layout}, the rig file {o.layout} (docs/serial.md)"
        if hello.watchdog_s > o.watchdog_s:
            waits = f"{hello.watchdog_s:g} s for a command before it goes to neutral"
            return f"{name} waits {waits}; driver.watchdog_s allows {o.watchdog_s:g} s"
        if abs(hello.rate_hz - o.rate_hz) > 0.01 * o.rate_hz:
            return f"{name} samples at {hello.rate_hz:g} Hz, driver.rate_hz is {o.rate_hz:g}"
        return ""

    def sampled(self, t: float) -> bool:
        """A sample came at `t` [s]; whether it may be used."""
        if self.state in ("asking", "refused"):
            return False
        self.state, self._heard = "sampling", t
        return True

    def trouble(self, t: float, complaint: str) -> str:
        """Why there are no samples ("" while there are, or may be soon).

        Args:
            t: The time [s].
            complaint: What was wrong with the newest that came.
        """
        if self.state == "refused":
            return self.refusal
        if self.state != "sampling" and t - self._begun > self._options.handshake_s:
            return self._missing(complaint)
        return ""

    def _missing(self, complaint: str) -> str:
        o = self._options
        what = "HELLO" if self.state == "asking" else "sample"
        begun = f"the board on {o.port} sent no {what} for {o.handshake_s:g} s"
        if not self._strange:
            return f"{begun}, nor anything else: is it switched on, and is driver.port its port?"
        sent = f"{self._strange} other bytes, at first {self._first!r}"
        wrong = f", the last of them {complaint}" if complaint else ""
        other = "ascii" if o.format == "binary" else "binary"
        return f"{begun}, but {sent}{wrong}: is driver.format {other}, or driver.baud not {o.baud}?"
