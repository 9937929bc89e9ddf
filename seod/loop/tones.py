"""Tones for a frequency response: a sum of sines, beside a slow hold that keeps a position in place."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from seod.loop.excite import Drive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.loop.excite import Controller

MOST_TONES = 60
"""Of one drive: a tick may not take long, nor a message to the loop be large."""


class Tone(NamedTuple):
    """amplitude [V] sin(2 pi frequency [Hz] t + phase [rad])."""

    frequency: float
    amplitude: float
    phase: float


class Tones(Drive):
    """Tones for a while. They count from the start, and rise from 0 in the entry time.

    Args:
        start: Time of their beginning [s].
        end: Time at which they are over [s].
        entry: Length of the rise [s].
        most: The largest voltage of their sum; it is clipped there [V].
        tones: What to put out.
        hold: Added to it: the position's slow control, or nothing.
    """

    def __init__(
        self, start: float, end: float, entry: float, most: float, tones: Sequence[Tone], hold: Controller
    ) -> None:
        super().__init__(end, most)
        self.start, self.entry, self.hold = start, entry, hold
        self.tones = [(2.0 * math.pi * tone.frequency, tone.amplitude, tone.phase) for tone in tones]

    def step(self, t: float, e: float) -> float:
        """Tones and hold; then the hold alone."""
        held = self.hold.step(t, e)
        if t >= self.end:
            return held
        since = t - self.start
        u = sum([amplitude * math.sin(omega * since + phase) for omega, amplitude, phase in self.tones])
        if since < self.entry:
            u *= since / self.entry
        most = abs(self.voltage)
        return max(-most, min(most, u)) + held


def read_tones(values: Sequence[Sequence[float]]) -> tuple[Tone, ...]:
    """Tones as they come from a client: frequency, amplitude, phase each.

    Raises:
        ValueError: They are not that; says what would be right.
    """
    if len(values) > MOST_TONES:
        raise ValueError(f"tones: at most {MOST_TONES}, got {len(values)}")
    for value in values:
        if len(value) != 3 or not all(math.isfinite(x) for x in value) or value[0] <= 0.0:
            what = "each is [frequency > 0 in Hz, amplitude in V, phase in rad]"
            raise ValueError(f"tones: {what}, got {list(value)}")
    return tuple(Tone(*map(float, value)) for value in values)
