"""The records of an MCAP file that may be cut off or damaged; one bad record costs itself.

A record's length is believed only as far as the file goes. Where lengths cannot be followed any more, the
next chunk is found by the index at the file's end, if it has one.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from dataclasses import dataclass
from io import BytesIO
from typing import IO, TYPE_CHECKING, Any, Final, cast

import zstandard
from lz4 import frame as lz4_frame
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Header, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk, get_chunk_data_stream

from seod.files.damage import DamagedError, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mcap.records import McapRecord

MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = 22
"""Bytes of a message before its data: channel, sequence, two times."""
_READ: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
"""Records that are read; others, such as indices, are passed over."""
_UNPACKED_BYTES: Final = 64 << 20
"""What a chunk may hold unpacked ..."""
_UNPACKED_TIMES: Final = 16
"""... beside so many times its own length; writers make chunks of 1 to 16 MB."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A place in a file from which nothing could be read.

    Attributes:
        message: What is wrong there.
        is_end: The file ends there, as that of a writer that was killed does.
    """

    message: str
    is_end: bool = False


def records(file: IO[bytes], size: int) -> Iterator[McapRecord | Damage]:
    """The records of a file of `size` bytes up to its footer, chunks as they are; and what is damaged.

    Raises:
        DamagedError: It is no MCAP file.
    """
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise DamagedError("its first bytes are not those of an MCAP file")
    starts: Sequence[int] | None = None
    at = len(MAGIC)
    while True:
        found, end = _record(file, at, size)
        if found is not None:
            yield found
        if isinstance(found, Footer):
            return
        if end is None:
            starts = _chunk_starts(file) if starts is None else starts
            following = bisect_right(starts, at)
            if following == len(starts):
                return
            end = starts[following]
        at = end


def _record(file: IO[bytes], at: int, size: int) -> tuple[McapRecord | Damage | None, int | None]:
    """The record there, None for one that is passed over; and where it ends, None if that is not known."""
    file.seek(at)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return Damage("the file was not closed", is_end=True), None
    opcode, length = _HEAD.unpack(head)
    end = at + _HEAD.size + length
    if opcode == 0 or end > size:
        return Damage(f"byte {at}: no whole record begins there", is_end=not _is_closed(file)), None
    if opcode != Opcode.MESSAGE and opcode not in _READ:
        return None, end
    content = ReadDataStream(BytesIO(file.read(length)))
    try:
        with library():
            read = Message.read(content, length) if opcode == Opcode.MESSAGE else _READ[opcode].read(content)
    except DamagedError as error:
        return Damage(f"byte {at}: a record is damaged: {error}"), end
    return read, end


def _is_closed(file: IO[bytes]) -> bool:
    file.seek(-len(MAGIC), 2)
    return file.read() == MAGIC


def _chunk_starts(file: IO[bytes]) -> list[int]:
    """Where chunks begin, by the index; none where there is no such index."""
    summary = summary_of(file)
    return [] if summary is None else sorted({index.chunk_start_offset for index in summary.chunk_indexes})


def summary_of(file: IO[bytes]) -> Any:
    """The summary at the end of the file; None if it has none that can be read."""
    try:
        with library():
            return make_reader(cast("IO[bytes]", _Whole(file))).get_summary()  # which seeks, tells and reads
    except DamagedError:
        return None


class _Whole:
    """A file that takes no memory for what it does not hold: it refuses to read beyond its end."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._size = file.seek(0, 2)
        file.seek(0)
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, length: int = -1) -> bytes:
        if not 0 <= length <= self._size - self._file.tell():
            raise DamagedError("a length is beyond the end of the file")
        return self._file.read(length)


def unpacked(chunk: Chunk) -> list[McapRecord]:
    """The records in a chunk.

    Raises:
        DamagedError: Its content is damaged, or packed in a way that is not known.
    """
    _bounded(chunk)
    with library():
        return breakup_chunk(chunk, validate_crc=True)


def messages(chunk: Chunk) -> Iterator[Channel | tuple[int, bytes]]:
    """Channels and messages in a chunk, in their order; a message is the number of its channel and its data.

    Does as `unpacked` in a tenth of the time, for whoever needs no more of a message.

    Raises:
        DamagedError: As `unpacked`.
    """
    _bounded(chunk)
    with library():
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        content = stream.read(size)
    at = 0
    while at + _HEAD.size <= size:
        opcode, length = _HEAD.unpack_from(content, at)
        at += _HEAD.size
        if at + length > size:
            raise DamagedError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE_HEAD:
                raise DamagedError("a message is shorter than its head")
            yield content[at] | content[at + 1] << 8, content[at + _MESSAGE_HEAD : at + length]
        elif opcode == Opcode.CHANNEL:
            with library():
                yield Channel.read(ReadDataStream(BytesIO(content[at : at + length])))
        at += length


def _bounded(chunk: Chunk) -> None:
    """See that a chunk does not unpack to more than it may.

    Raises:
        DamagedError: It does, or it is packed in a way that is not known.
    """
    most = _UNPACKED_BYTES + _UNPACKED_TIMES * len(chunk.data)
    with library():
        told = [chunk.uncompressed_size]
        if chunk.compression == "zstd":
            told.append(zstandard.frame_content_size(chunk.data))
        elif chunk.compression == "lz4":
            told.append(lz4_frame.get_frame_info(chunk.data)["content_size"])
        elif chunk.compression:
            raise DamagedError(f"packed by {chunk.compression!r}, which is not known")
        if max(told) > most:
            raise MemoryError
