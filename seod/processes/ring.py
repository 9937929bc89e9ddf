"""The memory that the three processes share: one memfd with a status block and three rings.

Data walks one way: the loop writes rows and events, the gateway reads them. The only way back is the command
ring (the mailbox). Writers never wait and never see readers; a reader that is too slow finds out how many
entries it lost. Each 8-byte word has exactly one writer, and aligned 8-byte stores are not torn.

Standard library only: the supervisor imports it.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

HISTOGRAM_BINS = 64
COUNTERS = 64
MESSAGE_BYTES = 4096
MESSAGE_SLOTS = 256


class Word:
    """8-byte words of the status block; `d` marks those that hold a float, by whom they are written."""

    TICKS = 0
    """Ticks done since the daemon's start; the supervisor's proof of life (loop)."""
    GENERATION = 1
    """Number of the loop process that is running (loop)."""
    FENCE = 2
    """Loops up to this generation may not write to the rig any more (supervisor)."""
    CONSUMED = 3
    """Rows that the process that estimates has taken (it)."""
    COMMANDS_SENT = 4
    """Command frames sent so far: where the neutral sequence counter goes on (loop)."""
    OVERRUNS = 5
    """Ticks that began later than one period after their time (loop)."""
    TICK_TIME_D = 6
    """Time of the last tick [s] (loop, d)."""
    SAMPLE_AGE_D = 7
    """Age of the oldest sample used in the last tick [s] (loop, d)."""
    SAMPLE_AGE_MAX_D = 8
    """Largest of these while the loop runs [s] (loop, d)."""
    LATENESS_MAX_D = 9
    """Largest lateness of a tick [s] (loop, d)."""
    EXECUTION_MAX_D = 10
    """Longest tick, all but waiting [s] (loop, d)."""
    STAMP_COMMON_D = 11
    """Standard deviation of the error that all samples' times share [s]; nan: not known (loop, d)."""
    STAMP_SCATTER_D = 12
    """Standard deviation of each sample's time beside that [s]; nan: not known (loop, d)."""
    BEATS = 13
    """Turns of the supervisor so far: it does not stand still; 0 where there is none (supervisor)."""
    ESTOPS = 24
    """E-stops that clients asked for so far: the loop looks at it before any command (gateway)."""
    ESTOPS_OBEYED = 25
    """As many of them as the loop has carried out (loop)."""
    GATEWAY_BEAT = 26
    """Turns of the gateway; the supervisor's proof that somebody could stop the rig over TCP (gateway)."""
    OBSERVER_BEAT = 27
    """Turns of the process that estimates; the gateway's proof of life (it)."""
    FAULTS = 28
    """Faults latched so far: a reset that was asked for before one does not leave it (loop)."""
    WORDS = 32


OVERTAKEN = "an e-stop came after it: nothing that was asked before is carried out"
TOO_OLD = "a fault came after this reset was asked for: see what it was, then reset"
"""Why loop or gateway refuse a command, whoever of them finds it."""


class AxisState(IntEnum):
    """State of one axis; `FAULT` is left only by a reset."""

    IDLE = 0
    ARMED = 1
    EXCITING = 2
    HOLDING = 3
    FAULT = 4


AXIS_FIELDS = ("t", "y", "reference", "u", "t_u", "e_a", "bias", "signal", "ps", "temperature", "K_L")
"""Float fields of an axis in a row: see `seod.estimate.base.Row`; `signal` is the relay's input.

`ps` [Pa] and `temperature` [K] are nan where no sensor tells them; `K_L` is the gain in force.
"""


class Column:
    """Places of `AXIS_FIELDS`, then of state and flags, among the values of one axis in a row."""

    T: Final = 0
    Y: Final = 1
    REFERENCE: Final = 2
    U: Final = 3
    T_U: Final = 4
    E_A: Final = 5
    BIAS: Final = 6
    SIGNAL: Final = 7
    PS: Final = 8
    TEMPERATURE: Final = 9
    K_L: Final = 10
    STATE: Final = 11
    """One of `AxisState`."""
    FLAGS: Final = 12
    """Sum of `FLAG_*`."""
    COUNT: Final = 13


FLAG_EXCITING = 1
"""The relay is on at full amplitude."""
FLAG_FRESH = 2
"""A new sample arrived for this tick."""
FLAG_LIMITED = 4
"""The guard clipped the command."""
FLAG_SATURATED = 8
"""The sample lies where its sensor clips."""
FLAG_SECOND_PHASE = 16
"""The relay is in the second phase of two: each switch comes late."""
FLAG_FOREIGN = 32
"""Somebody else commanded the rig shortly before: what it did is no answer to our commands."""


