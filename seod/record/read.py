"""Reading an MCAP recording of this program in the order in which it was written, for a replay.

(`seod.data` reads recordings of all kinds as columns; here events keep their place between the rows.)
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata

from seod.files.damage import DamagedError, library, plain
from seod.files.user_files import irregular
from seod.processes.ring import AXIS_FIELDS
from seod.record import layout
from seod.record.mcap_records import Damage, records, unpacked

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from mcap.records import McapRecord
    from numpy.typing import NDArray

    Item = NDArray[np.void] | dict[str, Any]


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
    for record in records_of(path):
        if isinstance(record, Attachment) and record.name == layout.RIG:
            rig = record.data.decode(errors="replace")
        if isinstance(record, Metadata) and record.name == layout.PROFILE:
            return begun(path, record.metadata, rig)
        if isinstance(record, Chunk):
            break
    raise RecordingError(f"{path}: is no recording of seod (`seod run --record FILE.mcap` makes one)")


def begun(path: Path | str, facts: dict[str, str], rig: str) -> Beginning:
    """What the metadata record and the rig file as it was read (JSON) say.

    Args:
        path: Of the file, for the message.
        facts: The metadata record.
        rig: The attachment.

    Raises:
        RecordingError: Something is missing, or no JSON.
    """
    missing = {"axes", "started"} - facts.keys()
    if missing:
        raise RecordingError(f"{path}: its beginning is damaged: no {', '.join(sorted(missing))}")
    try:
        axes, told = json.loads(facts["axes"]), json.loads(rig)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: its beginning is damaged: {error}") from error
    if not (isinstance(axes, list) and axes and all(isinstance(axis, str) for axis in axes)):
        raise RecordingError(f"{path}: its beginning is damaged: axes are {plain(facts['axes'], 40)}")
    return Beginning(tuple(axes), facts, told if isinstance(told, dict) else {})


def records_of(path: Path) -> Iterator[McapRecord | Damage]:
    """The records, chunks as they are, and what is damaged between them.

    Raises:
        RecordingError: It is a pipe, a folder or a device, or no MCAP file.
        OSError: It cannot be read.
    """
    if why := irregular(path):
        raise RecordingError(f"{path}: {why}")
    with path.open("rb") as file:
        try:
            yield from records(file, path.stat().st_size)
        except DamagedError as error:
            raise RecordingError(f"{path}: is no recording of seod: {error}") from error


def message_json(data: bytes) -> dict[str, Any]:
    """A JSON message with its time `t`; empty if it is none."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    is_one = isinstance(content, dict) and isinstance(content.get("t"), float | int)
    return content if is_one else {}


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

    In the place of what is damaged there is a warning `rows_lost`.

    Raises:
        RecordingError, OSError: As `beginning`.
    """
    for part in parts(path):
        join = _Join(axes)
        for record in records_of(part):
            if isinstance(record, Chunk):
                yield from join.chunk(record)
            elif isinstance(record, Damage) and not record.is_end:
                yield join.lost()
            elif isinstance(record, DataEnd):
                break


class _Join:
    """Makes rows of all axes out of the messages of each."""

    def __init__(self, axes: Sequence[str]) -> None:
        self._topics: dict[int, str] = {}
        self._t = 0.0
        self._messages: dict[str, list[bytes]] = {layout.ROWS + axis: [] for axis in axes}

    def chunk(self, chunk: Chunk) -> Iterator[Item]:
        """What is in it."""
        try:
            with library():
                yield from list(self._content(unpacked(chunk)))
        except DamagedError:
            for messages in self._messages.values():
                messages.clear()
            yield self.lost()

    def lost(self) -> Item:
        """The warning that a part is missing."""
        why = "a part of the recording is damaged and left out"
        return {"event": "warning", "t": self._t, "axis": None, "code": "rows_lost", "why": why}

    def _content(self, content: Sequence[McapRecord]) -> Iterator[Item]:
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
            event = message_json(data)
            yield event if isinstance(event.get("event"), str) else self.lost()

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
