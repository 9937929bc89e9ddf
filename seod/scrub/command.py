"""Cleans recordings one after the other, each all at once or not at all."""

from __future__ import annotations

import os
import shutil
import stat
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkstemp
from typing import TYPE_CHECKING

from seod.data.open import kind_of
from seod.files.user_files import RECORDING_MODE, irregular, named, restrict
from seod.record.disk import sync_directory
from seod.scrub import mcap, text
from seod.scrub.changes import Changes, ScrubError

if TYPE_CHECKING:
    from collections.abc import Iterator

RIG_FILES = (".yaml", ".yml", ".json")
_KEYS = (b"read_token", b"command_token")
_BLOCK = 1 << 20


def scrub(path: Path) -> str:
    """Clean one recording; returns what came of it, for people.

    Raises:
        ScrubError: It cannot be cleaned, and is as it was.
        ReadError, OSError: It cannot be read or written; likewise.
    """
    if why := irregular(path):
        raise ScrubError(f"{path}: {why}")
    path = path.resolve()  # the file itself, not a link to it
    kind = kind_of(path)
    if kind == "csv" and path.suffix.lower() in RIG_FILES:
        raise ScrubError(f"{path}: is a rig file, no recording: take the tokens out of a copy by hand")
    if kind not in ("mcap", "csv"):
        return _other(path, kind)
    links = path.stat().st_nlink - 1
    changes = _clean_mcap(path) if kind == "mcap" else _clean_text(path)
    restrict(path)
    if not changes.tokens:
        return f"{path}: shows no token"
    count = len(changes.tokens)
    more = f"; {links} hard links still lead to the old file: clean them too" if links else ""
    return f"{path}: {count} token{'s' * (count > 1)} taken out{more}"


def _other(path: Path, kind: str) -> str:
    if contains(path, set(_KEYS)):
        raise ScrubError(f"{path}: names a token; only MCAP and CSV files can be cleaned: not touched")
    restrict(path)
    return f"{path}: shows no token ({kind} files hold no rig file)"


def _clean_mcap(path: Path) -> Changes:
    found = mcap.survey(path)
    if found.leaks:
        raise ScrubError(f"{path}: its messages hold a token too, and those stay as they are: not touched")
    if not found.changes.patches:
        return found.changes
    with _replacing(path) as part:
        shutil.copyfile(path, part)
        mcap.patch(part, found)
        again = mcap.survey(part, found.changes)
        if again.leaks or again.changes.patches or contains(part, found.changes.spellings):
            raise ScrubError(f"{path}: a token is in other places of it too: not touched")
    return found.changes


def _clean_text(path: Path) -> Changes:
    changes = text.survey(path)
    if not changes.tokens:
        return changes
    with _replacing(path) as part:
        text.patch(part, path, changes)
        if text.holds(part, changes):
            raise ScrubError(f"{path}: a token is still in it: not touched")
    return changes


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A new file beside another one that takes its place, with its owner and times, once it is whole."""
    before = path.stat()
    with named(path):
        descriptor, name = mkstemp(dir=path.parent, prefix=f".{path.name}.")
        part = Path(name)
        try:
            yield part
            os.fsync(descriptor)
            if _state(path.stat()) != _state(before):
                raise ScrubError(f"{path}: was written to meanwhile: not touched")
            with suppress(PermissionError):
                os.chown(part, before.st_uid, before.st_gid)
            part.chmod(stat.S_IMODE(before.st_mode) & RECORDING_MODE)
            os.utime(part, ns=(before.st_atime_ns, before.st_mtime_ns))
            part.replace(path)
            sync_directory(path.parent)
        finally:
            os.close(descriptor)
            part.unlink(missing_ok=True)


def _state(about: os.stat_result) -> tuple[int, int, int]:
    return about.st_ino, about.st_size, about.st_mtime_ns


def contains(path: Path, words: set[bytes]) -> bool:
    """Whether one of these words is among the bytes of a file."""
    most = max(map(len, words), default=0)
    tail = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            seen = tail + block
            if any(word in seen for word in words):
                return True
            tail = seen[-most:]
    return False
