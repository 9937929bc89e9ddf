"""The ASCII form of the serial line, as `docs/serial.md` specifies it. Pure: lines in, messages out."""

from __future__ import annotations

import math
import re
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING

from drivers.serial_config import OWN_FIELDS
from drivers.serial_frame import BoardSample, CrcError, FrameError

if TYPE_CHECKING:
    from collections.abc import Sequence

END = b"\n"
LONGEST = 1000
"""Bytes of a line, at most."""
ASK, START = b"ask\n", b"start\n"

_GAPS = re.compile(r"[,; \t]+")
_OWN = {"time": (1 << 32) - 1, "sequence": 255, "status": 255, "ack": 255, "age": (1 << 32) - 1}
"""Fields that are no inputs, and the largest number of each."""


def seal(text: str) -> bytes:
    """A line with its checksum and end."""
    return b"%s*%02x\n" % (text.encode("ascii"), reduce(xor, text.encode("ascii"), 0))


def opened(line: bytes, sealed: bool) -> str:
    """The text of a line without its checksum.

    Args:
        line: Without its LF.
        sealed: A checksum must be there.

    Raises:
        CrcError: The checksum is wrong.
        FrameError: It is no ASCII, or the checksum is missing or unreadable.
    """
    try:
        text = line.decode("ascii").strip()
    except UnicodeDecodeError as error:
        raise FrameError("no ASCII") from error
    body, star, digits = text.partition("*")
    if not star:
        if sealed:
            raise FrameError("no checksum")
        return text
    if not re.fullmatch("[0-9a-fA-F]{2}", digits):
        raise FrameError("an unreadable checksum")
    if int(digits, 16) != reduce(xor, body.encode("ascii"), 0):
        raise CrcError("checksum")
    return body


class Line:
    """Lines of a board.

    Args:
        fields: What is in them, in order.
        inputs: Names of the inputs, in the order of the numbers.
        sealed: Lines without checksum are refused.
    """

    def __init__(self, fields: Sequence[str], inputs: Sequence[str], sealed: bool = False) -> None:
        self._fields = tuple(fields)
        self._places = [self._fields.index(name) for name in inputs]
        self._own = {name: self._fields.index(name) for name in OWN_FIELDS if name in self._fields}
        self._sealed = sealed

    def read(self, line: bytes) -> BoardSample | None:
        """The sample in a line without its LF; None for an empty line or a comment.

        Raises:
            CrcError: The checksum is wrong.
            FrameError: Not these fields, or no numbers.
        """
        text = opened(line, self._sealed and line.strip()[:1] not in (b"", b"#"))
        if not text or text.startswith("#"):
            return None
        words = _GAPS.split(text)
        if len(words) != len(self._fields):
            raise FrameError(f"{len(words)} fields instead of {len(self._fields)}")
        own = {name: _whole(words[place], _OWN[name]) for name, place in self._own.items()}
        numbers = [_number(words[place]) for place in self._places]
        age = own.get("age")
        heard = age is None or age != 0xFFFF
        return BoardSample(
            own.get("sequence"),
            own.get("time"),
            own.get("status", 0),
            own.get("ack") if heard else None,
            age if heard else None,
            numbers,
        )

    def write(self, s: BoardSample) -> bytes:
        """The line of a sample."""
        words = [""] * len(self._fields)
        never = s.ack is None
        own = {
            "time": s.time_us or 0,
            "sequence": s.sequence or 0,
            "status": s.status,
            "ack": s.ack or 0,
            "age": 0xFFFF if never or s.age_us is None else min(s.age_us, 0xFFFF),
        }
        for name, place in self._own.items():
            words[place] = str(own[name])
        for place, number in zip(self._places, s.numbers, strict=True):
            words[place] = f"{number:.9g}"
        return seal(",".join(words))


def command(sequence: int, numbers: Sequence[float]) -> bytes:
    """The daemon's command."""
    return seal(f"u {sequence & 0xFF} " + " ".join(f"{number:.9g}" for number in numbers))


def read_command(text: str, outputs: int) -> tuple[int, list[float]]:
    """Sequence and numbers of a command without its checksum.

    Raises:
        FrameError: It is no command for so many outputs.
    """
    words = text.split()
    if words[:1] != ["u"] or len(words) != outputs + 2:
        raise FrameError(f"{text[:40]!r} is no command")
    return _whole(words[1], 255), [_number(word) for word in words[2:]]


def board_version(line: bytes) -> int | None:
    """The version that a board prints in a comment; None if this line tells none."""
    found = re.match(rb"#\s*seod (\d{1,3})\b", line)
    return int(found[1]) if found else None


def _whole(word: str, largest: int) -> int:
    if not re.fullmatch("[0-9]{1,10}", word) or int(word) > largest:
        raise FrameError(f"{word[:20]!r} is no whole number up to {largest}")
    return int(word)


def _number(word: str) -> float:
    try:
        number = float(word)
    except ValueError as error:
        raise FrameError(f"{word[:20]!r} is no number") from error
    if not math.isfinite(number):
        raise FrameError(f"{word[:20]!r} is no number")
    return number
