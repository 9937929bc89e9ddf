"""Reading an MCAP recording of this program in the order in which it was written, for a replay.

(`seod.data` reads recordings of all kinds as columns; here events keep their place between the rows.)
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

from seod.record import layout
from seod.ring import AXIS_FIELDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from mcap.records import McapRecord
    from numpy.typing import NDArray

    Item = NDArray[np.void] | dict[str, Any]

BROKEN = (McapError, ValueError, struct.error, ZstdError, EOFError, MemoryError, OverflowError)
"""What the library raises where a file ends in the middle or is damaged."""


class RecordingError(Exception):
    """A file is no recording of this program; the message says which and what is wrong."""


@dataclass(frozen=True, slots=True)
class Beginning:
    """What a recording says before its first row.

    Attributes:
        axes: Names of the axes.
        facts: The metadata record.
        rig: The rig file as it was read.
    """

    axes: tuple[str, ...]
    facts: dict[str, str]
    rig: dict[str, Any]


def beginning(path: Path) -> Beginning:
    """Read the head of a recording.

    Raises:
        RecordingError: It is none.
        OSError: It cannot be read.
    """
    rig = "{}"
    for record in records(path):
        if isinstance(record, Attachment) and record.name == layout.RIG:
            rig = record.data.decode(errors="replace")
        if isinstance(record, Metadata) and record.name == layout.PROFILE:
            return _begun(path, record.metadata, rig)
        if isinstance(record, Chunk):
            break
    raise RecordingError(f"{path}: is no recording of seod (`seod run --record FILE.mcap` makes one)")


def _begun(path: Path, facts: dict[str, str], rig: str) -> Beginning:
    missing = {"axes", "started"} - facts.keys()
    try:
        if not missing:
            return Beginning(tuple(json.loads(facts["axes"])), facts, json.loads(rig))
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{path}: its beginning is damaged: {error}") from error
    raise RecordingError(f"{path}: its beginning is damaged: no {', '.join(sorted(missing))}")


def records(path: Path) -> Iterator[McapRecord]:
    """The records up to the last whole one, chunks as they are."""
    with path.open("rb") as stream:
        found = iter(StreamReader(stream, emit_chunks=True).records)
        while True:
            try:
                record = next(found)
            except (StopIteration, *BROKEN):
                return
            yield record


def parts(path: Path) -> list[Path]:
    """The files of one recording from `path` on: `NAME.mcap`, `NAME.0002.mcap` and so on.

    Raises:
        RecordingError, OSError: As `beginning`.
    """
    found = [path]
    started = beginning(path).facts["started"]
    while True:
        following = path.with_suffix(f".{len(found) + 1:04}{path.suffix}")
        if not following.is_file() or _started(following) != started:
            return found
        found.append(following)


def _started(path: Path) -> str | None:
    """When the recording was begun; None for a file that was cut off before it said so."""
    try:
        return beginning(path).facts["started"]
    except RecordingError:
        return None


def items(path: Path, axes: Sequence[str]) -> Iterator[Item]:
    """Rows (dtype `layout.row_dtype`, shape (n,)) and events, in the order in which the gateway took them.

    In the place of a damaged chunk there is a warning `rows_lost`.

    Raises:
        RecordingError, OSError: As `beginning`.
    """
    for part in parts(path):
        join = _Join(axes)
        for record in records(part):
            if isinstance(record, Chunk):
                yield from join.chunk(record)
            elif isinstance(record, DataEnd):
                break


class _Join:
    """Makes rows of all axes out of the messages of each."""

    def __init__(self, axes: Sequence[str]) -> None:
        self._axes = axes
        self._topics: dict[int, str] = {}
        self._t = 0.0
        self._messages: dict[str, list[bytes]] = {layout.ROWS + axis: [] for axis in axes}

    def chunk(self, chunk: Chunk) -> Iterator[Item]:
        try:
            content = breakup_chunk(chunk, validate_crc=True)
        except BROKEN:
            why = "a part of the recording is damaged and left out"
            yield {"event": "warning", "t": self._t, "axis": None, "code": "rows_lost", "why": why}
            return
        for record in content:
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield from self._message(self._topics.get(record.channel_id, ""), record.data)
        yield from self._rows()

    def _message(self, topic: str, data: bytes) -> Iterator[Item]:
        if topic in self._messages:
            self._messages[topic].append(data)
        elif topic == layout.EVENTS:
            yield from self._rows()
            yield json.loads(data)

    def _rows(self) -> Iterator[Item]:
        of_axes = [layout.decode(messages) for messages in self._messages.values()]
        if len(of_axes[0]):
            self._t = float(of_axes[0]["t_tick"][-1])
            yield joined(of_axes)
        for messages in self._messages.values():
            messages.clear()


def joined(of_axes: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Rows (dtype `layout.row_dtype`) of the messages (dtype `layout.ROW`) of each axis."""
    rows = np.zeros(len(of_axes[0]), layout.row_dtype(len(of_axes)))
    rows["tick"], rows["tick_t"] = of_axes[0]["tick"], of_axes[0]["t_tick"]
    for number, messages in enumerate(of_axes):
        for name in (*AXIS_FIELDS, "state", "flags"):
            rows["axes"][name][:, number] = messages[name]
    return rows
