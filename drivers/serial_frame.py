"""The binary form of the serial line, as `docs/serial.md` specifies it. Pure: bytes in, messages out.

Both ends are here: the daemon's, and that of a simulated board.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, NamedTuple

from cobs import cobs

if TYPE_CHECKING:
    from collections.abc import Sequence

VERSION = 1
HELLO, SAMPLE, ASK, START, COMMAND = 0x01, 0x02, 0x81, 0x82, 0x83
"""Types of frames."""

NEUTRAL, OVERRUN, DROPPED, BROKEN = 1, 2, 4, 8
"""Bits of `status`."""

NEVER = 0xFFFF
"""`ack age`: longer ago, or never."""

END = b"\0"
LARGEST = 252
"""Bytes of content, at most."""

_HEAD = struct.Struct("<BB")
_CRC = struct.Struct("<I")
_HELLO = struct.Struct("<BBIH")
_SAMPLE = struct.Struct("<IBBH")


class FrameError(ValueError):
    """A frame that cannot be used."""


class CrcError(FrameError):
    """Its checksum is wrong."""


class Hello(NamedTuple):
    """What a board says it is."""

    version: int
    layout: str
    rate_hz: float
    watchdog_s: float
    name: str


class BoardSample(NamedTuple):
    """One sample as it came.

    Attributes:
        sequence: Counts up by one and wraps at 256; None where the board has none.
        time_us: The board's clock [us], wraps at 2**32; None where the board has none.
        status: Bits NEUTRAL, OVERRUN, DROPPED, BROKEN.
        ack: Sequence of the last command that was set; None: none yet, or the board does not say.
        age_us: How long before `time_us` that was [us]; None where it is not known.
        numbers: Of the inputs, not yet scaled.
    """

    sequence: int | None
    time_us: int | None
    status: int
    ack: int | None
    age_us: int | None
    numbers: Sequence[float]


class Frame(NamedTuple):
    """Any frame whose checksum is right."""

    type: int
    sequence: int
    body: bytes


class Splitter:
    """Cuts a stream of bytes at its ends of frames.

    Attributes:
        thrown: Bytes thrown away because no end came within `longest`.

    Args:
        end: The byte that ends a frame.
        longest: Bytes that a frame may have.
    """

    def __init__(self, end: bytes, longest: int) -> None:
        self.thrown = 0
        self._end = end
        self._longest = longest
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that are whole now, without their ends; the end of an overlong one is thrown, too."""
        *frames, rest = (self._rest + data).split(self._end)
        if frames and self._skipping:
            self.thrown += len(frames.pop(0))
            self._skipping = False
        if len(rest) > self._longest or self._skipping:
            self.thrown += len(rest)
            self._skipping = True
            rest = b""
        self._rest = rest
        return frames

    def clear(self) -> None:
        """Forget what has come of a frame."""
        self._rest = b""
        self._skipping = False


def encode(kind: int, sequence: int, body: bytes = b"") -> bytes:
    """One frame with its end."""
    content = _HEAD.pack(kind, sequence & 0xFF) + body
    content += _CRC.pack(zlib.crc32(content))
    if len(content) > LARGEST:
        raise FrameError(f"a frame of {len(content)} bytes: at most {LARGEST} fit")
    return bytes(cobs.encode(content)) + END


def decode(encoded: bytes) -> Frame:
    """The frame in what came between two ends.

    Raises:
        CrcError: Its checksum is wrong.
        FrameError: It is no COBS, too short or too long.
    """
    try:
        content = cobs.decode(encoded)
    except cobs.DecodeError as error:
        raise FrameError(str(error)) from error
    if not _HEAD.size + _CRC.size <= len(content) <= LARGEST:
        raise FrameError(f"{len(content)} bytes")
    if zlib.crc32(content[:-4]) != _CRC.unpack(content[-4:])[0]:
        raise CrcError("checksum")
    return Frame(content[0], content[1], content[2:-4])


def hello(version: int, layout: str, rate_hz: float, watchdog_s: float, name: str) -> bytes:
    """The board's HELLO."""
    body = _HELLO.pack(version, 0, round(rate_hz * 1000.0), round(watchdog_s * 1000.0))
    return encode(HELLO, 0, body + layout.encode() + END + name.encode())


def read_hello(body: bytes) -> Hello:
    """The body of a HELLO.

    Raises:
        FrameError: It is too short or its layout no text.
    """
    if len(body) < _HELLO.size:
        raise FrameError(f"a HELLO of {len(body)} bytes")
    version, _, rate_mhz, watchdog_ms = _HELLO.unpack_from(body)
    layout, _, name = body[_HELLO.size :].partition(END)
    try:
        text = layout.decode("ascii")
    except UnicodeDecodeError as error:
        raise FrameError(f"a HELLO whose layout {layout[:20]!r} is no text") from error
    return Hello(version, text, rate_mhz / 1e3, watchdog_ms / 1e3, name.decode(errors="replace"))


def ask() -> bytes:
    """The daemon's ASK."""
    return encode(ASK, 0, bytes([VERSION]))


def start() -> bytes:
    """The daemon's START."""
    return encode(START, 0, bytes([VERSION]))


class Block:
    """The numbers of one direction, packed.

    Args:
        codes: Of the fields, as in a layout: "iB".
    """

    def __init__(self, codes: str) -> None:
        self._struct = struct.Struct("<" + codes)
        self._whole = [code != "f" for code in codes]
        self.size = self._struct.size

    def pack(self, numbers: Sequence[float]) -> bytes:
        """Their bytes; whole numbers are rounded."""
        return self._struct.pack(
            *[round(x) if whole else x for x, whole in zip(numbers, self._whole, strict=True)]
        )

    def unpack(self, data: bytes) -> tuple[float, ...]:
        """The numbers of a block.

        Raises:
            FrameError: It has another length.
        """
        if len(data) != self.size:
            raise FrameError(f"a block of {len(data)} bytes instead of {self.size}")
        return self._struct.unpack(data)


def sample(block: Block, s: BoardSample) -> bytes:
    """The board's SAMPLE."""
    age = NEVER if s.age_us is None or s.ack is None else min(s.age_us, NEVER)
    head = _SAMPLE.pack((s.time_us or 0) & 0xFFFFFFFF, s.status, s.ack or 0, age)
    return encode(SAMPLE, s.sequence or 0, head + block.pack(s.numbers))


def read_sample(block: Block, frame: Frame) -> BoardSample:
    """A SAMPLE of this layout.

    Raises:
        FrameError: It has another length.
    """
    numbers = block.unpack(frame.body[_SAMPLE.size :])
    time_us, status, ack, age = _SAMPLE.unpack_from(frame.body)
    if age == NEVER:
        return BoardSample(frame.sequence, time_us, status, None, None, numbers)
    return BoardSample(frame.sequence, time_us, status, ack, age, numbers)


def command(block: Block, sequence: int, numbers: Sequence[float]) -> bytes:
    """The daemon's COMMAND."""
    return encode(COMMAND, sequence, block.pack(numbers))
