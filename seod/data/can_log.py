"""CAN logs (BLF, ASC, candump, TRC, MF4) with their DBC: a group for each message, at its frames' times."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import BLOCK_ROWS, Block, Column, Group, ReadError, Remark, needs_extra
from seod.files.damage import DamagedError, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from can import Message
    from cantools.database.can import Message as Layout

SUFFIXES = (".blf", ".asc", ".log", ".trc")
_BLF_HEAD_BYTES = 144
TIME = "timestamp"
"""Name of the column of the frames' times [s]."""


class CanSource:
    """A log of frames; columns are the DBC's signals.

    Args:
        path: The log.
        dbc: Path of its DBC.

    Raises:
        ReadError: Log or DBC cannot be read.
    """

    def __init__(self, path: Path, dbc: Path) -> None:
        from drivers.can_dbc import CodecError, load_database  # noqa: PLC0415 - cantools

        self.path = path
        self.format = "can log"
        self.remarks: list[Remark] = []
        try:
            messages = load_database(str(dbc)).messages
        except CodecError as error:
            raise ReadError(str(error)) from error
        self._layouts = {(m.frame_id, m.is_extended_frame): m for m in messages}
        self._groups = {m.name: _group(m) for m in messages if m.signals}
        self.groups: tuple[Group, ...] = tuple(self._groups.values())
        self.notes: Mapping[str, str] = {"dbc": str(dbc)}
        self._size = max(1, path.stat().st_size)
        if path.suffix.lower() == ".blf" and self._size < _BLF_HEAD_BYTES:
            raise DamagedError("its header is missing")

    def close(self) -> None:
        """Nothing stays open."""

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; frames that cannot be decoded are counted among the remarks."""
        waiting: dict[str, _Waiting] = {name: _Waiting() for name in wanted}
        unread: Counter[str] = Counter()
        for frame, done in self._frames():
            name, content = self._decode(frame, unread)
            if name not in waiting:
                continue
            waiting[name].add(frame.timestamp, content)
            if len(waiting[name].times) == BLOCK_ROWS:
                yield waiting[name].block(self._groups[name], wanted[name], done)
        for name, each in waiting.items():
            if each.times:
                yield each.block(self._groups[name], wanted[name], 1.0)
        self.remarks += [Remark("unread", f"{what}: {count} frames", count) for what, count in unread.items()]

    def _frames(self) -> Iterator[tuple[Message, float]]:
        """Each frame with the part of the file that was read."""
        import can  # noqa: PLC0415

        frames = 0
        try:
            with library(NotImplementedError), can.LogReader(self.path) as log:
                file = getattr(log, "file", None)
                for frame in log:
                    done = _position(file) / self._size if frames % BLOCK_ROWS == 0 else 0.0
                    frames += 1
                    yield frame, min(1.0, done)
                if getattr(log, "file_size", 0) > self._size:  # python-can does not say so of a BLF
                    self.remarks.append(Remark("truncated", f"the end after {frames} frames is missing"))
        except NotImplementedError as error:
            raise needs_extra(self.path, "asammdf", "mdf") from error
        except DamagedError as error:
            if not frames:
                raise ReadError(f"{self.path}: is no CAN log of this kind: {error}") from error
            self.remarks.append(Remark("damaged", f"the end after {frames} frames cannot be read: {error}"))

    def _decode(self, frame: Message, unread: Counter[str]) -> tuple[str, Mapping[str, Any]]:
        """Message and signals; "" for a frame that has none."""
        if frame.is_error_frame or frame.is_remote_frame:
            unread["error or remote frames"] += 1
            return "", {}
        layout = self._layouts.get((frame.arbitration_id, frame.is_extended_id))
        if layout is None:
            unread[f"the DBC has no message of id {frame.arbitration_id:#x}"] += 1
            return "", {}
        if len(frame.data) < layout.length:
            unread[f"{layout.name}: shorter than {layout.length} bytes"] += 1
            return "", {}
        try:
            with library():
                content: Any = layout.decode_simple(bytes(frame.data[: layout.length]), decode_choices=False)
        except DamagedError as error:
            unread[f"{layout.name}: {error}"] += 1
            return "", {}
        return layout.name, content


class _Waiting:
    """Rows of one message that are not yet a block."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self._contents: list[Mapping[str, Any]] = []
        self._before = 0

    def add(self, t: float, content: Mapping[str, Any]) -> None:
        """One frame."""
        self.times.append(t)
        self._contents.append(content)

    def block(self, group: Group, names: Sequence[str], done: float) -> Block:
        """All of them, and begin anew."""
        contents = self._contents
        values = {
            name: np.array([content.get(name) for content in contents], np.float64)  # None becomes nan
            for name in names
            if name != TIME
        }
        values[TIME] = np.array(self.times)
        rows = np.arange(self._before + 1, self._before + 1 + len(self.times))
        self._before += len(self.times)
        self.times, self._contents = [], []
        return Block(group, values, rows, done)


def _group(message: Layout) -> Group:
    signals = (Column(signal.name, signal.unit or "") for signal in message.signals)
    return Group(message.name, (Column(TIME, "s"), *signals), TIME)


def _position(file: Any) -> int:
    """How far a log has been read [bytes]; 0 where its reader does not say."""
    try:
        return int(file.tell()) if file is not None else 0
    except (OSError, ValueError):  # a text file that is being iterated does not tell
        return 0
