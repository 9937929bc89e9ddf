"""Which channels the loop reads and writes, and in which order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.sensors import index_channel

if TYPE_CHECKING:
    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig
    from seod.config.outputs import EnableConfig, OutputConfig


def input_channels(config: RigConfig) -> list[str]:
    """Channels that the loop reads: each axis' sensors, what tells that these are valid, the e-stop lines."""
    axes = config.axes.values()
    sensors = [config.sensors[name] for axis in axes for name in sensor_names(axis)]
    channels = [sensor.channel for sensor in sensors]
    marks = [index_channel(config.sensors[axis.sensor]) for axis in axes]
    channels += [channel for channel in marks if channel is not None]
    channels += [sensor.valid.channel for sensor in sensors if sensor.valid is not None]
    channels += [line.channel for line in config.guard.estops]
    return list(dict.fromkeys(channels))


def sensor_names(axis: AxisConfig) -> list[str]:
    """The sensors of an axis: its own first, then those of supply pressure and temperature that it has."""
    return [name for name in (axis.sensor, axis.supply_pressure, axis.temperature) if name is not None]


def condition_channels(config: RigConfig, axis: AxisConfig, channels: list[str]) -> list[int | None]:
    """Where in `channels` an axis' supply pressure and temperature are; None where it has no such sensor."""
    names = (axis.supply_pressure, axis.temperature)
    return [None if name is None else channels.index(config.sensors[name].channel) for name in names]


def axis_outputs(config: RigConfig) -> list[OutputConfig]:
    """The output of each axis."""
    return [config.outputs[axis.output] for axis in config.axes.values()]


def enables(config: RigConfig) -> dict[str, EnableConfig]:
    """The enable signals by their channels; outputs may share one."""
    return {o.enable.channel: o.enable for o in axis_outputs(config) if o.enable is not None}


def fixed_values(config: RigConfig) -> dict[str, float]:
    """The channels that never change, with their numbers."""
    return {channel: value for output in axis_outputs(config) for channel, value in output.fixed.items()}


def output_channels(config: RigConfig) -> list[str]:
    """Channels that the loop writes: each axis' command, the enable signals, then what never changes."""
    return [*(output.channel for output in axis_outputs(config)), *enables(config), *fixed_values(config)]


def neutral_values(config: RigConfig) -> list[float]:
    """The number of each output channel at which nothing moves."""
    return [
        *(output.offset for output in axis_outputs(config)),
        *(enable.neutral for enable in enables(config).values()),
        *fixed_values(config).values(),
    ]
