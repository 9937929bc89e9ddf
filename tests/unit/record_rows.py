"""Rows and recordings for the tests of recorder and replay."""

from __future__ import annotations

import dataclasses
import io
import json
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.stream_reader import StreamReader

from seod.processes.ring import FLAG_FRESH, AxisState
from seod.record.layout import decode, row_dtype
from seod.record.mcap_file import About
from seod.record.series import Note, Rotation, Series

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

OFFSET_NS = 1_700_000_000_123_456_789


def about(axes: tuple[str, ...] = ("motor",)) -> About:
    return About("bench", axes, "rig: bench\n", '{"rig": "bench"}', 1_700_000_000.5, OFFSET_NS)


def rows(count: int, axes: int = 1, first: int = 0) -> np.ndarray:
    """Numbers that need all their digits."""
    table = np.zeros(count, row_dtype(axes))
    random = np.random.default_rng(first)
    table["tick"] = np.arange(first, first + count)
    table["tick_t"] = 100.0 + table["tick"] * 5e-4
    for name in table["axes"].dtype.names[:-2]:
        table["axes"][name] = random.normal(size=(count, axes))
    table["axes"]["t"] = table["tick_t"][:, None] - 1e-4 / 3.0
    table["axes"]["t_u"] = table["tick_t"][:, None] + 1e-4 / 7.0
    table["axes"]["ps"] = 1.0
    table["axes"]["temperature"] = np.nan
    table["axes"]["state"] = AxisState.EXCITING
    table["axes"]["flags"] = FLAG_FRESH
    return table


RIG = {
    "sensors": {"s": {"channel": "angle"}, "p": {"channel": "pressure"}},
    "outputs": {"v": {"channel": "valve"}},
    "axes": {"motor": {"sensor": "s", "output": "v", "supply_pressure": "p"}},
}


def write_recording(path: Path, table: np.ndarray, events: Sequence[Note] = (), rig: Any = RIG) -> None:
    """A recording of one axis: the events, then the rows."""
    told = dataclasses.replace(about(), rig_json=json.dumps(rig))
    series = Series(path, told, Rotation(), dict, 0.0)
    series.put([*events, table], 0.0)
    series.finish(0.0)


class Content:
    """All records of an MCAP file by the library's own reader, as far as they are whole."""

    def __init__(self, path: Path) -> None:
        self.attachments: dict[str, str] = {}
        self.metadata: dict[str, str] = {}
        self.channels: dict[int, Any] = {}
        self.schemas: dict[int, Any] = {}
        self.messages: list[tuple[str, Any]] = []
        self.ended = False
        for record in StreamReader(io.BytesIO(path.read_bytes()), validate_crcs=True).records:
            self._take(record)

    def _take(self, record: Any) -> None:
        kind = type(record).__name__
        if kind == "Attachment":
            self.attachments[record.name] = record.data.decode()
        elif kind == "Metadata":
            self.metadata = record.metadata
        elif kind == "Channel":
            self.channels[record.id] = record
        elif kind == "Schema":
            self.schemas[record.id] = record
        elif kind == "Message":
            self.messages.append((self.channels[record.channel_id].topic, record))
        elif kind == "Footer":
            self.ended = True

    def rows(self, axis: str = "motor") -> np.ndarray:
        return decode([m.data for topic, m in self.messages if topic == f"/rows/{axis}"])

    def json(self, topic: str) -> list[dict[str, Any]]:
        return [json.loads(m.data) for t, m in self.messages if t == topic]


def until(condition: Callable[[], bool], patience_s: float = 20.0) -> None:
    """Wait until it is true: threads of a recorder are at work."""
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)
