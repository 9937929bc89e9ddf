"""Lines of SCPI into commands, without sockets: `SOUR:REL:AMPL 0.5 V,(@motor);HYST 4 mrad;:INIT`.

Source: SCPI-1999, volume 1 (syntax), IEEE 488.2. After `;` a header goes on from where the last one
stood, but for its last word; `:` in front starts at the root; common commands (`*RST`) change nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.scpi.errors import ScpiError

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_LINE: Final = 4096
"""Longest line [bytes]."""
MAX_COMMANDS: Final = 32
"""Commands in a line."""
_HEADER: Final = re.compile(
    r"\s*(\*[A-Za-z]{1,12}|:?[A-Za-z][A-Za-z0-9_]{0,11}(?::[A-Za-z][A-Za-z0-9_]{0,11})*)(\?)?"
)
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_SUFFIX: Final = re.compile(r"[A-Za-z%][A-Za-z%/*0-9.]*")
_WORD: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_CHANNEL: Final = re.compile(r"\s*[A-Za-z][A-Za-z0-9_-]{0,31}\s*")


@dataclass(frozen=True, slots=True)
class Number:
    """A number with its suffix, if it has one."""

    value: float
    suffix: str = ""


@dataclass(frozen=True, slots=True)
class Word:
    """A word such as ON."""

    text: str


@dataclass(frozen=True, slots=True)
class Text:
    """A text in quotes."""

    text: str


@dataclass(frozen=True, slots=True)
class Channels:
    """A list of axes: `(@pitch,roll)`."""

    names: tuple[str, ...]


Argument = Number | Word | Text | Channels


@dataclass(frozen=True, slots=True)
class Command:
    """One command of a line.

    Attributes:
        header: Its words, in capitals, from the root; of a common command one word with its `*`.
        query: It ends in `?`.
        arguments: In their order.
    """

    header: tuple[str, ...]
    query: bool
    arguments: tuple[Argument, ...]


def parse(line: bytes) -> Iterator[Command]:
    """The commands of a line, in their order.

    Raises:
        ScpiError: What comes next cannot be read; commands before it have been given.
    """
    if len(line) > MAX_LINE:
        raise ScpiError(-363, f"a line has at most {MAX_LINE} bytes")
    try:
        text = line.decode("ascii").strip()
    except UnicodeDecodeError:
        raise ScpiError(-101, "only ASCII") from None
    if any(ord(char) < 32 and char != "\t" for char in text):
        raise ScpiError(-101)
    path: tuple[str, ...] = ()
    for number, part in enumerate(split(text, ";")):
        if number >= MAX_COMMANDS:
            raise ScpiError(-363, f"a line has at most {MAX_COMMANDS} commands")
        if part.strip():
            command, path = _command(part, path)
            yield command


def split(text: str, at: str) -> list[str]:
    """Cut a text where a character stands outside of quotes and brackets.

    Raises:
        ScpiError: A quote or a bracket is not closed.
    """
    parts, begin, quote, depth = [], 0, "", 0
    for place, char in enumerate(text):
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        elif char in "()":
            depth += 1 if char == "(" else -1
        elif char == at and depth == 0:
            parts.append(text[begin:place])
            begin = place + 1
        if depth < 0:
            break
    if quote or depth:
        raise ScpiError(-102, "a quote or a bracket stands alone")
    return [*parts, text[begin:]]


def _command(part: str, path: tuple[str, ...]) -> tuple[Command, tuple[str, ...]]:
    """One command, and the path that the next one starts from."""
    found = _HEADER.match(part)
    if found is None:
        raise ScpiError(-102, f"no header: {part.strip()[:20]!r}")
    words, rest = found[1].upper(), part[found.end() :]
    if rest and not rest[0].isspace() and rest.strip()[:1] not in {"(", ""}:
        raise ScpiError(-102, f"after {found[0].strip()!r} comes a space, or nothing")
    arguments = tuple(_argument(each) for each in split(rest, ",")) if rest.strip() else ()
    query = found[2] is not None
    if words.startswith("*"):
        return Command((words,), query, arguments), path
    header = (*(() if words.startswith(":") else path), *words.removeprefix(":").split(":"))
    return Command(header, query, arguments), header[:-1]


def _argument(text: str) -> Argument:
    text = text.strip()
    if text[:1] in {'"', "'"}:
        return _quoted(text)
    if text.startswith("(@") and text.endswith(")"):
        return _channels(text[2:-1])
    number = _NUMBER.match(text)
    if number is not None:
        return _number(float(number[0]), text[number.end() :].strip())
    if _WORD.fullmatch(text):
        return Word(text.upper())
    raise ScpiError(-104 if text else -109, text[:20])


def _quoted(text: str) -> Text:
    inner = text[1:-1]
    if len(text) < 2 or text[-1] != text[0] or text[0] in inner.replace(2 * text[0], ""):
        raise ScpiError(-102, "a text ends with the quote that it began with")
    return Text(inner.replace(2 * text[0], text[0]))


def _channels(text: str) -> Channels:
    names = text.split(",")
    if not all(_CHANNEL.fullmatch(each) for each in names):
        raise ScpiError(-224, f"a list of axes is (@name,name): {text[:20]!r}")
    return Channels(tuple(each.strip() for each in names))


def _number(value: float, suffix: str) -> Number:
    if abs(value) == float("inf"):
        raise ScpiError(-222, "too large")
    if suffix and not _SUFFIX.fullmatch(suffix):
        raise ScpiError(-131, suffix[:12])
    return Number(value, suffix)
