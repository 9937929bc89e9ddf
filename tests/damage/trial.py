"""What a user may do with a file, and how it must end: in an answer, or in a sentence that names the file."""

from __future__ import annotations

import json
import logging
import sys
import traceback
from contextlib import suppress
from typing import TYPE_CHECKING

from drivers.base import DriverError
from drivers.replay import ReplayDriver, ReplayOptions
from seod.data import ReadError, open_source, read
from seod.data.export import export
from seod.data.show import as_text
from seod.data.summary import summarize
from seod.record.read import RecordingError
from tests.damage.files import DBC, log_beside

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.damage.files import Sound

SENTENCES = (ReadError, RecordingError, DriverError)
_LONGEST = 600
"""Characters of a sentence."""


class Complaints(logging.Handler):
    """Tracebacks that a library logs, or that a destructor leaves on stderr."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.found: list[str] = []
        logging.getLogger().addHandler(self)
        sys.unraisablehook = self._unraisable

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info or "Traceback" in record.getMessage():
            self.found.append(f"logged: {record.getMessage()}: {record.exc_info}")

    def _unraisable(self, unraisable: sys.UnraisableHookArgs) -> None:
        if not isinstance(unraisable.exc_value, ResourceWarning):  # python-can's files, closed right then
            self.found.append(f"unraisable: {unraisable.exc_value!r} in {unraisable.object!r}")

    def close(self) -> None:
        """Listen no more."""
        logging.getLogger().removeHandler(self)
        sys.unraisablehook = sys.__unraisablehook__
        super().close()

    def taken(self) -> list[str]:
        """Those since the last call."""
        found, self.found = self.found, []
        return found


def uses(path: Path, sound: Sound, folder: Path, to: str) -> list[Callable[[], object]]:
    """Everything that is done with such a file."""
    dbc = path if sound.use == "dbc" else DBC if sound.frames else None
    data = log_beside(folder) if sound.use == "dbc" else path
    own: list[Callable[[], object]] = [lambda: _replay(path)] if sound.use == "replay" else []
    return [
        lambda: _info(data, dbc),
        lambda: read(data, sound.columns, dbc=dbc).problems,
        lambda: _export(data, dbc, to, folder),
        *own,
    ]


def _info(path: Path, dbc: Path | None) -> str:
    with open_source(path, dbc) as source:
        summary = summarize(source)
    json.dumps(summary.as_json(), allow_nan=False)
    return as_text(summary)


def _export(path: Path, dbc: Path | None, to: str, folder: Path) -> object:
    out = folder / f"out.{to}"
    with open_source(path, dbc) as source:
        done = export(source, to, out, overwrite=True)
    for file in done.files:
        file.unlink()
    return done.said


def _replay(path: Path) -> int:
    options = ReplayOptions.model_validate({"kind": "replay", "file": str(path)})
    driver = ReplayDriver(options, lambda: 0.0)
    channels = driver.channels(options)
    driver.open([c.name for c in channels if c.direction == "input"], ["valve"])
    with suppress(StopIteration):
        return sum(1 for _ in driver.items())
    return 0


def outcome(use: Callable[[], object], *names: str) -> str:
    """`""` if it ended as it must, else what happened."""
    try:
        use()
    except SENTENCES as error:
        said = str(error)
        if not any(name in said for name in names) or "\n" in said or len(said) > _LONGEST:
            return f"no sentence that names the file: {type(error).__name__}: {said[:200]!r}"
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        frame = traceback.extract_tb(error.__traceback__)[-1]
        own = [f for f in traceback.extract_tb(error.__traceback__) if "/seod/" in f.filename][-1:]
        at = f"{frame.filename.rsplit('/', 2)[-1]}:{frame.lineno}"
        through = f" through {own[0].filename.rsplit('/', 1)[-1]}:{own[0].lineno}" if own else ""
        return f"traceback: {type(error).__name__}: {str(error)[:80]!r} at {at}{through}"
    return ""
