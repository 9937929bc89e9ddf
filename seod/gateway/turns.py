"""Who is next: what clients ask for and get is done in slices, each client in its turn.

Between two turns the event loop reads what has come, and an e-stop is carried out as it is read. So it waits
for one turn at most, whatever the others do.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

SLICE_S = 1e-3
"""Time for one kind of work in a turn; a client's single item takes 0.01 to 0.2 ms."""
SHARE = 0.5
"""Part of a processor that turns may take in the long run: the gateway goes before all but the loop,"""
CREDIT_S = 5e-3
"""and so much at once before that counts."""


class Rotation:
    """Whoever has work of one kind, in the order in which they are served.

    Args:
        soon: Called when there is work.
    """

    def __init__(self, soon: Callable[[], None]) -> None:
        self._soon = soon
        self._waiting: dict[Callable[[], bool], None] = {}

    def add(self, work: Callable[[], bool]) -> None:
        """Have `work` called; again and again, as long as it returns True."""
        self._waiting[work] = None
        self._soon()

    def discard(self, work: Callable[[], bool]) -> None:
        """Do not call it any more."""
        self._waiting.pop(work, None)

    @property
    def waits(self) -> bool:
        """Whether somebody is still to be served."""
        return bool(self._waiting)

    def run(self, slice_s: float) -> None:
        """Serve until the slice is over, at least one; work that raises is not called again."""
        end = time.perf_counter() + slice_s
        while self._waiting:
            work = next(iter(self._waiting))
            del self._waiting[work]
            if work():
                self._waiting[work] = None
            if time.perf_counter() >= end:
                break


class Turns:
    """All kinds of work: lines are sorted, then commands, queries, and what is sent."""

    def __init__(self, slice_s: float = SLICE_S) -> None:
        self._slice_s = slice_s
        self._handle: asyncio.Handle | None = None
        self._credit, self._counted = CREDIT_S, time.perf_counter()
        self.lines = Rotation(self._soon)
        self.commands = Rotation(self._soon)
        self.queries = Rotation(self._soon)
        self.sending = Rotation(self._soon)

    def _soon(self) -> None:
        if self._handle is None:
            loop, rest = asyncio.get_running_loop(), max(0.0, -self._credit / SHARE)
            self._handle = loop.call_later(rest, self._turn) if rest else loop.call_soon(self._turn)

    def _turn(self) -> None:
        kinds = (self.lines, self.commands, self.queries, self.sending)
        begun = time.perf_counter()
        try:
            for kind in kinds:
                kind.run(self._slice_s)
        finally:  # work that fails, for want of memory for instance, must not end that of the others
            now = time.perf_counter()
            earned = SHARE * (begun - self._counted)
            self._credit, self._counted = min(CREDIT_S, self._credit + earned) - (now - begun), now
            self._handle = None
            if any(kind.waits for kind in kinds):
                self._soon()
