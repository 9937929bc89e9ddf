"""One MCAP file in the layout of `seod.record.layout`, as a stream of whole chunks."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
from mcap.writer import CompressionType, Writer

from seod import PROTOCOL, __version__
from seod.record import layout
from seod.record.layout import COUNTERS, ESTIMATES, EVENTS, HEALTH, MODEL_ERRORS, ROWS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from seod.record.disk import DiskFile

CHUNK_BYTES = 1 << 24
"""No chunk grows to this by itself: chunks end when the recorder says so."""
LIBRARY = f"seod {__version__}"


@dataclass(frozen=True, slots=True)
class About:
    """What a recording says of itself.

    Attributes:
        rig: Name of the rig.
        axes: Names of the axes, in their order in a row.
        rig_text: The rig file.
        rig_json: The rig file as it was read.
        started: Wall clock at the recorder's start [s since 1970].
        offset_ns: Wall clock minus the clock of the rows, then.
        units: SI units of what the axes measure, by name.
    """

    rig: str
    axes: Sequence[str]
    rig_text: str
    rig_json: str
    started: float
    offset_ns: int
    units: Mapping[str, str] = field(default_factory=dict)


class McapFile:
    """Messages into chunks, chunks into `stream`.

    Args:
        stream: Takes the bytes; never fails.
        about: The recording.
        part: Number of this file in it, from 1.
    """

    def __init__(self, stream: DiskFile, about: About, part: int) -> None:
        self._about = about
        # `mcap` asks for a whole IO object and uses write, tell and flush
        self._writer = Writer(cast("IO[bytes]", stream), CHUNK_BYTES, CompressionType.ZSTD)
        self._writer.start(layout.PROFILE, LIBRARY)
        self._introduce(part)
        self._rows = [self._row_channel(axis) for axis in about.axes]
        of_axes = [kind + axis for axis in about.axes for kind in (ESTIMATES, MODEL_ERRORS)]
        self._notes = {topic: self._json_channel(topic) for topic in (*of_axes, EVENTS, HEALTH, COUNTERS)}

    def _introduce(self, part: int) -> None:
        about = self._about
        now = round(about.started * 1e9)
        for name, kind, text in (
            (layout.RIG_FILE, "application/yaml", about.rig_text),
            (layout.RIG, "application/json", about.rig_json),
        ):
            self._writer.add_attachment(now, now, name, kind, text.encode())
        facts = {
            "version": __version__,
            "protocol": str(PROTOCOL),
            "rig": about.rig,
            "axes": json.dumps(list(about.axes)),
            "started": datetime.fromtimestamp(about.started, UTC).isoformat(),
            "clock": "CLOCK_MONOTONIC",
            "clock_offset_ns": str(about.offset_ns),
            "part": str(part),
        }
        self._writer.add_metadata(layout.PROFILE, facts)

    def _row_channel(self, axis: str) -> int:
        schema = self._writer.register_schema(layout.ROW_SCHEMA_NAME, "ros2msg", layout.ROW_SCHEMA.encode())
        unit = self._about.units.get(axis)
        told = {} if unit is None else dict.fromkeys(layout.MEASURED, unit)
        return self._writer.register_channel(ROWS + axis, "cdr", schema, told)

    def _json_channel(self, topic: str) -> int:
        schema = json.dumps({"type": "object", "title": topic, "properties": {"t": {"type": "number"}}})
        number = self._writer.register_schema("seod" + topic.replace("/", "."), "jsonschema", schema.encode())
        return self._writer.register_channel(topic, "json", number)

    def rows(self, rows: NDArray[np.void]) -> None:
        """Add rows (dtype `layout.row_dtype`)."""
        offset = self._about.offset_ns
        log_times = layout.nanoseconds(rows["tick_t"], offset)
        for number, channel in enumerate(self._rows):
            left = rows["axes"]["t_u"][:, number]
            left = np.where(np.isfinite(left), left, rows["tick_t"])
            publish_times = layout.nanoseconds(left, offset)
            data, size = layout.encode(rows, number).tobytes(), layout.ROW.itemsize
            for k, (log, publish) in enumerate(zip(log_times.tolist(), publish_times.tolist(), strict=True)):
                self._writer.add_message(channel, log, data[k * size : (k + 1) * size], publish)

    def note(self, topic: str, t: float, message: Mapping[str, Any]) -> None:
        """Add a JSON message of time `t` [s].

        Raises:
            ValueError: It is no JSON.
        """
        text = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        time_ns = round(t * 1e9) + self._about.offset_ns
        self._writer.add_message(self._notes[topic], time_ns, text, time_ns)

    def end_chunk(self) -> None:
        """Hand all so far to the stream, as a chunk that can be read for itself."""
        self._writer.flush()

    def finish(self) -> None:
        """Hand over the rest, the index and the end mark."""
        self._writer.finish()
