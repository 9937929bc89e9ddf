"""What a rig on a CAN bus sends and receives, as the rig file and the DBC say it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from seod.config.busload import Bus, Frame

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivers.can_dbc import Layout
    from seod.config.model import RigConfig


class Traffic(NamedTuple):
    """A bus with its frames, and the messages of other nodes whose rate nobody tells."""

    bus: Bus
    unknown: tuple[str, ...]


def can_traffic(config: RigConfig) -> Traffic:
    """The frames of a rig whose driver is `can`.

    Commands go at the loop rate, and so do sensor messages where neither the rig file nor the DBC
    (`GenMsgCycleTime`) says otherwise. Other messages of the DBC count if their rate is known.
    """
    options = CanOptions.model_validate(config.driver)
    commanded = _messages(config.outputs[axis.output].channel for axis in config.axes.values())
    estop = [config.guard.estop.channel] if config.guard.estop else []
    read = _messages([*(sensor.channel for sensor in config.sensors.values()), *estop])
    frames, unknown = _fixed_frames(options, config.loop.rate_hz), []
    for name, layout in CanCodec(options).layouts.items():
        if options.node in layout.message.senders:
            rate = config.loop.rate_hz if name in commanded else None
        else:
            rate = _rate(layout) or (config.loop.rate_hz if name in read else None)
            unknown += [] if rate else [name]
        if rate is not None:
            frames.append(_frame(layout, rate))
    return Traffic(Bus(options.channel, options.bitrate, options.data_bitrate, tuple(frames)), tuple(unknown))


def _messages(channels: Iterable[str]) -> set[str]:
    return {channel.partition(".")[0] for channel in channels}


def _rate(layout: Layout) -> float | None:
    """What is said about a message's rate [1/s]."""
    cycle_ms = layout.message.cycle_time
    return layout.rate_hz or (1000.0 / cycle_ms if cycle_ms else None)


def _frame(layout: Layout, rate_hz: float) -> Frame:
    message = layout.message
    return Frame(layout.name, layout.length, rate_hz, message.is_extended_frame, message.is_fd)


def _fixed_frames(options: CanOptions, tick_hz: float) -> list[Frame]:
    """Frames that never change: each tick, and as heartbeat."""
    timed = [(frame, tick_hz) for frame in options.tick_frames]
    timed += [(frame, 1.0 / frame.period_s) for frame in options.heartbeat]
    return [
        Frame(f"{frame.id:#x}", len(frame.payload), rate, frame.extended, len(frame.payload) > 8)
        for frame, rate in timed
    ]
