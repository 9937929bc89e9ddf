"""One builder at a time: in a folder a lock of the system, which ends with its holder; elsewhere a note."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import ArchiveError
from seod.archive.layout import FOLDER

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from seod.archive.store import Store

    Renew = Callable[[], None]

NAME: Final = f"{FOLDER}/builder.lock"
STALE_S: Final = 300.0
"""A note in an object store that has not been renewed for so long is of a builder that is dead [s]."""
RENEW_S: Final = 30.0
"""How often a builder renews its note, at most [s]."""


@contextmanager
def held(store: Store) -> Iterator[Renew]:
    """Hold the archive while it is built; gives what is to be called now and then.

    Raises:
        ArchiveError: Another builder has it.
    """
    if store.is_local:
        with _file_lock(Path(store.path(NAME)), store.where):
            yield lambda: None
        return
    note = _Note(store)
    try:
        yield note.renew
    finally:
        store.remove([NAME])


def _busy(where: str, who: str) -> ArchiveError:
    return ArchiveError(f"{where}: {who} builds this catalogue: try again when it has ended")


@contextmanager
def _file_lock(path: Path, where: str) -> Iterator[None]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        try:
            _take(file)
        except OSError as error:
            raise _busy(where, "another process") from error
        yield


def _take(file: Any) -> None:
    if sys.platform == "win32":
        import msvcrt  # noqa: PLC0415

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl  # noqa: PLC0415

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


class _Note:
    """A note in an object store, which has no locks: two that begin in the same moment may both pass."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._who = f"process {os.getpid()} on {socket.gethostname()}"
        other = self._read()
        if other is not None and time.time() - other["time"] < STALE_S:
            since = f"{time.time() - other['time']:.0f} s ago"
            who = f"{other['who']} (heard of {since}; {STALE_S:.0f} s of silence free it)"
            raise _busy(store.where, who)
        self._renewed = -RENEW_S
        self.renew()

    def _read(self) -> Any:
        try:
            note = json.loads(self._store.read(NAME))
            return {"who": str(note["who"]), "time": float(note["time"])}
        except (FileNotFoundError, ValueError, KeyError, TypeError):
            return None

    def renew(self) -> None:
        """Say that this builder lives."""
        if time.monotonic() - self._renewed >= RENEW_S:
            self._renewed = time.monotonic()
            note = {"who": self._who, "time": time.time()}
            self._store.write(NAME, json.dumps(note).encode())
