"""A sequence counter that counts up by one with each frame and wraps: what its next value says. Pure."""

from __future__ import annotations

from drivers.can_counters import COUNTER_RESTARTS, GARBAGE, LOST, REORDERED, REPEATED

LARGEST_STEP_BACK = 8
"""A counter this far behind, at most, is an older frame."""
LARGEST_GAP = 8
"""A counter farther ahead is believed only once the next frame goes on from it: garbage jumps, too."""
NEW = -1
"""A frame that comes next; otherwise the place of the health counter that says what it is."""


class Sequence:
    """Follows one counter.

    A gap counts as lost frames only when they are too late to be reordered ones.

    Args:
        period: Number of values of the counter; at least 2.
        counts: The driver's health counters.
    """

    def __init__(self, period: int, counts: list[int]) -> None:
        self.last: int | None = None
        self._period = period
        self._back = min(period // 4, LARGEST_STEP_BACK)
        self._gap = min(period // 2, LARGEST_GAP)
        self._counts = counts
        self._missing = 0
        """Bit k: the frame with the counter `last` - k has not come."""
        self._suspect: int | None = None

    def judge(self, counter: int) -> int:
        """What the frame with this counter is; counts all but new ones."""
        last = self.last
        if last is None:
            self.last = counter
            return NEW
        ahead = (counter - last) % self._period
        behind = -ahead % self._period
        if 0 < ahead <= self._gap:
            return self._advance(counter, ahead)
        return self._older(behind) if behind <= self._back else self._far(counter)

    def _advance(self, counter: int, ahead: int) -> int:
        if self._suspect is not None:  # the frames go on as before it
            self._suspect = None
            self._counts[GARBAGE] += 1
        self.last = counter
        if ahead > 1 or self._missing:
            missing = self._missing << ahead | ((1 << ahead - 1) - 1) << 1
            self._counts[LOST] += (missing >> self._back + 1).bit_count()
            self._missing = missing & (1 << self._back + 1) - 1
        return NEW

    def _older(self, behind: int) -> int:
        bit = 1 << behind
        found = REORDERED if self._missing & bit else REPEATED
        self._missing &= ~bit
        self._counts[found] += 1
        return found

    def _far(self, counter: int) -> int:
        """Garbage, or the first frame after a long gap or a restart: the next one tells."""
        suspect, self._suspect = self._suspect, counter
        if suspect is None:
            return GARBAGE
        if not 0 < (counter - suspect) % self._period <= self._gap:
            self._counts[GARBAGE] += 1
            return GARBAGE
        self._go_on_from(suspect)
        return self._advance(counter, (counter - suspect) % self._period)

    def _go_on_from(self, suspect: int) -> None:
        """It was no garbage: frames are lost up to it, or the sender counts anew."""
        ahead = (suspect - (self.last or 0)) % self._period
        if ahead <= self._period // 2:
            self._counts[LOST] += ahead - 1 + self._missing.bit_count()
        else:
            self._counts[COUNTER_RESTARTS] += 1
        self.last, self._missing, self._suspect = suspect, 0, None
