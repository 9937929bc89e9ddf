"""The gateway's end of the row ring: whole rows out of memory that the loop keeps overwriting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.processes.ring import Word
from seod.record.layout import row_dtype

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.processes.ring import Shared

MAX_ROWS = 256
"""Most rows taken at once, so that answers and events come between them."""


class RowReader:
    """Takes rows in order; `lost` counts those that were overwritten before they could be taken.

    Args:
        shared: The memory shared with the loop.
        looks_on: Begin at what comes next and leave no trace in the memory: for who does not record.
    """

    def __init__(self, shared: Shared, *, looks_on: bool = False) -> None:
        self._looks_on = looks_on
        self._ring = shared.row_ring
        self._words = shared.words
        if looks_on:
            self._ring.skip_to_head()
        else:
            self._ring.tail = shared.words[Word.CONSUMED]  # where an earlier gateway ended
        self._slots = np.frombuffer(self._ring.data, row_dtype(shared.axes), count=shared.rows)
        self._torn = 0
        self._last_tick = -1

    @property
    def lost(self) -> int:
        """Rows lost since the start."""
        return self._ring.lost + self._torn

    def restart(self) -> None:
        """A new loop process begins: its ticks may count from anywhere."""
        self._last_tick = -1

    @property
    def head(self) -> int:
        """Rows that the loop has written so far."""
        head: int = self._ring.head[0]
        return head

    @property
    def behind(self) -> float:
        """Rows that wait, over those that the ring holds."""
        tail, head = self._ring.pending()
        return (head - tail) / len(self._slots)

    def take(self, upto: int | None = None) -> NDArray[np.void]:
        """A copy of the rows that have come since the last call, at most `MAX_ROWS`, shape (n,).

        Args:
            upto: An earlier `head`: rows that came later are left for the next call.
        """
        tail, head = self._ring.pending()
        head = min(head if upto is None else max(upto, tail), tail + MAX_ROWS)
        rows = self._copied(tail, head)
        self._ring.tail = head
        if not self._looks_on:
            self._words[Word.CONSUMED] = head
        return self._whole(rows, tail) if len(rows) else rows

    def _copied(self, tail: int, head: int) -> NDArray[np.void]:
        """Rows [tail, head), at most as many as the ring holds: one piece, or two around its end."""
        slots = len(self._slots)
        first = tail % slots
        last = first + head - tail
        if last <= slots:
            return self._slots[first:last].copy()
        return np.concatenate((self._slots[first:], self._slots[: last - slots]))

    def _whole(self, rows: NDArray[np.void], tail: int) -> NDArray[np.void]:
        """Without the rows that the loop overwrote while they were copied: their ticks are out of order."""
        overwritten = max(0, self._ring.head[0] - len(self._slots) + 1 - tail)
        whole = rows[overwritten:]
        kept = []
        for place, tick in enumerate(whole["tick"].tolist()):
            if tick > self._last_tick:
                self._last_tick = tick
                kept.append(place)
        self._torn += len(rows) - len(kept)
        return whole if len(kept) == len(whole) else whole[kept]

    def close(self) -> None:
        """Let go of the memory, so that it can be unmapped."""
        self._slots = np.empty(0, self._slots.dtype)
