"""Files that a user names: only regular ones are read, recordings are not for everyone, errors name them."""

from __future__ import annotations

import os
import stat
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

RECORDING_ENDINGS = (".mcap", ".csv")
"""Of what `seod run --record` writes."""
BUS_LOG_ENDINGS = (".asc", ".blf", ".csv", ".log", ".mf4", ".trc")
"""Of what python-can writes."""
RECORDING_MODE = 0o640
"""Most that a recording may be: its owner writes, its group reads, others see nothing."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def irregular(path: Path) -> str:
    """Why a file is not to be opened: `is a pipe, not a file`; "" for regular files and for none at all.

    A pipe that nobody writes to would hold the reader for ever, and a device may have no end.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # opening it will say what is wrong
        return ""
    return next((f"is {kind}, not a file" for is_kind, kind in _KINDS if is_kind(mode)), "")


def create_recording(path: Path) -> int:
    """A descriptor of a new, empty file that only its owner may write and at most its group may read.

    One that is there already is emptied, and loses what others may do with it.

    Raises:
        OSError: It cannot be made.
    """
    binary = getattr(os, "O_BINARY", 0)  # Windows would change ends of lines
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | binary, RECORDING_MODE)
    restrict(path)
    return fd


def restrict(path: Path) -> None:
    """Take from a regular file what goes beyond `RECORDING_MODE`; one of somebody else's stays as it is."""
    with suppress(PermissionError):
        mode = path.stat().st_mode
        if stat.S_ISREG(mode):
            path.chmod(stat.S_IMODE(mode) & RECORDING_MODE)


def keep_earlier(path: Path) -> None:
    """Rename a recording that has content already to `NAME~`.

    Raises:
        OSError: It cannot be renamed.
    """
    if path.is_file() and path.stat().st_size:
        kept = path.with_name(path.name + "~")
        path.replace(kept)
        restrict(kept)


@contextmanager
def named(path: Path, part: Path | None = None) -> Iterator[None]:
    """Have an error of the system name this file where it names none.

    Args:
        path: The file that is read or written.
        part: Its name until it is whole; whoever reads the error does not know that one.

    Raises:
        OSError: What was raised within, with the file's name and in the system's own words.
    """
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(part)):
            error.filename, error.strerror = str(path), os.strerror(error.errno)
        raise


def said(error: OSError) -> str:
    """`run.csv: No space left on device`."""
    why = error.strerror or str(error)
    file = error.filename2 or error.filename  # of two files the second one is written
    return why if file is None else f"{os.fsdecode(file)}: {why}"


def not_recordable(path: Path) -> str:
    """Why nobody can record to a file of this name; "" if that can be tried."""
    if path.suffix.lower() not in RECORDING_ENDINGS:
        return f"the name must end in {' or '.join(RECORDING_ENDINGS)}"
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}"
    return irregular(path)


def write_text(path: Path, text: str) -> None:
    """Write a file of UTF-8 text.

    Raises:
        OSError: It cannot be written; names it.
    """
    with named(path):
        path.write_text(text, "utf-8")
