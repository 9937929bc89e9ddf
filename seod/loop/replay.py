"""A recording in place of the loop: its rows and events go into the rings as they are, bit for bit.

Where the recorded gateway took an event between two rows, this one does, too: an event waits until all rows
before it were taken. Nothing moves, so that there is nothing to start.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from drivers.base import DriverError
from seod.loop import events
from seod.processes.ring import Word

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from drivers.replay import ReplayDriver
    from seod.config.model import RigConfig
    from seod.processes.ring import Shared

SLICE_S = 0.02
"""Longest sleep between looks at commands [s]."""
ROWS_A_LOOK = 64
"""Rows between looks at commands, as fast as it can."""
MADE_ANEW = frozenset({"recording", "estimator"})
"""Warnings of the gateway that recorded; this one gives its own."""
REFUSED = frozenset({"start", "drive", "set"})


class Replay:
    """Plays a recording into the shared memory, in real time or as fast as it is taken.

    Args:
        config: The rig file.
        driver: Opened.
        shared: Where rows and events go.
        generation: Number of this loop process.
        clock: Real time [s].
        sleep: Sleeps so many seconds.

    Raises:
        DriverError: The recording has other axes than the rig file.
    """

    def __init__(
        self,
        config: RigConfig,
        driver: ReplayDriver,
        shared: Shared,
        generation: int,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if list(driver.axes) != list(config.axes):
            told, recorded = ", ".join(config.axes), ", ".join(driver.axes)
            raise DriverError(f"axes: the rig file has {told}, the recording {recorded}")
        self.ending = False
        self._driver = driver
        self._shared = shared
        self._generation = generation
        self._clock = clock
        self._sleep = sleep
        self._realtime = driver.options.realtime
        self._shift: float | None = None
        self._begun = False
        shared.commands.skip_to_head()
        shared.words[Word.GENERATION] = generation

    def run(self) -> None:
        """Play until the end, then wait to be told to end."""
        for item in self._driver.items():
            if self.ending:
                return
            if isinstance(item, dict):
                self._event(item)
            else:
                self._rows(item)
        self._finish()

    def _rows(self, rows: NDArray[np.void]) -> None:
        self._begin(float(rows["tick_t"][0]))
        size = self._shared.row_struct.size
        data = rows.tobytes()
        for number, t in enumerate(rows["tick_t"].tolist()):
            if self._realtime:
                self._wait_until(t)
            elif number % ROWS_A_LOOK == 0:
                self._wait_for_gateway(self._shared.rows // 2)
            if self.ending:
                return
            self._row(t, data[number * size : (number + 1) * size])

    def _row(self, t: float, row: bytes) -> None:
        ring, at = self._shared.row_ring, self._shared.row_ring.next_offset()
        ring.data[at : at + len(row)] = row
        self._shared.floats[Word.TICK_TIME_D] = t
        ring.commit()
        self._shared.words[Word.TICKS] += 1

    def _event(self, event: dict[str, Any]) -> None:
        if event["event"] == "warning" and event["code"] in MADE_ANEW:
            return
        self._begin(event["t"])
        self._wait_for_gateway(0)
        if event["event"] == "started":
            event |= {"generation": self._generation, "realtime": self._not_realtime()}
        self._shared.events.put(event)

    def _begin(self, t: float) -> None:
        """The first item, of time `t` [s], is played now."""
        if not self._begun:
            self._begun = True
            self._shared.floats[Word.TICK_TIME_D] = t
            started = {"event": "started", "t": t, "generation": self._generation, "simulated": False}
            self._shared.events.put(
                {**started, "realtime": self._not_realtime(), "truth": {}, "counters": []}
            )

    def _not_realtime(self) -> dict[str, Any]:
        return {"ok": False, "why": [f"a recording is replayed: {self._driver.options.file}"]}

    def _wait_until(self, t: float) -> None:
        if self._shift is None:
            self._shift = self._clock() - t
        self._obey()
        while not self.ending and (left := t + self._shift - self._clock()) > 0.0:
            self._sleep(min(left, SLICE_S))
            self._obey()

    def _wait_for_gateway(self, rows: int) -> None:
        """Until at most `rows` rows are not yet taken."""
        self._obey()
        words, head = self._shared.words, self._shared.row_ring.head
        while not self.ending and head[0] - words[Word.CONSUMED] > rows:
            self._sleep(1e-3)
            self._obey()

    def _finish(self) -> None:
        self._wait_for_gateway(0)
        t = self._shared.floats[Word.TICK_TIME_D]
        why = f"{self._driver.options.file} has ended"
        self._shared.events.put(
            {"event": "warning", "t": t, "axis": None, "code": "replay_ended", "why": why}
        )
        while not self.ending:
            self._sleep(SLICE_S)
            self._obey()

    def _obey(self) -> None:
        """Answer commands: what ends a movement is done already, what would begin one cannot be done."""
        words = self._shared.words
        words[Word.ESTOPS_OBEYED] = words[Word.ESTOPS]
        for message in self._shared.commands.take():
            error = "this is a recording: nothing can be moved" if message["op"] in REFUSED else None
            self._shared.events.put(events.reply(message["id"], error))
