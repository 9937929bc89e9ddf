"""The MCAP recorder: a thread that writes what the gateway hands it; a disk costs data of the file at most.

Each pass takes all that waits, makes one chunk of it, writes it and waits for the disk. While the disk is
full the chunk waits and is written once there is room; while the file is gone a new one is tried for. Rows
wait in memory meanwhile, up to `WAITING_ROWS`; what finds no room there is counted, and the counters are in
the file.
"""

from __future__ import annotations

import queue
import threading
import time
from typing import TYPE_CHECKING, Any

from seod.record.disk import missing
from seod.record.series import Amount, Note, Rotation, Series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from seod.record.mcap_file import About

PASS_S = 0.25
"""How often what waits is brought to the disk [s]: well within the second that a crash may cost."""
SLOW_S = 1.0
"""A disk that has not taken what waits for this long is told to be slow [s]."""
WAITING_ROWS = 100_000
WAITING_NOTES = 10_000
"""What may wait in memory; the rest is dropped and counted."""
CLOSE_S = 5.0
"""How long the end of the daemon waits for the disk [s]."""


class McapRecorder:
    """Takes rows and notes from the gateway's thread and writes them in its own.

    Args:
        path: Of the first file; see `Series`.
        about: What the recording says of itself.
        rotation: When the next file begins.
        clock: Time [s] by which passes and rotation go.

    Raises:
        OSError: Not even the beginning of the first file can be written.
    """

    def __init__(
        self, path: Path, about: About, rotation: Rotation, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock = clock
        self._queue: queue.SimpleQueue[NDArray[np.void] | Note] = queue.SimpleQueue()
        self._taken, self._refused = Amount(), Amount()
        self._passed = clock()
        self._series = Series(path, about, rotation, self._counters, clock())
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Rows that are neither on the disk nor lost."""
        return self._taken.rows - self._series.written.rows - self._series.lost.rows

    @property
    def error(self) -> str:
        """What is wrong with the disk at present; "" if nothing is."""
        if self._series.failure:
            return self._series.failure
        if not self._thread.is_alive():
            return f"{self._series.path}: the recorder has ended"
        if self.waiting and self._clock() - self._passed > SLOW_S:
            return f"{self._series.path}: the disk is slow, rows wait in memory for more than {SLOW_S:g} s"
        return ""

    def add(self, rows: NDArray[np.void]) -> None:
        """Take rows (dtype `seod.record.layout.row_dtype`) to be written soon; never waits."""
        if self.waiting + len(rows) > WAITING_ROWS:
            self._refused.rows += len(rows)
            return
        self._taken.rows += len(rows)
        self._queue.put(rows)

    def note(self, topic: str, t: float, message: Mapping[str, Any]) -> None:
        """Take a JSON message of time `t` [s] for the channel `topic`; never waits."""
        if self._taken.notes - self._series.written.notes - self._series.lost.notes >= WAITING_NOTES:
            self._refused.notes += 1
            return
        self._taken.notes += 1
        self._queue.put(Note(topic, t, message))

    def report(self) -> dict[str, Any]:
        """For `health`: file, its length, rows written, waiting and lost, and what is wrong (or null)."""
        series = self._series
        about = {"file": str(series.path), "bytes": series.bytes, "error": self.error or None}
        return {**about, **self._counters()}

    def _counters(self) -> dict[str, int]:
        series = self._series
        return {
            "rows": series.written.rows,
            "waiting": self.waiting,
            "lost": series.lost.rows + self._refused.rows,
            "notes": series.written.notes,
            "notes_lost": series.lost.notes + self._refused.notes,
        }

    def close(self) -> int:
        """Write what waits and end the file; a disk that hangs is not waited for.

        Returns:
            Rows that are not in the file, or not surely.
        """
        self._end.set()
        self._thread.join(CLOSE_S)
        lost = self.waiting + self._counters()["lost"]
        return missing(self._series.path, lost or int(self._thread.is_alive()), self._series.failure)

    def _run(self) -> None:
        ended = False
        while not ended:
            ended = self._end.wait(PASS_S)
            self._pass(self._clock())
        self._series.finish(self._clock())

    def _pass(self, now: float) -> None:
        items = []
        if self._series.ready(now):
            while not self._queue.empty():
                items.append(self._queue.get())
        if items:
            self._series.put(items, now)
        self._passed = now
