"""Recording to CSV, in a thread of its own: a slow or full disk costs rows of the file, never anything else.

One header line, then one line a tick. For each axis: `t` [s] when `y` was sampled, `y` [axis unit], `u` [V],
`t_u` [s] when `u` left, `reference`, `e_a` [V], `bias` [V], `signal` (the relay's input), `ps` [Pa],
`temperature` [K], `K_L` in force, `state`, `flags` (`FLAG_*` of `seod.processes.ring`). With several axes
each column carries its axis: `motor.t`, `motor.y`, ..., so that `--columns t=motor.t,y=motor.y,u=motor.u`
selects one. `y` and `reference` tell their unit: `y [rad]`. `tick` counts ticks; `t_tick` [s] is when they
began.

A tick without a new sample has an empty `y`, and as `t` when the sample would have been taken. Numbers have
all their digits; what is undefined is empty.
"""

from __future__ import annotations

import math
import os
import queue
import stat
import threading
from collections import deque
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from seod.files.user_files import create_recording, keep_earlier
from seod.processes.ring import AXIS_FIELDS, FLAG_FRESH, AxisState, Column
from seod.record.disk import FULL, missing
from seod.record.layout import MEASURED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

COLUMNS = (
    "t",
    "y",
    "u",
    "t_u",
    "reference",
    "e_a",
    "bias",
    "signal",
    "ps",
    "temperature",
    "K_L",
    "state",
    "flags",
)
_ORDER = [AXIS_FIELDS.index(name) for name in COLUMNS[1:-2]]
_STATES = {int(state): state.name.lower() for state in AxisState}

BATCH_S = 0.2
"""How often rows are written [s]; nothing is kept back after that."""
WAITING_ROWS = 100_000
"""Rows that may wait for a slow disk; further ones are dropped and counted."""
CLOSE_S = 2.0
RETRY_S = 1.0
"""How often a disk that failed is tried again [s]."""
_PIECE_ROWS = 500
"""Rows that are written whole or not at all."""


def header(axes: Sequence[str], units: Mapping[str, str] = MappingProxyType({})) -> str:
    """The first line, with its end; `units` of what an axis measures, by its name."""
    names = [
        (f"{axis}.{name}" if len(axes) > 1 else name)
        + (f" [{units[axis]}]" if name in MEASURED and axis in units else "")
        for axis in axes
        for name in COLUMNS
    ]
    return ",".join([*names, "tick", "t_tick"]) + "\n"


class CsvLines:
    """Turns rows into lines."""

    def __init__(self, axes: int) -> None:
        self._last = [(math.nan, math.nan)] * axes

    def lines(self, rows: NDArray[np.void]) -> str:
        """One line for each row (dtype `seod.record.layout.row_dtype`)."""
        parts = []
        columns = (rows[name].tolist() for name in ("tick", "tick_t", "axes"))
        for tick, t_tick, axes in zip(*columns, strict=True):
            cells = [self._cells(index, t_tick, axis) for index, axis in enumerate(axes)]
            parts.append(f"{','.join(cells)},{tick},{t_tick!r}\n")
        return "".join(parts)

    def _cells(self, index: int, t_tick: float, axis: tuple[Any, ...]) -> str:
        *_, state, flags = axis
        t, values = axis[Column.T], [axis[column] for column in _ORDER]
        if flags & FLAG_FRESH:
            self._last[index] = (t, t_tick)
        else:
            t_sample, t_then = self._last[index]
            t, values[0] = t_sample + t_tick - t_then, math.nan
        numbers = [repr(x) if math.isfinite(x) else "" for x in (t, *values)]
        return f"{','.join(numbers)},{_STATES[state]},{flags}"


class CsvFile:
    """An unbuffered file that takes whole pieces or nothing, so that it never ends in half a line.

    A regular file that has content already is kept as `NAME~`.

    Raises:
        OSError: It cannot be opened, or, from `write`, not be written.
    """

    def __init__(self, path: Path) -> None:
        keep_earlier(path)
        self._fd = create_recording(path)
        self._regular = stat.S_ISREG(os.fstat(self._fd).st_mode)
        self._size = 0

    def write(self, text: str) -> None:
        """Append."""
        data = memoryview(text.encode("ascii"))
        if self._regular and os.fstat(self._fd).st_nlink == 0:
            raise FileNotFoundError("the file was deleted")
        try:
            while data:
                data = data[os.write(self._fd, data) :]
        except OSError:
            if self._regular:
                os.ftruncate(self._fd, self._size)
                os.lseek(self._fd, self._size, os.SEEK_SET)
            raise
        self._size += len(text)

    def close(self) -> None:
        """Close."""
        os.close(self._fd)


class CsvRecorder:
    """Takes rows from the gateway and writes them in its own thread.

    Args:
        path: Where to.
        axes: Names of the axes.
        units: SI units of what they measure, by name.

    Raises:
        OSError: The file cannot be opened, or not even its header be written.
    """

    def __init__(
        self, path: Path, axes: Sequence[str], units: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        self.error = ""
        """Why rows are not being written at present."""
        self._path = path
        self._lines = CsvLines(len(axes))
        self._file = CsvFile(path)
        self._file.write(header(axes, units))
        self._queue: queue.SimpleQueue[NDArray[np.void]] = queue.SimpleQueue()
        self._unwritten: deque[tuple[str, int]] = deque()
        self._taken = self._written = self._failed = self._refused = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Rows that are not yet written."""
        return self._taken - self._written - self._failed

    def add(self, rows: NDArray[np.void]) -> None:
        """Take rows (dtype `seod.record.layout.row_dtype`) to be written soon; never waits."""
        if self.waiting + len(rows) > WAITING_ROWS:
            self._refused += len(rows)
            return
        self._taken += len(rows)
        self._queue.put(rows)

    def note(self, topic: str, t: float, message: Mapping[str, Any]) -> None:
        """Estimates, events and health have no place among these columns."""

    def report(self) -> dict[str, Any]:
        """For `health`: file, rows written, waiting and lost, and what is wrong (null if nothing is)."""
        lost = self._failed + self._refused
        counts = {"rows": self._written, "waiting": self.waiting, "lost": lost}
        return {"file": str(self._path), **counts, "error": self.error or None}

    def close(self) -> int:
        """Write what waits and end; a disk that hangs is not waited for.

        Returns:
            Rows that are not in the file.
        """
        self._end.set()
        self._thread.join(CLOSE_S)
        if not self._thread.is_alive():
            self._file.close()
        return missing(self._path, self.waiting + self._failed + self._refused, self.error)

    def _run(self) -> None:
        ended = False
        while not ended:
            ended = self._end.wait(RETRY_S if self.error else BATCH_S)
            while not self._queue.empty():
                self._take(self._queue.get())
            self._write()

    def _take(self, rows: NDArray[np.void]) -> None:
        for at in range(0, len(rows), _PIECE_ROWS):
            piece = rows[at : at + _PIECE_ROWS]
            self._unwritten.append((self._lines.lines(piece), len(piece)))

    def _write(self) -> None:
        """All that waits, as far as the disk has room; what another failure hits is lost."""
        failure = ""
        while self._unwritten:
            text, count = self._unwritten[0]
            try:
                self._file.write(text)
            except OSError as error:
                failure = f"{self._path} cannot be written: {error.strerror or error}"
                if error.errno in FULL:
                    break
                self._failed += count
            else:
                self._written += count
            self._unwritten.popleft()
        self.error = failure
