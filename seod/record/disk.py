"""File on a disk that may be full, slow or gone: what it does not take at once waits in memory, in order."""

from __future__ import annotations

import errno
import os
import sys
from typing import TYPE_CHECKING

from seod.files.user_files import create_recording, keep_earlier

if TYPE_CHECKING:
    from pathlib import Path

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EAGAIN, errno.EINTR})
"""Errors after which the same bytes may be taken later; after any other the file is given up."""


class DiskFile:
    """Takes a stream of bytes (`write`, `tell`, `flush` as `mcap` wants them); `sync` brings it to the disk.

    A file that has content already is kept as `NAME~`.

    Raises:
        OSError: It cannot be made.
    """

    def __init__(self, path: Path) -> None:
        keep_earlier(path)
        self.path = path
        self._taken = 0
        self._waiting = bytearray()
        self._fd = create_recording(path)
        try:
            sync_directory(path.parent)
        except OSError:
            os.close(self._fd)
            raise

    def write(self, data: bytes) -> int:
        """Take bytes into memory."""
        self._waiting += data
        self._taken += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes taken so far."""
        return self._taken

    def flush(self) -> None:
        """Nothing: `sync` decides when the disk is bothered."""

    def sync(self) -> None:
        """Write what waits and wait until the disk has it.

        Raises:
            OSError: It has not; what it did not take goes on waiting. `FileNotFoundError`: it was deleted.
        """
        if os.fstat(self._fd).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the file was deleted")
        while self._waiting:
            written = os.write(self._fd, self._waiting)
            del self._waiting[:written]
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Close; a disk that is gone may refuse even that, and then there is nothing left to close.

        Raises:
            OSError: Refused.
        """
        os.close(self._fd)


def sync_directory(path: Path) -> None:
    """Bring a folder's list of names to the disk: a file whose name is lost is lost."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def missing(path: Path, rows: int, error: str) -> int:
    """Say on stderr, at the end of a recording, that rows are not in it, and why; returns their number.

    "Up to": what the disk took of the last write, before it failed, is in the file but was never confirmed.
    """
    if rows:
        why = f": {error}" if error else ""
        print(f"seod: recording {path}: up to {rows} rows are not in it{why}", file=sys.stderr)  # noqa: T201
    return rows
