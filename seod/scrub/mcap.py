"""MCAP recordings: attachments lose their tokens in place; nothing moves, so all other bytes stay."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk
from mcap.stream_reader import get_chunk_data_stream

from seod.files.damage import DamagedError, bounded, library
from seod.scrub.changes import Changes, ScrubError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
"""Of a record: its kind, and the length of its content."""
_CRC = struct.Struct("<I")
_BLOCK = 1 << 20
"""Bytes that are read at a time where only a checksum is wanted."""


class Record(NamedTuple):
    """A record: its kind, where its content begins, and how long that is."""

    kind: int
    start: int
    length: int


@dataclass
class Survey:
    """What is in a whole and undamaged recording.

    Attributes:
        changes: What has to change in its attachments.
        crc_at: Where the checksum of all its data stands; None where it has none.
        leaks: Whether a message holds a token that an attachment holds too.
    """

    changes: Changes = field(default_factory=Changes)
    crc_at: int | None = None
    leaks: bool = False


def survey(path: Path, known: Changes | None = None) -> Survey:
    """Look at all of a recording: every checksum, every chunk unpacked.

    Args:
        path: The file.
        known: Tokens to look for besides those that its attachments hold.

    Raises:
        ScrubError: It is cut off or damaged.
        OSError: It cannot be read.
    """
    found = Survey()
    found.changes.spellings |= known.spellings if known else set()
    with path.open("rb") as file:
        try:
            with bounded(path.stat().st_size), library(_NotWholeError):
                _look_at_all(file, found)
        except _NotWholeError as error:
            what = f"{path}: {error}: not touched; `mcap recover` makes a whole file of it"
            raise ScrubError(what) from error
        except DamagedError as error:
            raise ScrubError(f"{path}: is damaged ({error}): not touched") from error
    return found


def _look_at_all(file: IO[bytes], found: Survey) -> None:
    records = list(_records(file))
    for record in records:
        if record.kind == Opcode.ATTACHMENT:
            _attachment(file, record, found)
    for record in records:
        if record.kind == Opcode.CHUNK:
            found.leaks |= _chunk_leaks(file, record, found.changes)
    _ending(file, records, found)


class _NotWholeError(Exception):
    """What is wrong with the file."""


def _records(file: IO[bytes]) -> Iterator[Record]:
    """All records of a file that begins and ends as it should."""
    size = file.seek(0, 2)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise _NotWholeError("is no MCAP file")
    kind, at = 0, len(MAGIC)
    while kind != Opcode.FOOTER:
        file.seek(at)
        head = file.read(_HEAD.size)
        kind, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, size)
        at += _HEAD.size
        if not kind or at + length > size:
            raise _NotWholeError("is not ended: it was cut off, or is still recorded to")
        yield Record(kind, at, length)
        at += length
    file.seek(at)
    if file.read() != MAGIC:
        raise _NotWholeError("is damaged: its end mark is missing")


def _content(file: IO[bytes], record: Record) -> bytes:
    file.seek(record.start)
    return file.read(record.length)


def _attachment(file: IO[bytes], record: Record, found: Survey) -> None:
    content = _content(file, record)
    _agree(zlib.crc32(content[: -_CRC.size]), content[-_CRC.size :], "an attachment")
    attached = Attachment.read(ReadDataStream(BytesIO(content)))
    try:
        text = attached.data.decode()
    except UnicodeDecodeError:  # no rig file
        return
    begin = len(content) - _CRC.size - len(attached.data)
    clean = found.changes.take(text, record.start + begin)
    if clean != attached.data:
        crc = zlib.crc32(content[:begin] + clean)
        found.changes.patches.append((record.start + record.length - _CRC.size, _CRC.pack(crc)))


def _chunk_leaks(file: IO[bytes], record: Record, changes: Changes) -> bool:
    chunk = Chunk.read(ReadDataStream(BytesIO(_content(file, record))))
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return changes.in_bytes(stream.read(length))


def _ending(file: IO[bytes], records: list[Record], found: Survey) -> None:
    """The checksums of the data and of the summary."""
    last = next((record for record in records if record.kind == Opcode.DATA_END), None)
    if last is None:
        raise _NotWholeError("is damaged: the end of its data is missing")
    if any(_content(file, last)):
        _agree(checksum(file, 0, last.start - _HEAD.size), _content(file, last), "the data")
        found.crc_at = last.start
    footer = records[-1]
    start = struct.unpack_from("<Q", _content(file, footer))[0] or footer.start - _HEAD.size
    end = footer.start + footer.length - _CRC.size
    stated = _content(file, footer)[-_CRC.size :]
    if any(stated):
        _agree(checksum(file, start, end), stated, "the summary")


def _agree(calculated: int, stated: bytes, what: str) -> None:
    if any(stated) and _CRC.pack(calculated) != stated:
        raise _NotWholeError(f"is damaged: the checksum of {what} is wrong")


def checksum(file: IO[bytes], start: int, end: int) -> int:
    """CRC-32 of a part of a file."""
    crc = 0
    file.seek(start)
    while start < end:
        block = file.read(min(_BLOCK, end - start))
        if not block:
            break
        crc = zlib.crc32(block, crc)
        start += len(block)
    return crc


def patch(path: Path, found: Survey) -> None:
    """Carry out the changes in a copy.

    Raises:
        OSError: It cannot be written.
    """
    with path.open("r+b") as file:
        for at, data in found.changes.patches:
            file.seek(at)
            file.write(data)
        if found.crc_at is not None:
            crc = checksum(file, 0, found.crc_at - _HEAD.size)
            file.seek(found.crc_at)
            file.write(_CRC.pack(crc))
