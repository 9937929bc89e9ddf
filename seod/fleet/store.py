"""What waits for the broker, on disk: files to which records are appended, each with a check sum.

A record is a line `CRC SESSION SEQ SUFFIX BODY`. What a kill tears off at a file's end is cut away and told.
The files together stay below a limit: the oldest estimates are thinned out first, events last.
"""

from __future__ import annotations

import errno
import json
import os
import zlib
from collections import Counter, deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.fleet.topics import KINDS, NOTHING, Key, key_of, kind_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

PARTS: Final = 32
"""Files that the limit is divided into: what is given up at once is about a 32nd."""
LEAST_BYTES, MOST_BYTES = 4096, 1 << 20
"""Of such a file: a page of the disk, and what is rewritten within some 10 ms."""
CHUNK_BYTES: Final = 64 * 1024
CURSOR: Final = "released.json"
ENDING: Final = ".records"


class Record(NamedTuple):
    """One message that waits."""

    key: Key
    suffix: str
    body: bytes


@dataclass(slots=True, eq=False)
class Segment:
    """One file.

    Attributes:
        path: Where it is.
        size: In bytes.
        first: Key of its oldest record.
        last: Of its newest.
        counts: Records of each kind.
        thinned: How often its estimates were thinned out.
    """

    path: Path
    size: int = 0
    first: Key = NOTHING
    last: Key = NOTHING
    counts: Counter[str] = field(default_factory=Counter)
    thinned: int = 0

    def note(self, record: Record, size: int) -> None:
        """Count a record that it has got."""
        self.first = self.first if self.size else record.key
        self.last = record.key
        self.size += size
        self.counts[kind_of(record.suffix)] += 1


class Store:
    """All that waits of one rig.

    Args:
        folder: Made if it is not there.
        limit_bytes: Most that its files take.
        now: UTC [s]; a session's number is at least that, so that it grows even where the folder was lost.

    Raises:
        OSError: The folder cannot be used.
    """

    def __init__(self, folder: Path, limit_bytes: float, now: float) -> None:
        self._folder, self._limit = folder, limit_bytes
        self._part_bytes = min(MOST_BYTES, max(LEAST_BYTES, limit_bytes / PARTS))
        self._segments: deque[Segment] = deque()
        self._open: tuple[Segment, int] | None = None
        self._files = 0
        self.released = NOTHING
        """Up to here nothing is needed any more."""
        self.thinned: Counter[str] = Counter()
        """Records that were given up, by kind."""
        self.torn = 0
        """Records that a kill has left incomplete."""
        self.damaged = 0
        """Records that are not what was written."""
        self.unwritten = 0
        """Records that the disk did not take."""
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        last = self._recover()
        self.session = max(last.session + 1, int(now))
        self._seq = 0

    # ---- what there is

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(each.size for each in self._segments)

    @property
    def records(self) -> int:
        """Records of all files."""
        return sum(sum(each.counts.values()) for each in self._segments)

    @property
    def newest(self) -> Key:
        """Key of the newest record that was ever appended in this session."""
        return Key(self.session, self._seq)

    def report(self) -> dict[str, object]:
        """For `health` and `birth`: what waits, and what was lost."""
        lost = {"torn": self.torn, "damaged": self.damaged, "unwritten": self.unwritten}
        return {"records": self.records, "bytes": self.size, "thinned": dict(self.thinned), **lost}

    # ---- appending

    def append(self, suffix: str, body: bytes) -> Key:
        """Keep a message; it survives the end of this process, however that comes.

        What the disk does not take is counted and left out.

        Args:
            suffix: Of its topic, without spaces.
            body: JSON without ends of lines.
        """
        self._seq += 1
        record = Record(self.newest, suffix, body)
        line = _line(record)
        try:
            segment, fd = self._writable()
            append_whole(fd, line, segment.size)
        except OSError:
            self.unwritten += 1
            return record.key
        segment.note(record, len(line))
        if segment.size >= self._part_bytes:
            self.close()
        if self.size > self._limit:
            self._make_room()
        return record.key

    def _writable(self) -> tuple[Segment, int]:
        if self._open is None:
            self._files += 1
            segment = Segment(self._folder / f"{self._files:010d}{ENDING}")
            fd = os.open(segment.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o600)
            self._segments.append(segment)
            self._open = segment, fd
        return self._open

    def sync(self) -> None:
        """Have the disk keep what was appended, even if the power goes."""
        if self._open is not None:
            with suppress(OSError):
                os.fsync(self._open[1])

    def close(self) -> None:
        """End the file that is appended to; the next record begins another one."""
        if self._open is not None:
            self.sync()
            os.close(self._open[1])
            self._open = None

    # ---- reading and forgetting

    def read(self, after: Key, count: int) -> list[Record]:
        """The next records behind a key, in order."""
        return self.reader(after).take(count)

    def reader(self, after: Key) -> Reader:
        """Reads from behind a key on."""
        return Reader(self._segments, after)

    def release(self, key: Key) -> None:
        """Nothing up to this key is needed any more."""
        if key <= self.released:
            return
        self.released = key
        while self._segments and self._segments[0].last <= key:
            segment = self._segments[0]
            if self._open is not None and self._open[0] is segment:
                if segment.size < self._part_bytes / 4:
                    break
                self.close()
            self._segments.popleft()
            segment.path.unlink(missing_ok=True)

    def save(self) -> None:
        """Write down up to where all is released, and what was given up."""
        told = {"released": self.released, "session": self.session, "thinned": dict(self.thinned)}
        with suppress(OSError):
            replace_file(self._folder / CURSOR, json.dumps(told).encode())

    # ---- giving up

    def _make_room(self) -> None:
        while self.size > self._limit and (found := self._least_needed()) is not None:
            segment, kind = found
            if kind == "estimate":
                segment.thinned += 1
                self._rewrite(segment, _every_second())
            else:
                self._rewrite(segment, lambda record, kind=kind: kind_of(record.suffix) != kind)  # type: ignore[misc] # bound now
        self.save()

    def _least_needed(self) -> tuple[Segment, str] | None:
        """Which file gives up which kind: estimates that were thinned least, oldest first; events last."""
        whole = [each for each in self._segments if self._open is None or each is not self._open[0]]
        for kind in reversed(KINDS):
            having = [each for each in whole if each.counts[kind]]
            if having and kind == "estimate":
                return min(having, key=lambda each: each.thinned), kind
            if having:
                return having[0], kind
        return None

    def _rewrite(self, segment: Segment, keep: Callable[[Record], bool]) -> None:
        kept = Segment(segment.path, thinned=segment.thinned)
        lines = []
        for record in _records(segment.path.read_bytes()):
            if record is None:
                self.damaged += 1
            elif keep(record):
                lines.append(_line(record))
                kept.note(record, len(lines[-1]))
            else:
                self.thinned[kind_of(record.suffix)] += 1
        if not lines:
            self._segments.remove(segment)
            segment.path.unlink(missing_ok=True)
            return
        replace_file(segment.path, b"".join(lines))
        self._segments[self._segments.index(segment)] = kept

    # ---- after a start

    def _recover(self) -> Key:
        last = self._read_cursor()
        for path in self._folder.glob(".new-*"):
            path.unlink(missing_ok=True)
        for path in sorted(self._folder.glob(f"*{ENDING}")):
            segment = self._recovered(path)
            if segment is not None:
                last = max(last, segment.last)
                self._segments.append(segment)
            self._files = max(self._files, int(path.stem) if path.stem.isdigit() else 0)
        return last

    def _read_cursor(self) -> Key:
        try:
            told = json.loads((self._folder / CURSOR).read_bytes())
            self.released = key_of(told["released"]) or NOTHING
            self.thinned.update({str(kind): int(count) for kind, count in told["thinned"].items()})
            return Key(int(told["session"]), 0)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return NOTHING  # none yet; then what is there is sent again, and nobody takes it twice

    def _recovered(self, path: Path) -> Segment | None:
        data = path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            self.torn += 1
        segment, good = Segment(path), []
        for record in _records(whole):
            if record is None:
                self.damaged += 1
            else:
                good.append(_line(record))
                segment.note(record, len(good[-1]))
        if not good:
            path.unlink()
            return None
        if segment.size < len(data):
            replace_file(path, b"".join(good))
        return segment


