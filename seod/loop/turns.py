"""The order of excitation: who has the turn when the axes of a rig are excited one after the other.

The axis whose turn it is has its relay on; the others hold the position they stood at. A turn ends with the
way back to that position, and only then does the next one begin: no two axes ask for oil at once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.loop.course import Course


class Turns:
    """Passes the turn round until all axes are stopped.

    Args:
        length: How long an axis is excited in its turn, from relay on [s].
    """

    def __init__(self, length: float) -> None:
        self.length = length
        self.queue: list[Course] = []
        self.relay_on = math.inf

    def begin(self, axes: Sequence[Course]) -> None:
        """Have these axes, which have been started just now, take turns; the first one is not waiting."""
        self.queue = list(axes)
        self.relay_on = math.inf

    def step(self, t: float) -> None:
        """Look at time `t` [s] whether a turn is over. One that is stopped or in fault leaves the round."""
        if not self.queue:
            return
        holder = self.queue[0]
        if not all(course.active for course in self.queue):
            self.queue = [course for course in self.queue if course.active]
        if not holder.active:
            self._pass_on(t, self.queue)
        elif holder.waiting:
            if holder.hold_is_over(t):
                self._pass_on(t, [*self.queue[1:], holder])
        elif holder.exciting:
            self.relay_on = min(self.relay_on, t)
            if t - self.relay_on >= self.length:
                holder.wait(t, "its turn is over")

    def _pass_on(self, t: float, queue: Sequence[Course]) -> None:
        self.queue = [course for course in queue if course.active and not course.stopping]
        self.relay_on = math.inf
        if self.queue:
            self.queue[0].go_on(t)
