"""Rows of the row ring: what each axis measured and was commanded, one row a tick."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.processes.ring import Column, Word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.loop.axis import Axis
    from seod.processes.ring import Shared

T_U = 1 + Column.T_U
"""Of the first axis, behind the tick's time."""


class RowLog:
    """Writes rows one tick late: only then does the driver know when the command really left.

    Args:
        shared: Where the rows go.
        axes: Their order in a row.
    """

    def __init__(self, shared: Shared, axes: Sequence[Axis]) -> None:
        self.shared = shared
        self.axes = axes
        self.tick = 0
        self.values: list[float] = []

    def keep(self, t: float, left: float, asked: Sequence[float], volts: Sequence[float]) -> None:
        """Keep the row of tick time `t` [s], whose commands were sent at `left` [s]."""
        values: list[float] = [t]
        for axis, u_asked, u in zip(self.axes, asked, volts, strict=True):
            t_sample = axis.sample.t if math.isfinite(axis.sample.t) else t
            mode, around = axis.mode, axis.conditions
            values += (t_sample, axis.y, mode.reference, u, left, axis.amplitude(t), mode.bias, mode.signal)
            values += (
                around.ps,
                around.temperature,
                around.K_L,
                axis.course.state,
                axis.flags(t, u_asked, u),
            )
        words = self.shared.words
        self.tick, self.values = words[Word.TICKS], values
        words[Word.TICKS] = self.tick + 1

    def flush(self, left: Sequence[float]) -> None:
        """Publish the kept row.

        Args:
            left: When each axis' command, and each signal after them, really left, as the hardware confirmed
                it [s]; nan where it has not yet, empty where it cannot tell.
        """
        values = self.values
        if not values:
            return
        for axis, t in zip(range(len(self.axes)), left, strict=False):  # of the other signals nobody asks
            if t >= values[0]:  # a confirmation of an older command says nothing of this one
                values[T_U + axis * Column.COUNT] = t
        ring = self.shared.row_ring
        self.shared.row_struct.pack_into(ring.data, ring.next_offset(), self.tick, *values)
        ring.commit()
        self.values = []
