"""Frames that never change: to open with, for each tick, and as heartbeat."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import can

if TYPE_CHECKING:
    from drivers.can_config import CanOptions, FrameOptions
    from drivers.can_link import CanLink


class FixedFrames:
    """Sends the frames that the rig file lists."""

    def __init__(self, options: CanOptions, link: CanLink) -> None:
        self._link = link
        self._start = [_message(frame, options) for frame in options.start_frames]
        self._tick = [_message(frame, options) for frame in options.tick_frames]
        self._beats = [(_message(frame, options), frame.period_s) for frame in options.heartbeat]
        self._due = [-math.inf] * len(self._beats)

    def __len__(self) -> int:
        return len(self._start) + len(self._tick) + len(self._beats)

    def send_start(self) -> None:
        """The opening frames, such as NMT start."""
        for message in self._start:
            self._link.send(message)

    def send_due(self, t: float) -> None:
        """What belongs to the tick at `t` [s]: SYNC, and the heartbeats whose period has passed."""
        for message in self._tick:
            self._link.send(message)
        for place, (message, period) in enumerate(self._beats):
            if t >= self._due[place]:
                # a late beat does not make the next one early
                self._due[place] = t + period if t - self._due[place] > period else self._due[place] + period
                self._link.send(message)


def _message(frame: FrameOptions, options: CanOptions) -> can.Message:
    data = frame.payload
    return can.Message(
        arbitration_id=frame.id,
        is_extended_id=frame.extended,
        is_fd=len(data) > 8,
        bitrate_switch=len(data) > 8 and options.data_bitrate is not None,
        data=data,
    )
