"""Both forms of the serial line behind one face: bytes of the board in, samples out; commands back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol

from drivers import serial_ascii as ascii_form
from drivers import serial_counters as count
from drivers import serial_frame as binary_form
from drivers.serial_frame import Block, BoardSample, CrcError, FrameError, Hello, Splitter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.serial_config import FieldOptions, SerialOptions


class Codec(Protocol):
    """The daemon's end of one form of the line."""

    ask: bytes
    start: bytes
    break_: bytes
    """Ends whatever was on the line before."""
    complaint: str
    """Why the newest broken frame or line was that ("" while none was)."""

    def feed(self, data: bytes) -> list[BoardSample | Hello]:
        """What is whole now; the rest is counted."""

    def clear(self) -> None:
        """The line was lost: forget what has come of a frame."""

    def command(self, sequence: int, values: Sequence[float]) -> bytes:
        """The bytes that command these values of the outputs."""

    def sample_bytes(self) -> int:
        """The most that a sample takes on the line."""

    def command_bytes(self) -> int:
        """The most that a command takes on the line."""


def make_codec(options: SerialOptions, counts: list[int]) -> Codec:
    """The form that the rig file wants.

    Args:
        options: Of the driver.
        counts: Its health counters.
    """
    return BinaryCodec(options, counts) if options.format == "binary" else AsciiCodec(options, counts)


class _Reader(ABC):
    """Reads what is whole; what is broken is counted, and the newest complaint kept."""

    def __init__(self, counts: list[int]) -> None:
        self.complaint = ""
        self._counts = counts

    @abstractmethod
    def _read(self, part: bytes) -> BoardSample | Hello | None:
        """The message in a part of the stream; None for what means nothing.

        Raises:
            FrameError: It cannot be used.
        """

    def _usable(self, parts: Sequence[bytes]) -> list[BoardSample | Hello]:
        found = []
        for part in parts:
            try:
                message = self._read(part)
            except FrameError as error:
                self._counts[count.CRC_ERRORS if isinstance(error, CrcError) else count.BAD_FRAMES] += 1
                self.complaint = str(error)
            else:
                if message is not None:
                    found.append(message)
        return found


def codes(block: Sequence[FieldOptions]) -> str:
    """Of a block's fields, as in a layout."""
    return "".join(field.code for field in block)


def numbers_of(block: Sequence[FieldOptions], values: Sequence[float]) -> list[float]:
    """The numbers on the line for values in their units, held within what their types carry."""
    numbers = []
    for field, value in zip(block, values, strict=True):
        low, high = field.numbers
        numbers.append(min(max((value - field.offset) / field.scale, low), high))
    return numbers


class BinaryCodec(_Reader):
    """Frames of COBS."""

    ask = binary_form.ask()
    start = binary_form.start()
    break_ = binary_form.END

    def __init__(self, options: SerialOptions, counts: list[int]) -> None:
        super().__init__(counts)
        self._options = options
        self._inputs, self._outputs = Block(codes(options.inputs)), Block(codes(options.outputs))
        self._splitter = Splitter(binary_form.END, binary_form.LARGEST + 1)

    def feed(self, data: bytes) -> list[BoardSample | Hello]:
        """What is whole now; the rest is counted."""
        frames = [encoded for encoded in self._splitter.feed(data) if encoded]
        self._counts[count.GARBAGE_BYTES] = self._splitter.thrown
        return self._usable(frames)

    def _read(self, part: bytes) -> BoardSample | Hello | None:
        frame = binary_form.decode(part)
        if frame.type == binary_form.SAMPLE:
            return binary_form.read_sample(self._inputs, frame)
        if frame.type == binary_form.HELLO:
            return binary_form.read_hello(frame.body)
        raise FrameError(f"type {frame.type:#x}")

    def clear(self) -> None:
        """The line was lost: forget what has come of a frame."""
        self.complaint = ""
        self._splitter.clear()

    def command(self, sequence: int, values: Sequence[float]) -> bytes:
        """The bytes that command these values of the outputs."""
        return binary_form.command(self._outputs, sequence, numbers_of(self._options.outputs, values))

    def sample_bytes(self) -> int:
        """The most that a sample takes on the line."""
        return self._inputs.size + 8 + FRAME_BYTES

    def command_bytes(self) -> int:
        """The most that a command takes on the line."""
        return self._outputs.size + FRAME_BYTES


FRAME_BYTES = 8
"""Of a frame besides its body: type, sequence, CRC, one of COBS, the end."""


class AsciiCodec(_Reader):
    """Lines of text."""

    ask = ascii_form.ASK
    start = ascii_form.START
    break_ = ascii_form.END

    def __init__(self, options: SerialOptions, counts: list[int]) -> None:
        super().__init__(counts)
        self._options = options
        self._line = ascii_form.Line(options.line, [each.name for each in options.inputs], options.checksum)
        self._splitter = Splitter(ascii_form.END, ascii_form.LONGEST)
        self._first = True

    def feed(self, data: bytes) -> list[BoardSample | Hello]:
        """As in the binary form; the first line is left out: its beginning may be missing."""
        lines = self._splitter.feed(data)
        self._counts[count.GARBAGE_BYTES] = self._splitter.thrown
        if lines and self._first:
            self._first = False
            del lines[0]
        return self._usable(lines)

    def _read(self, part: bytes) -> BoardSample | Hello | None:
        version = ascii_form.board_version(part)
        if version is not None:
            o = self._options
            return Hello(version, o.layout, o.rate_hz, o.watchdog_s, "")
        return self._line.read(part)

    def clear(self) -> None:
        """The line was lost: forget what has come of a line."""
        self.complaint = ""
        self._splitter.clear()
        self._first = True

    def command(self, sequence: int, values: Sequence[float]) -> bytes:
        """The bytes that command these values of the outputs."""
        return ascii_form.command(sequence, ascii_numbers(self._options.outputs, values))

    def sample_bytes(self) -> int:
        """The most that a sample takes on the line: numbers of 16 characters, 10 digits of time."""
        return 16 * len(self._options.inputs) + 11 * (len(self._options.line) - len(self._options.inputs)) + 4

    def command_bytes(self) -> int:
        """The most that a command takes on the line."""
        return 16 * len(self._options.outputs) + 9


def ascii_numbers(block: Sequence[FieldOptions], values: Sequence[float]) -> list[float]:
    """As `numbers_of`, without types: a decimal number has no largest."""
    return [(value - field.offset) / field.scale for field, value in zip(block, values, strict=True)]
