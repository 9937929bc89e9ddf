"""The folder that keeps what is done: a file for each input, and which input each is of.

A result is there as a whole or not at all, so that whoever was killed goes on where the files are. The
journal, a line of JSON for each result, saves reading an input again to see that it is the same; without it,
or where its end is torn, contents are compared.
"""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from seod.batch.kinds import RECORDING
from seod.batch.task import content
from seod.files.user_files import named

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.batch.task import Made, Task

BASE = "base"
"""Key of the journal's first line: the folder from which names of inputs start."""


class Stamp(NamedTuple):
    """What tells that a file was written since: size [bytes] and time of its last change [ns]."""

    size: int
    mtime_ns: int

    @classmethod
    def of(cls, path: str) -> Stamp:
        """Of a file.

        Raises:
            OSError: There is none.
        """
        found = Path(path).stat()
        return cls(found.st_size, found.st_mtime_ns)


class Results:
    """Results of one kind: `OUT/KIND/NAME.json`, beside `OUT/KIND.csv`, their table, and `OUT/KIND.journal`.

    Args:
        out: The folder; made if it is not there.
        kind: Of the tasks.

    Raises:
        OSError: The folder cannot be made or written.
    """

    def __init__(self, out: Path, kind: str) -> None:
        self.folder, self.table = out / kind, out / f"{kind}.csv"
        self.folder.mkdir(parents=True, exist_ok=True)
        path = out / f"{kind}.journal"
        lines = _lines(path) if path.exists() else []
        self._known = {line["name"]: (line["key"], Stamp(*line["stamp"])) for line in lines if "name" in line}
        self.base = next((Path(line[BASE]) for line in lines if BASE in line), None)
        self._journal = path.open("ab")
        if self._journal.tell():
            self._journal.write(b"\n")  # ends a line that was cut short

    def close(self) -> None:
        """Let go of the journal."""
        self._journal.close()

    def based(self, base: Path) -> None:
        """Have names of inputs start from this folder, now and whenever this is opened again."""
        self.base = base
        self._note({BASE: str(base)})

    def path(self, name: str) -> Path:
        """Where the result of an input is, or would be."""
        return self.folder / f"{name}.json"

    def is_done(self, task: Task) -> bool:
        """Whether the same was asked of the same content and answered."""
        known = self._known.get(task.name)
        try:
            stamp = Stamp.of(task.path)
        except OSError:
            return False
        if known == (task.key, stamp) and self.path(task.name).exists():
            return True
        if known is not None and known[0] != task.key:
            return False
        told = self.read(task.name)
        if told is None or (told.get("key"), told.get("size")) != (task.key, stamp.size):
            return False
        if told["sha256"] != content(Path(task.path))[0]:
            return False
        self._note({"name": task.name, "key": task.key, "stamp": stamp})
        return True

    def read(self, name: str) -> dict[str, Any] | None:
        """The result of an input; None where there is none."""
        try:
            told: dict[str, Any] = json.loads(self.path(name).read_bytes())
        except (FileNotFoundError, ValueError):  # not there, or not ours
            return None
        return told

    def keep(self, task: Task, made: Made) -> None:
        """Write a result; once this returns it is done.

        Raises:
            OSError: It cannot be written.
        """
        path = self.path(task.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if made.recording:
            with whole(path.with_name(path.name.removesuffix(".json") + RECORDING)) as file:
                file.write(made.recording)
        with whole(path) as file:
            file.write(made.answer)
        self._note({"name": task.name, "key": task.key, "stamp": Stamp.of(task.path)})

    def _note(self, line: dict[str, Any]) -> None:
        self._journal.write(json.dumps(line).encode() + b"\n")
        self._journal.flush()


def _lines(path: Path) -> list[dict[str, Any]]:
    """Lines of a journal, without those that are torn."""
    found = []
    for line in path.read_bytes().splitlines():
        try:
            told = json.loads(line)
        except ValueError:
            continue
        if isinstance(told, dict):
            found.append(told)
    return found


@contextmanager
def whole(path: Path) -> Iterator[IO[bytes]]:
    """A file to write that is there under its name once it is whole and on the disk.

    Raises:
        OSError: It cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with named(path, part):
        try:
            with part.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
