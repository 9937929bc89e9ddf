"""Rows of the catalogue from one recording: what the daemon told is taken as it stands."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from typing import IO, TYPE_CHECKING, Any, Final

from mcap.records import Attachment, Channel, Chunk, DataEnd, Metadata

from seod.archive.segments import Note, Segments
from seod.files.damage import DamagedError, plain
from seod.record import layout
from seod.record.mcap_records import Damage, messages, records
from seod.record.read import RecordingError, begun, message_json

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mcap.records import McapRecord

    from seod.archive.segments import Segment
    from seod.archive.store import Known
    from seod.record.read import Beginning

_LONGEST: Final = 300
"""Characters of a row's `problem`."""
_KINDS: Final = {layout.ESTIMATES: "estimate", layout.MODEL_ERRORS: "model_error"}
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class Content:
    """What one MCAP file of this program holds, read once from its beginning to its end.

    Attributes:
        beginning: None where the file is no such recording.
        axes: Segments by axis.
        units: SI unit of what an axis measures, by axis.
        problems: Why not all could be read.
    """

    def __init__(self, name: str, file: IO[bytes], size: int) -> None:
        self._name = name
        self.beginning: Beginning | None = None
        self.axes: dict[str, Segments] = {}
        self.units: dict[str, str] = {}
        self.problems: list[str] = []
        self._topics: dict[int, str] = {}
        self._rig = "{}"
        try:
            for record in records(file, size):
                if isinstance(record, DataEnd):
                    break
                self._take(record)
        except (DamagedError, RecordingError) as error:
            self.problems.append(str(error).removeprefix(f"{name}: "))
        for segments in self.axes.values():
            segments.finish()

    @property
    def offset_s(self) -> float:
        """Wall clock minus the clock of the rows [s]."""
        told = "0" if self.beginning is None else self.beginning.facts.get("clock_offset_ns", "0")
        return int(told) * 1e-9 if told.lstrip("-").isdigit() else 0.0

    def _take(self, record: McapRecord | Damage) -> None:
        if isinstance(record, Damage):
            end = "; what was written after its last whole chunk is missing" if record.is_end else ""
            self.problems.append(f"{record.message}{end}")
        elif isinstance(record, Attachment) and record.name == layout.RIG:
            self._rig = record.data.decode(errors="replace")
        elif isinstance(record, Metadata) and record.name == layout.PROFILE:
            self.beginning = begun(self._name, record.metadata, self._rig)
            self.axes = {axis: Segments() for axis in self.beginning.axes}
        elif isinstance(record, Chunk):
            self._open(record)

    def _open(self, chunk: Chunk) -> None:
        rows: dict[str, list[bytes]] = {}
        try:
            for record in messages(chunk):
                if isinstance(record, Channel):
                    self._introduce(record)
                    continue
                topic, data = self._topics.get(record[0], ""), record[1]
                if topic.startswith(layout.ROWS):
                    rows.setdefault(topic.removeprefix(layout.ROWS), []).append(data)
                else:
                    self._note(topic, data)
        except DamagedError as error:
            self.problems.append(f"a chunk is damaged and left out: {error}")
        self._add(rows)

    def _introduce(self, channel: Channel) -> None:
        self._topics[channel.id] = channel.topic
        if channel.topic.startswith(layout.ROWS) and "y" in channel.metadata:
            self.units[channel.topic.removeprefix(layout.ROWS)] = channel.metadata["y"]

    def _add(self, rows: dict[str, list[bytes]]) -> None:
        for axis, data in rows.items():
            if axis in self.axes:
                try:
                    self.axes[axis].add(layout.decode(data))
                except ValueError as error:
                    self.problems.append(f"rows of {axis} are left out: {error}")

    def _note(self, topic: str, data: bytes) -> None:
        for start, kind in _KINDS.items():
            if topic.startswith(start) and (axis := topic.removeprefix(start)) in self.axes:
                content = message_json(data)
                if content:
                    self.axes[axis].note(Note(kind, float(content["t"]), content))
        if topic == layout.EVENTS:
            self._event(message_json(data))

    def _event(self, event: dict[str, Any]) -> None:
        """A fault goes to the axes that it latched; one of no axis to all."""
        if event.get("event") != "fault":
            return
        axis = event.get("axis")
        concerned = event.get("latched") or ([axis] if axis in self.axes else list(self.axes))
        for name in concerned:
            if name in self.axes:
                self.axes[name].note(Note("fault", float(event["t"]), event))


def rows_of(known: Known, file: IO[bytes]) -> list[dict[str, Any]]:
    """Rows by column (`seod.archive.layout`), at least one: a file that tells nothing says why.

    A row's `span` is no column: its first and last time [s] by the file's own clock.

    Args:
        known: The file's name, size and stamp.
        file: Its content.
    """
    content = Content(known.name, file, known.size)
    about = _of_file(known, content)
    rows = [
        {**about, **row}
        for axis, segments in content.axes.items()
        for row in _of_axis(axis, segments.all, content)
    ]
    if not rows:
        about["problem"] = about["problem"] or "holds no rows"
        return [about]
    first = min(row["begin"] for row in rows)
    return [{**row, "day": first.date()} for row in rows]


def _of_file(known: Known, content: Content) -> dict[str, Any]:
    """Columns that all rows of a file share."""
    beginning = content.beginning
    problems = list(dict.fromkeys(content.problems))
    if beginning is None and not problems:
        problems = ["is no recording of seod"]
    return {
        "file": known.name,
        "stamp": known.stamp,
        "gone": False,
        "rig": None if beginning is None else beginning.facts.get("rig"),
        "version": None if beginning is None else beginning.facts.get("version"),
        "simulated": None if beginning is None else beginning.rig.get("simulation") is not None,
        "day": None if beginning is None else _day(beginning.facts["started"]),
        "problem": plain("; ".join(problems), _LONGEST) if problems else None,
    }


def _day(started: str) -> Any:
    try:
        return datetime.fromisoformat(started).astimezone(UTC).date()
    except ValueError:
        return None


def _of_axis(axis: str, segments: Sequence[Segment], content: Content) -> Iterator[dict[str, Any]]:
    offset = content.offset_s
    for part, segment in enumerate(segments, 1):
        yield {
            **segment.as_row(),
            "axis": axis,
            "part": part,
            "span": (segment.first, segment.last),
            "unit": content.units.get(axis),
            "begin": wall_clock(segment.first + offset),
            "end": wall_clock(segment.last + offset),
            "left_since": None if segment.left is None else wall_clock(segment.left + offset),
            "faults": json.dumps([_fault(each, offset) for each in segment.faults]),
        }


def _fault(event: dict[str, Any], offset: float) -> dict[str, Any]:
    at = wall_clock(float(event["t"]) + offset)
    return {"t": at.isoformat(), "code": event.get("code"), "why": event.get("why")}


def wall_clock(seconds: float) -> datetime:
    """UTC of seconds since 1970; the ends of the calendar for what is outside of it."""
    try:
        return _EPOCH + timedelta(seconds=seconds)
    except (OverflowError, ValueError):
        return datetime(9999, 1, 1, tzinfo=UTC) if seconds > 0 else _EPOCH
