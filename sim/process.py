"""A simulated rig as a process: punctual where the system allows it, and gone when told to go."""

from __future__ import annotations

import ctypes
import gc
import json
import math
import os
import signal
import time
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType, TracebackType

PRIORITY = 20
"""SCHED_FIFO priority: below the daemon's loop, so that the rig never holds it up on a shared machine."""

PR_SET_TIMERSLACK = 29

POLL_S = 0.005
"""How often the control port and the end are looked at."""


class RigProcess:
    """While entered, SIGTERM and SIGINT end `repeat`, and the process keeps good time.

    Args:
        duration: `repeat` ends after this [s]; None: never by itself.
    """

    def __init__(self, duration: float | None) -> None:
        self._ended = False
        self._end = math.inf if duration is None else time.monotonic() + duration
        self._handlers: dict[int, object] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGTERM, signal.SIGINT):
            self._handlers[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)  # type: ignore[arg-type]  # what signal() itself gave

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._ended = True

    def ready(self, facts: dict[str, object]) -> None:
        """Tell on stdout, in one line of JSON, that the rig is there."""
        print(json.dumps({"rig": "ready", **facts, "realtime": be_punctual()}), flush=True)  # noqa: T201 - its output

    def repeat(self, step: Callable[[float, float], float], poll: Callable[[], None]) -> None:
        """Call `step` again and again, and `poll` now and then.

        Args:
            step: Takes the time and the longest time that it may take; returns the time at its end [s].
            poll: Looks after the control port without waiting.
        """
        now = next_poll = time.monotonic()
        while not self._ended and now < self._end:
            if now >= next_poll:
                poll()
                next_poll = now + POLL_S
            now = step(now, POLL_S)


def be_punctual() -> bool:
    """Ask the system for short wake-up times; whether it granted real-time scheduling."""
    ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    gc.freeze()  # what exists now lives to the end: collections have little to look at
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True
