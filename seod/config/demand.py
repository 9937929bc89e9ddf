"""What a rig file asks of its driver's connection, for `seod check`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.connection import Demand
from seod.config.channels import enables, fixed_values, input_channels, neutral_values, output_channels
from seod.config.units import UNITS

if TYPE_CHECKING:
    from seod.config.model import RigConfig


def demand_of(config: RigConfig) -> Demand:
    """Channels, rate and neutral values; sensors that no axis uses are asked for, too."""
    inputs = [*(sensor.channel for sensor in config.sensors.values()), *input_channels(config)]
    return Demand(
        tick_hz=config.loop.rate_hz,
        inputs=list(dict.fromkeys(inputs)),
        outputs=output_channels(config),
        neutral=neutral_values(config),
        sources=_sources(config),
        rig_watchdog=config.guard.rig_watchdog,
    )


def _sources(config: RigConfig) -> dict[str, str]:
    """What sets each output channel, in words with the channel's numbers."""
    sources = {channel: f"{value:g} (fixed)" for channel, value in fixed_values(config).items()}
    users: dict[str, list[str]] = {channel: [] for channel in enables(config)}
    for name, axis in config.axes.items():
        output = config.outputs[axis.output]
        swing = abs(axis.limits.output / UNITS[output.unit][1] * output.scale)
        low, high = output.offset - swing, output.offset + swing
        sources[output.channel] = f"axis {name}: {low:g} to {high:g}, neutral {output.offset:g}"
        if output.enable is not None:
            users[output.enable.channel].append(name)
    for channel, enable in enables(config).items():
        moving = f"{enable.on:g} while {' or '.join(users[channel])} moves, else {enable.off:g} (enable)"
        always = f"{enable.on:g} always (enable with drop_on_fault: false)"
        sources[channel] = moving if enable.drop_on_fault else always
    return sources
