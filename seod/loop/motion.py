"""How an axis moves, as the guard sees it: speed, swing, and how long its relay stays on one side."""

from __future__ import annotations

import math
from collections import deque


class SpeedMeter:
    """Mean speed over a window, so that quantisation and noise do not look like speed."""

    def __init__(self, window: float) -> None:
        self.window = window
        self.points: deque[tuple[float, float]] = deque()

    def update(self, t: float, y: float) -> float:
        """Speed [axis unit/s] over the last window; 0 until a window is full."""
        points = self.points
        points.append((t, y))
        while len(points) > 2 and t - points[1][0] >= self.window:
            points.popleft()
        t0, y0 = points[0]
        return (y - y0) / (t - t0) if t - t0 >= self.window else 0.0


class SwingMeter:
    """Half the peak-to-peak movement, in blocks: tells the amplitude now and how fast it grows.

    A block lasts `BLOCK_S`, and longer where that is less than a whole oscillation.
    """

    BLOCK_S = 0.25
    KEPT = 4
    TURNS = 3
    """Passages between the outer quarters that a block must hold: then it holds a whole oscillation."""

    def __init__(self, t: float) -> None:
        self.block_end = t + self.BLOCK_S
        self.blocks: deque[tuple[float, float]] = deque(maxlen=self.KEPT)
        self.low = self.kept_low = math.inf
        self.high = self.kept_high = -math.inf
        self.upper = False
        self.turns = 0
        self.growth = 1.0
        """Swing of the newest whole block over that of the oldest kept one; 1 until there are enough."""
        self.watched = False

    def update(self, t: float, y: float) -> float:
        """Take one sample; half the peak-to-peak movement over about the last second [axis unit]."""
        if t >= self.block_end and self.turns >= self.TURNS:
            self._end_block(t)
        if y < self.low:
            self.low = y
        if y > self.high:  # both may hold: the first sample of a block
            self.high = y
        quarter = 0.25 * (self.high - self.low)
        if y < self.low + quarter if self.upper else y > self.high - quarter:
            self.upper = not self.upper
            self.turns += 1
        low = self.low if self.low < self.kept_low else self.kept_low
        high = self.high if self.high > self.kept_high else self.kept_high
        return 0.5 * (high - low)

    def watch_growth(self) -> None:
        """Judge growth by what comes from now on: before, the oscillation only came to its amplitude."""
        self.watched = True
        self.kept_low, self.kept_high = min(self.kept_low, self.low), max(self.kept_high, self.high)
        self.blocks.clear()
        self.growth = 1.0
        self.low, self.high = math.inf, -math.inf
        self.turns = 0

    def _end_block(self, t: float) -> None:
        self.blocks.append((self.low, self.high))
        self.kept_low = min(block[0] for block in self.blocks)
        self.kept_high = max(block[1] for block in self.blocks)
        if len(self.blocks) == self.KEPT:
            first = self.blocks[0]
            self.growth = (self.high - self.low) / max(first[1] - first[0], 1e-300)
        self.low, self.high = math.inf, -math.inf
        self.turns = 0
        self.block_end = t + self.BLOCK_S


class SwitchMeter:
    """How long the relay stays on one side: now, and at most of late.

    The longest counts over blocks of `BLOCK_S` with `SWITCHES` at least: noise may switch the relay many
    times at one crossing, and halves may differ.
    """

    BLOCK_S = 1.0
    SWITCHES = 4

    def __init__(self, t: float, side: float) -> None:
        self.side = side
        self.switched_at = self.block_began = t
        self.count = 0
        self.block_longest = 0.0
        self.usual: float | None = None
        """Longest stay in the newest whole block [s]; None until there is one."""

    def update(self, t: float, side: float) -> float:
        """Take the relay's side at `t` [s]; the time since it came there [s]."""
        stay = t - self.switched_at
        if side != self.side:
            self.side, self.switched_at = side, t
            self.count += 1
            self.block_longest = max(self.block_longest, stay)
            if t - self.block_began >= self.BLOCK_S and self.count >= self.SWITCHES:
                self._end_block(t)
        return t - self.switched_at

    def _end_block(self, t: float) -> None:
        self.usual, self.block_longest = self.block_longest, 0.0
        self.block_began, self.count = t, 0
