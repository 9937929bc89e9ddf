"""What a listener keeps: a file of JSON lines for each day (UTC), nothing twice, whatever kills the listener.

A line has the columns of the recordings' catalogue where they apply, so that both are asked alike once
`seod archive` has taken them in (`seod.archive.live`). Lines are written and synced before the broker is
told that they are here: what a kill tears off comes again. One listener at a time has the files.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from seod.fleet.store import append_whole, replace_file
from seod.fleet.topics import Key, key_of, kind_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from seod.fleet.board import Heard

FOLDER: Final = "fleet"
"""In the archive's folder."""
CURSOR: Final = "cursor.json"
LOCK: Final = "listener.lock"
ENDING: Final = ".jsonl"
SAVE_LINES: Final = 5000
"""After so many lines it is written down how far each rig came: at most these are read after a kill."""


class DayFiles:
    """The files in the folder of an archive.

    Args:
        archive: Its folder; made if it is not there.

    Raises:
        OSError: It cannot be used, or another listener has it.
    """

    def __init__(self, archive: Path) -> None:
        self._folder = archive / FOLDER
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(self._folder / LOCK)
        self.last: dict[str, Key] = {}
        """Key of the newest line of each rig."""
        self.torn = 0
        """Lines that a kill had left incomplete; they come again."""
        self._lines = 0
        self._sizes: dict[str, int] = {}
        self._recover()

    def add(self, heard: Iterable[Heard]) -> None:
        """Append messages; they are on the disk when this returns.

        Raises:
            OSError: The disk does not take them; then nothing of this call counts as taken.
        """
        texts: dict[str, list[bytes]] = {}
        keys = {}
        for each in heard:
            row = row_of(each)
            texts.setdefault(row["day"], []).append(json.dumps(row, separators=(",", ":")).encode() + b"\n")
            keys[each.rig.name] = each.key
        for day, lines in texts.items():
            self._append(f"{day}{ENDING}", b"".join(lines))
        self.last |= keys
        self._lines += sum(map(len, texts.values()))
        if self._lines >= SAVE_LINES:
            self.save()

    def close(self) -> None:
        """Write down how far each rig came, and let another listener have the files.

        Raises:
            OSError: It cannot be written.
        """
        try:
            self.save()
        finally:
            os.close(self._lock)

    def _append(self, name: str, data: bytes) -> None:
        path = self._folder / name
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)
        try:
            size = os.fstat(fd).st_size
            append_whole(fd, data, size)
            os.fsync(fd)
        finally:
            os.close(fd)
        self._sizes[name] = size + len(data)

    def save(self) -> None:
        """Write down how far each rig came.

        Raises:
            OSError: It cannot be written.
        """
        self._lines = 0
        told = {"rigs": self.last, "files": self._sizes}
        replace_file(self._folder / CURSOR, json.dumps(told).encode())

    def _recover(self) -> None:
        """How far each rig came: as written down, and by the lines since."""
        self._read_cursor()
        for path in sorted(self._folder.glob(f"*{ENDING}")):
            begin = self._sizes.get(path.name, 0)
            with path.open("rb+") as file:
                file.seek(begin)
                data = file.read()
                whole = data.rfind(b"\n") + 1
                if whole < len(data):
                    self.torn += 1
                    file.truncate(begin + whole)
            self._sizes[path.name] = begin + whole
            for line in data[:whole].splitlines():
                self._note(line)

    def _read_cursor(self) -> None:
        try:
            told = json.loads((self._folder / CURSOR).read_bytes())
            self.last = {str(rig): key for rig, value in told["rigs"].items() if (key := key_of(value))}
            files = {str(name): int(size) for name, size in told["files"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return  # none yet: all lines are read
        self._sizes = {name: size for name, size in files.items() if self._has(name, size)}

    def _has(self, name: str, size: int) -> bool:
        path = self._folder / name
        return path.exists() and path.stat().st_size >= size

    def _note(self, line: bytes) -> None:
        try:
            row = json.loads(line)
            rig, key = str(row["rig"]), key_of([row["session"], row["seq"]])
        except (ValueError, KeyError, TypeError):
            return
        if key is not None:
            self.last[rig] = max(key, self.last.get(rig, key))


def _locked(path: Path) -> int:
    """A descriptor that holds the lock until it is closed, or its process ends.

    Raises:
        OSError: Another process holds it.
    """
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(fd)
        why = "another `seod fleet` appends to this archive"
        raise BlockingIOError(errno.EWOULDBLOCK, why, str(path.parent)) from error
    return fd


def row_of(heard: Heard) -> dict[str, Any]:
    """A line: columns as in the catalogue where they apply, and what else the message says in `message`."""
    body = dict(heard.body)
    at = body.get("at")
    at = float(at) if isinstance(at, int | float) else 0.0
    stamp = datetime.fromtimestamp(at, UTC)
    for key in ("rig", "session", "seq", "prev", "oldest", "archive"):
        body.pop(key, None)
    row: dict[str, Any] = {"kind": kind_of(heard.suffix), "rig": heard.rig.name, **heard.key._asdict()}
    row |= {"axis": body.pop("axis", None), "day": stamp.date().isoformat(), "end": stamp.isoformat()}
    row |= {"version": heard.rig.birth.get("version"), "simulated": heard.rig.birth.get("simulated")}
    if row["kind"] == "estimate":
        row |= _measured(body, heard)
    return row | {"message": body}


def _measured(body: dict[str, Any], heard: Heard) -> dict[str, Any]:
    names = (
        *("reference", "temperature", "e_a", "zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd"),
        *("quality", "model_error", "left_model"),
    )
    axis = heard.suffix.partition("/")[2]
    about = heard.rig.birth.get("axes", {}).get(axis, {})
    state = heard.rig.state.get("axes", {}).get(axis, {})
    row = {name: body.pop(name, None) for name in names}
    row |= {"supply_pressure": body.pop("ps", None), "unit": about.get("unit")}
    return row | {"left_since": _iso(state.get("left_since"))}


def _iso(at: object) -> str | None:
    return datetime.fromtimestamp(at, UTC).isoformat() if isinstance(at, int | float) else None
