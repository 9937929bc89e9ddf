"""Sensor frames: each is checked against its sequence counter before its values are used. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from drivers.base import Sample
from drivers.can_counters import (
    CHECKSUM_ERRORS,
    FRAMES_RECEIVED,
    GARBAGE,
    LATE,
    REORDERED,
    REPEATED,
    WRONG_LENGTH,
)
from drivers.can_sequence import NEW, Sequence

if TYPE_CHECKING:
    from drivers.can_codec import Decoded
    from drivers.can_dbc import Layout

LATE_PERIODS = 1.5
REMARK_S = 10.0
"""Frames that are refused are told at once, and then no more often than this."""

REFUSED: Final = {
    CHECKSUM_ERRORS: "with a wrong checksum",
    WRONG_LENGTH: "of a wrong length",
    REORDERED: "older than the one before",
    GARBAGE: "whose counter jumps",
}
"""Health counter -> what its frames are."""
TOLD: Final = {REPEATED: "repeated_frames", GARBAGE: "garbage_frames"}
"""Those that are told as warnings -> the code of the warning."""


class InputFrame:
    """One message that is read.

    Args:
        layout: Of the message in the DBC.
        signals: Signals wanted, each with its place in `samples`.
        samples: The driver's samples; the newest values are put there.
        counts: The driver's health counters.
    """

    def __init__(
        self, layout: Layout, signals: list[tuple[str, int]], samples: list[Sample], counts: list[int]
    ) -> None:
        self.name = layout.name
        self.counter = layout.counter
        self.sequence = Sequence(layout.period, counts) if layout.period else None
        self.longest_gap = LATE_PERIODS / layout.rate_hz if layout.rate_hz else math.inf
        self.signals = signals
        self.samples = samples
        self.counts = counts
        self.t = -math.inf
        self.refused: dict[int, int] = {}
        """Frames that were not used since the last that was: health counter -> how many."""
        self.untold: dict[int, int] = {}
        """Likewise of the kinds in `TOLD`, since they were told last."""
        self._next_remark = -math.inf

    def accept(self, decoded: Decoded, t: float) -> bool:
        """Use a frame that was taken at `t`; False if it is broken, old, or without anything wanted."""
        if not decoded.checksum_ok:
            self.counts[CHECKSUM_ERRORS] += 1
            return self.refuse(CHECKSUM_ERRORS)
        if self.sequence is not None and decoded.counter is not None:
            found = self.sequence.judge(decoded.counter)
            if found != NEW:
                return self.refuse(found)
        if t <= self.t:  # stamps may coincide; a new sample is known by its new time
            t = math.nextafter(self.t, math.inf)
        if t - self.t > self.longest_gap and self.t > -math.inf:
            self.counts[LATE] += 1
        self.t = t
        self.counts[FRAMES_RECEIVED] += 1
        if self.refused:
            self.refused.clear()
        return self._store(decoded, t)

    def refuse(self, why: int) -> bool:
        """Note a frame that cannot be used, by its health counter."""
        self.refused[why] = self.refused.get(why, 0) + 1
        if why in TOLD:
            self.untold[why] = self.untold.get(why, 0) + 1
        return False

    def _store(self, decoded: Decoded, t: float) -> bool:
        stored = False
        for signal, index in self.signals:
            if signal in decoded.values:  # a multiplexed signal is not in every frame
                self.samples[index] = Sample(decoded.values[signal], t)
                stored = True
        return stored

    def why_old(self) -> str:
        """Why the frames that came since the newest sample were not used; "" if none came."""
        found = [f"{frames} {REFUSED[kind]}" for kind, frames in self.refused.items() if kind in REFUSED]
        if REPEATED in self.refused:
            found.insert(0, self._stands_still())
        return f"frames of {self.name} come, but since then {', '.join(found)}" if found else ""

    def _stands_still(self) -> str:
        at = "" if self.sequence is None else f" at {self.sequence.last}"
        times = self.refused[REPEATED]
        return (
            f"the counter {self.counter} stands still{at}: the sender repeats its frame, {times} times so far"
        )

    def remarks(self, t: float) -> list[tuple[str, str]]:
        """Warnings at `t` [s] about frames that were not used and about which nothing was said yet."""
        if not self.untold or t < self._next_remark:
            return []
        self._next_remark = t + REMARK_S
        untold, self.untold = self.untold, {}
        return [(TOLD[kind], self._remark(kind, frames)) for kind, frames in untold.items()]

    def _remark(self, kind: int, frames: int) -> str:
        if kind == REPEATED:
            why = "the sender repeats frames, or this signal does not count each of them (driver.messages)"
            return f"{self.name}: {frames} frames with the same {self.counter} as one before: {why}"
        why = "another node sends this identifier, or data are damaged (a checksum would tell)"
        return f"{self.name}: {frames} frames whose {self.counter} jumps were not used: {why}"
