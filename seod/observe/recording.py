"""What the gateway writes to files, if anything: a recorder and a log of the bus. Nothing here waits."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from seod.record.bus import BusLog
    from seod.record.opening import Recorder


class Recording:
    """A recorder and a bus log, each of which may be missing.

    Args:
        recorder: Records from the start to the end.
        bus_log: Likewise of the bus.
        another: Makes a recorder when a client asks for one; None where the rig file names no folder.
    """

    def __init__(
        self,
        recorder: Recorder | None = None,
        bus_log: BusLog | None = None,
        another: Callable[[], Recorder] | None = None,
    ) -> None:
        self._recorder = recorder
        self._another, self._asked_for = another, False
        self._ending: list[threading.Thread] = []
        self._bus_log = bus_log
        self._told = ["", ""]
        self.rows_missing = 0
        """Rows that are not in the file; known once it is closed."""

    @property
    def waiting(self) -> int:
        """Rows that are not yet written."""
        return 0 if self._recorder is None else self._recorder.waiting

    def begin(self) -> str:
        """Begin a recording; returns why that cannot be, or ""."""
        if self._recorder is not None:
            return "it records already"
        if self._another is None:
            return "the rig file names no folder for recordings: set record.folder"
        try:
            self._recorder = self._another()
        except OSError as error:
            return f"cannot record: {error.strerror or error}"
        self._asked_for, self._told[0] = True, ""
        return ""

    def end(self) -> str:
        """End the recording that `begin` began, without waiting; returns why that cannot be, or ""."""
        if self._recorder is None:
            return "nothing is recorded"
        if not self._asked_for:
            return "this recording was asked for by --record: it ends with the daemon"
        thread = threading.Thread(target=self._recorder.close, name="ending a recording")
        thread.start()
        self._ending = [each for each in self._ending if each.is_alive()] + [thread]
        self._recorder, self._asked_for = None, False
        return ""

    def add(self, rows: NDArray[np.void]) -> None:
        """Record rows (dtype `seod.record.layout.row_dtype`)."""
        if self._recorder is not None:
            self._recorder.add(rows)

    def note(self, topic: str, t: float, message: Mapping[str, Any]) -> None:
        """Record a message of time `t` [s]."""
        if self._recorder is not None:
            self._recorder.note(topic, t, message)

    def news(self) -> Iterator[str]:
        """What began to go wrong since the last call, or goes on again."""
        for number, writer in enumerate((self._recorder, self._bus_log)):
            error = "" if writer is None else writer.error
            if error != self._told[number]:
                self._told[number] = error
                yield error or (f"recording goes on in {writer.report()['file']}" if writer else "")

    def report(self) -> dict[str, Any]:
        """For `health`: null for what is missing."""
        return {
            "recorder": None if self._recorder is None else self._recorder.report(),
            "bus_log": None if self._bus_log is None else self._bus_log.report(),
        }

    def close(self) -> None:
        """End the files."""
        if self._recorder is not None:
            self.rows_missing = self._recorder.close()
        if self._bus_log is not None:
            self._bus_log.close()
        for thread in self._ending:
            thread.join()
