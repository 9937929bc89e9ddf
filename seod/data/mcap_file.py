"""MCAP: seod's own recordings, and the JSON messages of others.

The channels `/rows/AXIS` of a seod recording become one group whose columns are those of its CSV form: each
tick is a row, with several axes `t`, `u` ... carry the axis. Every other channel is a group of its own.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from typing import IO, TYPE_CHECKING, Any

from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema

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
from seod.data.source import BLOCK_ROWS, Block, Column, Group, Remark
from seod.files.damage import DamagedError
from seod.record.layout import PROFILE, ROW, ROWS
from seod.record.mcap_records import Damage, records, summary_of, unpacked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import McapRecord

_EXPLORED_BYTES = 1 << 23
"""How far into a file that has a summary the fields of JSON messages are looked for."""


class McapSource:
    """An MCAP file, whole, damaged or cut off.

    Raises:
        DamagedError: It is no MCAP file.
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
        if self.remarks and not self._channels:
            raise DamagedError(self.remarks[0].message)
        self.remarks.clear()  # the blocks will tell them again
        self._axes = [c.topic.removeprefix(ROWS) for c in self._sorted() if self._is_rows(c)]
        self.groups: tuple[Group, ...] = tuple(self._make_groups())

    def close(self) -> None:
        """Nothing stays open."""

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; what is damaged is left out and said."""
        gathered = {
            group.name: self._rows(group, wanted[group.name]) for group in self.groups if group.name in wanted
        }
        lost: Counter[str] = Counter()
        with self.path.open("rb") as file:
            for message in self._messages(file, lost):
                rows = gathered.get(self._group_of(message))
                if rows is None:
                    continue
                self._add(rows, message, lost)
                if len(rows) >= BLOCK_ROWS:
                    yield rows.block(min(1.0, file.tell() / self._size))
        for rows in gathered.values():
            yield rows.block(1.0, last=True) if isinstance(rows, TickRows) else rows.block(1.0)
        self.remarks += [Remark("damaged", f"{what}: {n} messages left out", n) for what, n in lost.items()]

    def _add(self, rows: TickRows | JsonRows, message: Message, lost: Counter[str]) -> None:
        topic = self._channels[message.channel_id].topic
        if isinstance(rows, JsonRows):
            content = self._content(message)
            if content is None:
                lost[f"{topic}: no JSON"] += 1
            else:
                rows.add(content)
        elif len(message.data) != ROW.itemsize:
            lost[f"{topic}: not the {ROW.itemsize} bytes of a row"] += 1
        else:
            rows.add(topic.removeprefix(ROWS), message.data)

    def _rows(self, group: Group, names: Sequence[str]) -> TickRows | JsonRows:
        if group.name == ROWS_GROUP:
            return TickRows(group, names, self.path, self._axes)
        return JsonRows(group, names)

    def _explore(self) -> None:
        """Channels by the summary, fields by the beginning; both by the whole file if it has no summary."""
        with self.path.open("rb") as file:
            summary = summary_of(file)
            if summary is not None:
                self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
            for message in self._messages(file, Counter()):
                self._fields[message.channel_id].see(self._content(message) or {})
                if summary is not None and file.tell() > _EXPLORED_BYTES:
                    return

    def _messages(self, file: IO[bytes], lost: Counter[str]) -> Iterator[Message]:
        """All messages of channels that are known; keeps what describes the file."""
        for found in records(file, self._size):
            for record in self._opened(found):
                if not isinstance(record, Message):
                    self._keep(record)
                elif record.channel_id in self._channels:
                    yield record
                else:
                    lost[f"channel {record.channel_id}, which is not described"] += 1

    def _opened(self, record: McapRecord | Damage) -> Sequence[McapRecord]:
        """The records of a chunk, or the one; none where it is damaged, which is remarked."""
        if isinstance(record, Damage):
            kind = "truncated" if record.is_end else "damaged"
            end = "; what was written after the last whole chunk is missing" if record.is_end else ""
            self.remarks.append(Remark(kind, f"{record.message}{end}"))
            return []
        if not isinstance(record, Chunk):
            return [record]
        try:
            return unpacked(record)
        except DamagedError as error:
            self.remarks.append(Remark("damaged", f"a chunk is damaged and left out: {error}"))
            return []

    def _keep(self, record: McapRecord) -> None:
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
            channels = {each.topic.removeprefix(ROWS): each for each in self._sorted() if self._is_rows(each)}
            yield rows_group(self._axes, {axis: each.metadata for axis, each in channels.items()})
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

    def _content(self, message: Message) -> dict[str, Any] | None:
        """The fields of a JSON message; None if it is none."""
        if self._channels[message.channel_id].message_encoding != "json":
            return {}
        try:
            content = json.loads(message.data)
            own = flat(content if isinstance(content, dict) else {"value": content})
        except (ValueError, RecursionError):
            return None
        return {**own, LOG_TIME: message.log_time * 1e-9}
