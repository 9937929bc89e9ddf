"""Which input channels the loop reads, in which order, and where in it the slow ones are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.sensors import index_channel

if TYPE_CHECKING:
    from seod.config.model import AxisConfig, RigConfig


def input_channels(config: RigConfig) -> list[str]:
    """Channels that the loop reads: each axis' sensors, then the e-stop line."""
    axes = config.axes.values()
    sensors = [axis.sensor for axis in axes]
    sensors += [
        name for axis in axes for name in (axis.supply_pressure, axis.temperature) if name is not None
    ]
    channels = [config.sensors[name].channel for name in sensors]
    marks = [index_channel(config.sensors[axis.sensor]) for axis in axes]
    channels += [channel for channel in marks if channel is not None]
    if config.guard.estop is not None:
        channels.append(config.guard.estop.channel)
    return list(dict.fromkeys(channels))


def condition_channels(config: RigConfig, axis: AxisConfig, channels: list[str]) -> list[int | None]:
    """Where in `channels` an axis' supply pressure and temperature are; None where it has no such sensor."""
    names = (axis.supply_pressure, axis.temperature)
    return [None if name is None else channels.index(config.sensors[name].channel) for name in names]