class Reader:
    """Reads records in order, while others are appended, thinned out and released.

    Args:
        segments: The store's.
        after: The first one to come is the next behind this.
    """

    def __init__(self, segments: deque[Segment], after: Key) -> None:
        self._segments = segments
        self.key = after
        """Of the last one that was handed out."""
        self._segment: Segment | None = None
        self._offset = 0

    def take(self, count: int) -> list[Record]:
        """The next records, at most so many; none if there are none at present."""
        found: list[Record] = []
        while len(found) < count and (segment := self._current()) is not None:
            before = len(found)
            self._take_from(segment, count, found)
            if len(found) == before and self._offset >= segment.size:
                self.key = max(self.key, segment.last)  # what is left of it cannot be read
        return found

    def _current(self) -> Segment | None:
        segment = next((each for each in self._segments if each.last > self.key), None)
        if segment is not self._segment:
            self._segment, self._offset = segment, 0
        return segment

    def _take_from(self, segment: Segment, count: int, found: list[Record]) -> None:
        with segment.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(min(CHUNK_BYTES, segment.size - self._offset))
        end = data.rfind(b"\n") + 1
        if not end:  # a line longer than a chunk
            with segment.path.open("rb") as file:
                file.seek(self._offset)
                data = file.readline()
            end = len(data)
        for line in data[:end].splitlines(keepends=True):
            if len(found) >= count:
                return
            self._offset += len(line)
            record = _parsed(line)
            if record is not None and record.key > self.key:
                self.key = record.key
                found.append(record)


def _line(record: Record) -> bytes:
    text = f"{record.key.session} {record.key.seq} {record.suffix} ".encode() + record.body
    return b"%08x " % zlib.crc32(text) + text + b"\n"


def _parsed(line: bytes) -> Record | None:
    check, _, text = line.rstrip(b"\n").partition(b" ")
    try:
        if int(check, 16) != zlib.crc32(text):
            return None
        session, seq, suffix, body = text.split(b" ", 3)
        return Record(Key(int(session), int(seq)), suffix.decode(), body)
    except ValueError:
        return None


def _records(data: bytes) -> Iterator[Record | None]:
    return map(_parsed, data.splitlines(keepends=True))


def _every_second() -> Callable[[Record], bool]:
    """Of the estimates of each axis the second, the fourth and so on."""
    seen: Counter[str] = Counter()

    def keep(record: Record) -> bool:
        if kind_of(record.suffix) != "estimate":
            return True
        seen[record.suffix] += 1
        return seen[record.suffix] % 2 == 0

    return keep


def append_whole(fd: int, data: bytes, size: int) -> None:
    """Append all to a file of this size, or leave it as it was.

    Raises:
        OSError: The disk takes no more.
    """
    try:
        written = os.write(fd, data)
    except OSError:
        os.ftruncate(fd, size)
        raise
    if written < len(data):
        os.ftruncate(fd, size)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def replace_file(path: Path, data: bytes) -> None:
    """Write a file anew, whole or not at all.

    Raises:
        OSError: It cannot be written.
    """
    written = path.with_name(f".new-{path.name}")
    with written.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    written.replace(path)
