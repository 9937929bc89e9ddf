"""What a board does with a serial line (`docs/serial.md`): bytes in, bytes out, time handed in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from drivers import serial_ascii as ascii_form
from drivers import serial_frame as binary_form
from drivers.serial_codec import codes
from drivers.serial_frame import Block, BoardSample, CrcError, FrameError, Splitter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.serial_config import SerialOptions

MICRO = 1e6
COUNTS = ("commands", "lost_commands", "repeated_commands", "bad_commands", "unknown_frames")


class Taken(Protocol):
    """Takes the numbers of a command that came at `t` [s]."""

    def __call__(self, t: float, numbers: Sequence[float]) -> None:
        """Set the outputs."""


class Form(Protocol):
    """The board's end of one form of the line."""

    def feed(self, data: bytes) -> list[str | tuple[int, Sequence[float]]]:
        """`ask`, `start` and commands that are whole now; "broken" and "unknown" for what cannot be used."""

    def hello(self) -> bytes:
        """What the board says it is."""

    def sample(self, s: BoardSample) -> bytes:
        """A sample."""


class BinaryForm:
    """Frames of COBS."""

    def __init__(self, options: SerialOptions, rate_hz: float) -> None:
        self._options = options
        self._rate_hz = rate_hz
        self._inputs, self._outputs = Block(codes(options.inputs)), Block(codes(options.outputs))
        self._splitter = Splitter(binary_form.END, binary_form.LARGEST + 1)

    def feed(self, data: bytes) -> list[str | tuple[int, Sequence[float]]]:
        """What is whole now."""
        return [self._read(encoded) for encoded in self._splitter.feed(data) if encoded]

    def _read(self, encoded: bytes) -> str | tuple[int, Sequence[float]]:
        try:
            frame = binary_form.decode(encoded)
            if frame.type == binary_form.COMMAND:
                return frame.sequence, self._outputs.unpack(frame.body)
        except FrameError:
            return "broken"
        if frame.body == bytes([binary_form.VERSION]):
            return {binary_form.ASK: "ask", binary_form.START: "start"}.get(frame.type, "unknown")
        return "ask" if frame.type == binary_form.ASK else "unknown"

    def hello(self) -> bytes:
        """The simulated board's HELLO."""
        o = self._options
        return binary_form.hello(binary_form.VERSION, o.layout, self._rate_hz, o.watchdog_s, "simulated")

    def sample(self, s: BoardSample) -> bytes:
        """A SAMPLE."""
        return binary_form.sample(self._inputs, s)


class AsciiForm:
    """Lines of text."""

    def __init__(self, options: SerialOptions) -> None:
        self._outputs = len(options.outputs)
        self._line = ascii_form.Line(options.line, [each.name for each in options.inputs])
        self._splitter = Splitter(ascii_form.END, ascii_form.LONGEST)

    def feed(self, data: bytes) -> list[str | tuple[int, Sequence[float]]]:
        """What is whole now."""
        return [self._read(line) for line in self._splitter.feed(data) if line.strip()]

    def _read(self, line: bytes) -> str | tuple[int, Sequence[float]]:
        try:
            text = ascii_form.opened(line, sealed=False)
            if text in ("ask", "start"):
                return text
            return ascii_form.read_command(text, self._outputs)
        except CrcError:
            return "broken"
        except FrameError:
            return "unknown"

    def hello(self) -> bytes:
        """A comment with the version."""
        return b"# seod %d simulated\n" % binary_form.VERSION

    def sample(self, s: BoardSample) -> bytes:
        """A line."""
        return self._line.write(s)


class Board:
    """The protocol of a simulated board.

    Attributes:
        sampling: START has come.
        counts: What came that was wrong, and how many commands.

    Args:
        options: Of the daemon's driver; the board takes the other side.
        rate_hz: Of its samples.
        take: Takes the commands.
        drift: By which its clock is fast [s/s].
        clock_start: Its clock at the beginning [us].
        t: The time of the beginning [s].
        counts: Counted here; it has the keys of `COUNTS`.
    """

    def __init__(
        self,
        options: SerialOptions,
        rate_hz: float,
        take: Taken,
        drift: float,
        clock_start: int,
        t: float,
        counts: dict[str, int],
    ) -> None:
        self.sampling = False
        self.counts = counts
        self._form: Form = BinaryForm(options, rate_hz) if options.format == "binary" else AsciiForm(options)
        self._take = take
        self._rate, self._clock_start, self._begun = 1.0 + drift, clock_start, t
        self._watchdog = options.watchdog_s
        self._sequence = 0
        self._last: int | None = None
        self._commanded = -math.inf
        self._status = 0

    def receive(self, data: bytes, t: float) -> bytes:
        """Take what came at `t` [s]; returns what is answered."""
        answer = b""
        for message in self._form.feed(data):
            match message:
                case "ask":
                    self.sampling, self._last = False, None
                    answer += self._form.hello()
                case "start":
                    self.sampling = True
                case "broken":
                    self.counts["bad_commands"] += 1
                    self._status |= binary_form.BROKEN
                case (int() as sequence, numbers) if self.sampling:
                    self._command(sequence, numbers, t)
                case _:
                    self.counts["unknown_frames"] += 1
        return answer

    def _command(self, sequence: int, numbers: Sequence[float], t: float) -> None:
        ahead = 1 if self._last is None else (sequence - self._last) % 256
        if ahead == 0:
            self.counts["repeated_commands"] += 1
            return
        self.counts["lost_commands"] += ahead - 1
        self.counts["commands"] += 1
        self._last, self._commanded = sequence, t
        self._take(t, numbers)

    def sample(self, numbers: Sequence[float], t: float) -> bytes:
        """The sample of `t` [s]."""
        age = t - self._commanded
        neutral = binary_form.NEUTRAL if age > self._watchdog else 0
        known = self._last is not None and age < binary_form.NEVER / MICRO
        sample = BoardSample(
            sequence=self._sequence,
            time_us=self._time_us(t),
            status=self._status | neutral,
            ack=self._last if known else None,
            age_us=self._time_us(t) - self._time_us(self._commanded) if known else None,
            numbers=numbers,
        )
        self._sequence = (self._sequence + 1) % 256
        self._status = 0
        return self._form.sample(sample._replace(time_us=self._time_us(t) % (1 << 32)))

    def dropped(self) -> None:
        """The line had no room for a sample."""
        self._status |= binary_form.DROPPED

    def _time_us(self, t: float) -> int:
        return self._clock_start + int((t - self._begun) * self._rate * MICRO)
