"""What a damaged file does to the libraries that read it: the one place where that becomes a sentence.

They meet it with exceptions of every kind, complain in their logs, take memory by a length that the file
tells, and leave half-made objects whose destructors fail. `library` and `bounded` stand around their calls.
"""

from __future__ import annotations

import gc
import logging
import mmap
import sys
import threading
import traceback
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from seod.machine.limits import RESOURCE

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOM_BYTES: Final = 120 << 20
"""What a call may add to the memory of this process, whatever the file's size: libraries and one block."""
TIMES_SIZE: Final = 4
"""... and so many times the file's size."""
_LONGEST: Final = 200
"""Characters that are told of what a library says."""
_LOGGERS: Final = ("asammdf", "can")
"""Libraries that complain in a log."""


_FAILED = threading.Event()
"""Since the last `heard` a library has failed."""


class DamagedError(Exception):
    """A file, or a part of it, cannot be read; the message says what its reader met."""


def plain(text: str, longest: int = 100_000) -> str:
    """One line that a terminal can show: what is not printable is escaped, what is too long is cut."""
    shown = text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return shown if len(shown) <= longest else f"{shown[: longest - 4]} ..."


def said(error: Exception) -> str:
    """What an exception says, as part of a sentence."""
    if isinstance(error, MemoryError):
        return "a length in it is beyond what a file of its size can hold"
    line = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
    kind = "" if isinstance(error, OSError | ValueError) and line else f"{type(error).__name__}: "
    return plain(f"{kind}{line}".removesuffix(": "), _LONGEST)


@contextmanager
def library(*but: type[Exception]) -> Iterator[None]:
    """Around a library's calls: whatever it raises becomes a `DamagedError`.

    Args:
        but: Errors that say already what they should.

    Raises:
        DamagedError: The library failed.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, (DamagedError, *but)):
            raise
        message = said(error)
        _FAILED.set()
        traceback.clear_frames(error.__traceback__)  # lets go of what the library had half made
        raise DamagedError(message) from error


class _Bound:
    """The process' limit of private memory while any thread is inside `bounded`; of Linux only."""

    def __init__(self, resource: Any) -> None:
        self._resource = resource
        self._lock = threading.Lock()
        self._inside = 0
        self._usual = resource.RLIM_INFINITY

    def enter(self, room: int) -> None:
        resource = self._resource
        with self._lock:
            soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
            if not self._inside:
                self._usual = soft
            self._inside += 1
            limits = [limit for limit in (self._usual, hard) if limit != resource.RLIM_INFINITY]
            resource.setrlimit(resource.RLIMIT_DATA, (min([_private_bytes() + room, *limits]), hard))

    def leave(self) -> None:
        resource = self._resource
        with self._lock:
            self._inside -= 1
            if not self._inside:
                hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
                resource.setrlimit(resource.RLIMIT_DATA, (self._usual, hard))


_BOUND = _Bound(RESOURCE) if RESOURCE is not None else None


def _private_bytes() -> int:
    """Private writable memory of this process, as RLIMIT_DATA counts it."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[5]
    return int(pages) * mmap.PAGESIZE


@contextmanager
def bounded(size: int, times: int = TIMES_SIZE) -> Iterator[None]:
    """The process may take `ROOM_BYTES` and `times` the file's size [bytes] more, else: MemoryError.

    On Linux; elsewhere nothing bounds them.
    """
    if _BOUND is None:
        yield
        return
    _BOUND.enter(ROOM_BYTES + times * size)
    try:
        yield
    finally:
        _BOUND.leave()


class _Hearing(logging.Filter):
    """Takes what libraries complain of, in the place of their handlers and of the interpreter."""

    def __init__(self) -> None:
        super().__init__()
        self.complaints: list[str] = []
        self._others = sys.unraisablehook

    def destructor(self, failed: sys.UnraisableHookArgs) -> None:
        """A destructor failed: nothing of interest where what it destroys was half made by a library."""
        if not str(getattr(failed.object, "__module__", "")).startswith(_LOGGERS):
            self._others(failed)

    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno >= logging.WARNING:
            first = record.getMessage().partition("\n")[0]
            self.complaints.append(plain(first.removesuffix("Traceback (most recent call last):"), _LONGEST))
        return False


@contextmanager
def heard() -> Iterator[list[str]]:
    """What libraries complain of meanwhile, a line each; it goes nowhere else."""
    hearing = _Hearing()
    _FAILED.clear()
    usual, sys.unraisablehook = sys.unraisablehook, hearing.destructor
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(hearing)
    try:
        yield hearing.complaints
    finally:
        if _FAILED.is_set():
            gc.collect()  # half-made files of asammdf refer to themselves
        for name in _LOGGERS:
            logging.getLogger(name).removeFilter(hearing)
        sys.unraisablehook = usual
