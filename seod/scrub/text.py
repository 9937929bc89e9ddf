"""CSV and other text, plain or gzip: every token that a line with its key tells is taken out of all lines."""

from __future__ import annotations

import gzip
import zlib
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, cast

from seod.config.token_field import FILL
from seod.scrub.changes import Changes, ScrubError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_KEY = b"_token"
_MAGIC = b"\x1f\x8b"
_LONGEST = 1 << 24
"""Bytes of a line; longer ones are no text."""


def survey(path: Path) -> Changes:
    """The tokens that the lines of a file tell.

    Raises:
        ScrubError: It is damaged.
        OSError: It cannot be read.
    """
    changes = Changes()
    with _reading(path) as lines:
        for line in _cut(lines):
            if _KEY in line:
                changes.learn(line.decode(errors="surrogateescape"))
    return changes


def _cut(lines: IO[bytes]) -> Iterator[bytes]:
    while line := lines.readline(_LONGEST):
        yield line


@contextmanager
def _reading(path: Path) -> Iterator[IO[bytes]]:
    if not _is_packed(path):
        with path.open("rb") as file:
            yield file
        return
    try:
        with gzip.open(path) as file:
            yield cast("IO[bytes]", file)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScrubError(f"{path}: is cut off or damaged: {error}: not touched") from error


def _is_packed(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


@contextmanager
def _writing(path: Path, packed: bool) -> Iterator[IO[bytes]]:
    with path.open("wb") as file:
        if not packed:
            yield file
            return
        with gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0) as lines:
            yield cast("IO[bytes]", lines)


def patch(path: Path, source: Path, changes: Changes) -> None:
    """Write the source without the tokens.

    Raises:
        OSError: It cannot be written.
    """
    with _writing(path, _is_packed(source)) as file, _reading(source) as lines:
        for line in _cut(lines):
            file.write(_clean(line, changes))


def _clean(line: bytes, changes: Changes) -> bytes:
    for spelling in sorted(changes.spellings, key=len, reverse=True):
        line = line.replace(spelling, FILL.encode() * len(spelling))
    return line


def holds(path: Path, changes: Changes) -> bool:
    """Whether a token is still in a file."""
    with _reading(path) as lines:
        return any(changes.in_bytes(line) for line in _cut(lines))