def bin_edges_us() -> list[float]:
    """Upper edges [us] of the histogram bins but the last: 4 bins an octave from 1 us (last: 46 ms)."""
    return [2.0 ** (k / 4) for k in range(HISTOGRAM_BINS - 1)]


class Ring:
    """Fixed slots in shared memory, one writer, one reader. The head counts all entries ever written."""

    def __init__(self, memory: memoryview, slot_bytes: int, slots: int) -> None:
        self.slot_bytes = slot_bytes
        self.slots = slots
        self.head = memory[:8].cast("q")
        self.data = memory[64 : 64 + slot_bytes * slots]
        self.tail = 0
        self.lost = 0

    @staticmethod
    def size(slot_bytes: int, slots: int) -> int:
        """Bytes that a ring takes."""
        return 64 + slot_bytes * slots

    def next_offset(self) -> int:
        """Where in `data` the writer puts the next entry, before `commit`."""
        return (self.head[0] % self.slots) * self.slot_bytes

    def commit(self) -> None:
        """Publish the entry just written."""
        self.head[0] += 1

    def pending(self) -> tuple[int, int]:
        """Entries [tail, head) that the reader can take now; older ones that were overwritten are lost."""
        head = self.head[0]
        oldest = head - self.slots + 1  # the slot being written may be the oldest one
        if self.tail < oldest:
            self.lost += oldest - self.tail
            self.tail = oldest
        return self.tail, head

    def skip_to_head(self) -> None:
        """Start reading at what comes next."""
        self.tail = self.head[0]

    def release(self) -> None:
        """Drop the views, so that the mapping can be closed."""
        self.head.release()
        self.data.release()


class MessageRing(Ring):
    """A ring of small JSON messages."""

    def __init__(self, memory: memoryview) -> None:
        super().__init__(memory, MESSAGE_BYTES, MESSAGE_SLOTS)

    def put(self, message: dict[str, Any]) -> None:
        """Write one message.

        Raises:
            ValueError: Longer than a slot.
        """
        text = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        if len(text) > MESSAGE_BYTES - 4:
            raise ValueError(f"message of {len(text)} bytes; a slot holds {MESSAGE_BYTES - 4}")
        at = self.next_offset()
        struct.pack_into("<I", self.data, at, len(text))
        self.data[at + 4 : at + 4 + len(text)] = text
        self.commit()

    def take(self) -> Iterator[dict[str, Any]]:
        """All messages that have come since the last call; those not taken now come with the next one."""
        tail, head = self.pending()
        for entry in range(tail, head):
            at = (entry % self.slots) * self.slot_bytes
            (length,) = struct.unpack_from("<I", self.data, at)
            text = bytes(self.data[at + 4 : at + 4 + length])
            self.tail = entry + 1
            yield json.loads(text)


class Shared:
    """The whole shared block of one daemon.

    Args:
        axes: Number of axes.
        rows: Length of the row ring.
        fd: An existing memfd to map; None makes one.
    """

    def __init__(self, axes: int, rows: int, fd: int | None = None) -> None:
        self.axes = axes
        self.rows = rows
        self.row_struct = struct.Struct("<qd" + f"{len(AXIS_FIELDS)}d2q" * axes)
        parts = [
            Word.WORDS * 8,
            HISTOGRAM_BINS * 8,
            HISTOGRAM_BINS * 8,
            COUNTERS * 8,
            Ring.size(self.row_struct.size, rows),
            Ring.size(MESSAGE_BYTES, MESSAGE_SLOTS),
            Ring.size(MESSAGE_BYTES, MESSAGE_SLOTS),
        ]
        size = sum(parts)
        made = fd is None
        if fd is None:
            fd = os.memfd_create("seod", os.MFD_CLOEXEC)
            os.ftruncate(fd, size)
        self.fd = fd
        self.map = mmap.mmap(fd, size)
        views = []
        at = 0
        whole = memoryview(self.map)
        for part in parts:
            views.append(whole[at : at + part])
            at += part
        self._views = [whole, *views]
        self.words = views[0].cast("q")
        self.floats = views[0].cast("d")
        self.lateness = views[1].cast("q")
        self.execution = views[2].cast("q")
        self.counters = views[3].cast("q")
        self.row_ring = Ring(views[4], self.row_struct.size, rows)
        self.events = MessageRing(views[5])
        self.commands = MessageRing(views[6])
        if made:
            self.floats[Word.STAMP_COMMON_D] = self.floats[Word.STAMP_SCATTER_D] = math.nan

    def close(self) -> None:
        """Unmap and close."""
        for ring in (self.row_ring, self.events, self.commands):
            ring.release()
        words: list[memoryview[Any]] = [self.words, self.floats, self.lateness, self.execution, self.counters]
        for view in [*words, *self._views[::-1]]:
            view.release()
        self.map.close()
        os.close(self.fd)
