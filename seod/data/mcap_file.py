"""MCAP: seod's own recordings, and the JSON messages of others.

The channels `/rows/AXIS` of a seod recording become one group whose columns are those of its CSV form: each
tick is a row, with several axes `t`, `u` ... carry the axis. Every other channel is a group of its own.
"""

from __future__ import annotations

import json
import struct
from collections import defaultdict
from typing import IO, TYPE_CHECKING, Any

from mcap.exceptions import EndOfFile, McapError, UnsupportedCompressionError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Footer, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from seod.data.mcap_rows import (
    LOG_TIME,
    MORE,
    ROWS_GROUP,
    Fields,
    JsonRows,
    TickRows,
    flat,
    rows_group,
    schema_columns,
)
from seod.data.source import BLOCK_ROWS, Block, Column, Group, ReadError, Remark
from seod.record.layout import PROFILE, ROWS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

_EXPLORED_BYTES = 1 << 23
"""How far into a file that has a summary the fields of JSON messages are looked for."""
_CUT_OFF = (EndOfFile, struct.error, UnicodeDecodeError)


class McapSource:
    """An MCAP file, whole or cut off.

    Raises:
        ReadError: It is no MCAP file.
    """

    format = "mcap"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: list[Remark] = []
        self._size = max(1, path.stat().st_size)
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._fields: dict[int, Fields] = defaultdict(Fields)
        self._profile = ""
        self.notes: Mapping[str, str] = {}
        self._explore()
        self.remarks.clear()  # the blocks will tell them again
        self._axes = [c.topic.removeprefix(ROWS) for c in self._sorted() if self._is_rows(c)]
        self.groups: tuple[Group, ...] = tuple(self._make_groups())

    def close(self) -> None:
        """Nothing stays open."""

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`."""
        gathered = {
            group.name: self._rows(group, wanted[group.name]) for group in self.groups if group.name in wanted
        }
        with self.path.open("rb") as file:
            for record in self._records(file):
                rows = gathered.get(self._group_of(record)) if isinstance(record, Message) else None
                if rows is None or not isinstance(record, Message):
                    continue
                if isinstance(rows, TickRows):
                    rows.add(self._channels[record.channel_id].topic.removeprefix(ROWS), record.data)
                else:
                    rows.add(self._content(record))
                if len(rows) >= BLOCK_ROWS:
                    yield rows.block(min(1.0, file.tell() / self._size))
        for rows in gathered.values():
            yield rows.block(1.0, last=True) if isinstance(rows, TickRows) else rows.block(1.0)

    def _rows(self, group: Group, names: Sequence[str]) -> TickRows | JsonRows:
        if group.name == ROWS_GROUP:
            return TickRows(group, names, self.path, self._axes)
        return JsonRows(group, names)

    def _explore(self) -> None:
        """Channels by the summary, fields by the beginning; both by the whole file if it has no summary."""
        with self.path.open("rb") as file:
            try:
                summary = make_reader(file).get_summary()
            except (*_CUT_OFF, McapError, OSError, ValueError):
                summary = None
            if summary is not None:
                self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
            file.seek(0)
            for record in self._records(file):
                if isinstance(record, Message):
                    self._fields[record.channel_id].see(self._content(record))
                if summary is not None and file.tell() > _EXPLORED_BYTES:
                    return

    def _records(self, file: IO[bytes]) -> Iterator[object]:
        """All records, those in chunks too, as far as the file is whole; keeps what describes it."""
        reader = StreamReader(file, emit_chunks=True).records
        while True:
            try:
                record = next(reader)
            except StopIteration:
                return
            except _CUT_OFF:
                self._cut_off(file)
                return
            except McapError as error:
                raise ReadError(f"{self.path}: {error}") from error
            for each in self._unpacked(record):
                self._keep(each)
                yield each
            if isinstance(record, Footer):
                return

    def _cut_off(self, file: IO[bytes]) -> None:
        if file.tell() < 8:
            raise ReadError(f"{self.path}: is no MCAP file")
        self.remarks.append(Remark("truncated", "the file was not closed: read to its last whole chunk"))

    def _unpacked(self, record: object) -> Sequence[object]:
        if not isinstance(record, Chunk):
            return [record]
        try:
            return breakup_chunk(record, validate_crc=True)
        except UnsupportedCompressionError as error:
            raise ReadError(f"{self.path}: {error}: pip install lz4 zstandard") from error
        except (ValueError, RuntimeError, McapError, struct.error) as error:
            self.remarks.append(Remark("damaged", f"a chunk is damaged and left out: {error}"))
            return []

    def _keep(self, record: object) -> None:
        match record:
            case Header():
                self._profile = record.profile
                self._note(profile=record.profile, library=record.library)
            case Channel():
                self._channels[record.id] = record
            case Schema():
                self._schemas[record.id] = record
            case Metadata():
                self._note(**{f"{record.name}.{key}": value for key, value in record.metadata.items()})
            case Attachment():
                self._note(**{f"attachment {record.name}": f"{len(record.data)} bytes"})

    def _note(self, **notes: str) -> None:
        self.notes = {**self.notes, **notes}

    def _sorted(self) -> list[Channel]:
        return [self._channels[number] for number in sorted(self._channels)]

    def _is_rows(self, channel: Channel) -> bool:
        return self._profile == PROFILE and channel.topic.startswith(ROWS)

    def _group_of(self, record: Message) -> str:
        channel = self._channels[record.channel_id]
        return ROWS_GROUP if self._is_rows(channel) else channel.topic

    def _make_groups(self) -> Iterator[Group]:
        if self._axes:
            yield rows_group(self._axes)
        for channel in self._sorted():
            if self._is_rows(channel):
                continue
            if channel.message_encoding == "json":
                columns = (Column(LOG_TIME, "s"), *self._columns(channel), Column(MORE, text=True))
                yield Group(channel.topic, columns, LOG_TIME, main=self._profile != PROFILE)
            else:
                message = f"{channel.topic}: messages are {channel.message_encoding}, only json is read"
                self.remarks.append(Remark("unread", message))

    def _columns(self, channel: Channel) -> list[Column]:
        schema = self._schemas.get(channel.schema_id)
        told = schema_columns(schema.data) if schema is not None and schema.encoding == "jsonschema" else []
        return self._fields[channel.id].columns(told)

    def _content(self, record: Message) -> dict[str, Any]:
        channel = self._channels[record.channel_id]
        if channel.message_encoding != "json":
            return {}
        try:
            content = json.loads(record.data)
        except ValueError as error:
            raise ReadError(f"{self.path}: {channel.topic}: message {record.sequence}: {error}") from error
        own = flat(content if isinstance(content, dict) else {"value": content})
        return {**own, LOG_TIME: record.log_time * 1e-9}
