"""The files of one recording, one after the other, on a disk that may be full or go away.

No thread and no clock: the recorder's thread calls, tests step it by hand.
"""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from seod.record.disk import FULL, DiskFile
from seod.record.layout import COUNTERS
from seod.record.mcap_file import McapFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from seod.record.mcap_file import About

RETRY_S = 1.0
"""How often a disk that failed is tried again [s]."""
COUNTERS_S = 1.0
"""How often the counters are written [s]; at once when something was lost."""


@dataclass(frozen=True, slots=True)
class Rotation:
    """When the next file begins: at so many bytes, or after so many seconds; None for never."""

    size: float | None = None
    time: float | None = None


class Note(NamedTuple):
    """A JSON message: its channel, its time [s], its content."""

    topic: str
    t: float
    message: Mapping[str, Any]


@dataclass(slots=True)
class Amount:
    """So many rows and notes."""

    rows: int = 0
    notes: int = 0

    def add(self, other: Amount) -> None:
        """Add."""
        self.rows += other.rows
        self.notes += other.notes


class Series:
    """Writes items in their order and knows what became of them.

    Attributes:
        failure: Why nothing can be written at present; "" while it can.
        written: What is on the disk.
        lost: What was handed over and will never be there.
        path: The present file.

    Args:
        path: Of the first file; the next ones are `NAME.0002.mcap` and so on.
        about: What the recording says of itself.
        rotation: When the next file begins.
        counters: Tells the content of the next `/counters` message.
        now: Time [s].

    Raises:
        OSError: Not even the beginning of the first file can be written.
    """

    def __init__(
        self,
        path: Path,
        about: About,
        rotation: Rotation,
        counters: Callable[[], Mapping[str, Any]],
        now: float,
    ) -> None:
        self.failure = ""
        self.written, self.lost = Amount(), Amount()
        self.path = self._first = path
        self._about = about
        self._rotation = rotation
        self._counters = counters
        self._in_flight = Amount()
        self._parts = self._number = 0  # files on the disk; number of the present one
        self._tried = self._began = self._counted = now
        self._told_lost = -1
        self._finished = False
        self._t = 0.0
        self._disk: DiskFile | None = None
        self._begin(now)
        self._write_through()

    @property
    def bytes(self) -> int:
        """Length of the present file, with what it has not taken yet."""
        return 0 if self._disk is None else self._disk.tell()

    def _begin(self, now: float) -> None:
        part = self._parts + 1
        if part > 1:
            self.path = self._first.with_suffix(f".{part:04}{self._first.suffix}")
        self._disk = disk = DiskFile(self.path)
        self._file = McapFile(disk, self._about, part)
        self._began, self._number, self._finished = now, part, False

    def ready(self, now: float) -> bool:
        """Whether `put` may be called: first of all what was put before is on the disk, or given up."""
        if self.failure and now < self._tried + RETRY_S:
            return False
        return self._settle(now)

    def put(self, items: Sequence[NDArray[np.void] | Note], now: float) -> None:
        """Write items as one chunk, and the counters when it is time; see `failure`."""
        try:
            self._make_chunk(items, now)
        except MemoryError:
            self._give_up(items, now)
            return
        if self._settle(now) and self._is_due(now):
            self._file.finish()
            self._finished = True
            self._settle(now)

    def _make_chunk(self, items: Sequence[NDArray[np.void] | Note], now: float) -> None:
        for item in joined(items):
            if isinstance(item, Note):
                self._put_note(item)
            else:
                self._file.rows(item)
                self._in_flight.rows += len(item)
                self._t = float(item["tick_t"][-1])
        self._note_counters(now)
        self._file.end_chunk()

    def _give_up(self, items: Sequence[NDArray[np.void] | Note], now: float) -> None:
        """Others have the memory that a chunk needs: it is lost, and the file ends with the chunk before."""
        notes = sum(isinstance(item, Note) for item in items)
        self._in_flight = Amount(sum(len(item) for item in items if not isinstance(item, Note)), notes)
        self._fail(OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), now)

    def _put_note(self, note: Note) -> None:
        self._t = max(self._t, note.t)
        try:
            self._file.note(*note)
        except ValueError:  # infinite numbers, which JSON does not have
            self.lost.notes += 1
        else:
            self._in_flight.notes += 1

    def _note_counters(self, now: float) -> None:
        counters = self._counters()
        lost = sum(value for key, value in counters.items() if key.endswith("lost"))
        if self._t and (lost != self._told_lost or now >= self._counted + COUNTERS_S):
            self._told_lost, self._counted = lost, now
            self._file.note(COUNTERS, self._t, {"t": self._t, **counters})

    def _is_due(self, now: float) -> bool:
        size, time = self._rotation.size, self._rotation.time
        return (size is not None and self.bytes >= size) or (time is not None and now - self._began >= time)

    def _settle(self, now: float) -> bool:
        try:
            if self._disk is not None:
                self._write_through()
            if self._disk is None or self._finished:
                self._close()
                self._begin(now)
                self._write_through()
        except OSError as error:
            self._fail(error, now)
            return False
        self.failure = ""
        return True

    def _write_through(self) -> None:
        if self._disk is not None:
            self._disk.sync()
            self._parts = self._number
            self.written.add(self._in_flight)
            self._in_flight = Amount()

    def _fail(self, error: OSError, now: float) -> None:
        self.failure = f"{self.path} cannot be written: {error.strerror or error}"
        self._tried = now
        if error.errno not in FULL:
            self._close()

    def _close(self) -> None:
        """Let go of the file; what it has not taken is lost."""
        disk, self._disk = self._disk, None
        self.lost.add(self._in_flight)
        self._in_flight = Amount()
        if disk is not None:
            with suppress(OSError):  # a disk that is gone; that it is was told when it was written to
                disk.close()

    def finish(self, now: float) -> None:
        """End the last file: counters, index, end mark."""
        if self._disk is None:
            return
        self._counted = -np.inf
        self._note_counters(now)
        if not self._finished:
            self._file.finish()
        try:
            self._write_through()
        except OSError as error:
            self._fail(error, now)
        self._close()


def joined(items: Sequence[NDArray[np.void] | Note]) -> Iterator[NDArray[np.void] | Note]:
    """The items, with rows that follow each other in one array."""
    rows: list[NDArray[np.void]] = []
    for item in items:
        if not isinstance(item, Note):
            rows.append(item)
            continue
        if rows:
            yield np.concatenate(rows)
            rows = []
        yield item
    if rows:
        yield np.concatenate(rows)
