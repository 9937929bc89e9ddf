"""Rules about what is connected to what: names, channels, units, and the simulated plants behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.errors import suggest
from seod.config.model import LoopConfig
from seod.config.outputs import OutputConfig
from seod.config.sensors import ScaledConfig
from seod.config.signals import check_signals
from seod.config.units import BASE, COMMANDS, UNITS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath

LINEAR_KINDS = ("linear", "linear_scale", "fv_converter")
"""Kinds that can stand for each other: a scale and an offset, but for a linkage."""


def check_wiring(draft: Draft) -> Iterator[ConfigError]:
    """All mistakes in what is connected to what."""
    yield from _channels(draft)
    yield from _channel_units(draft)
    for axis in draft.names("axes"):
        yield from _references(draft, axis)
        yield from _plant(draft, axis)
        yield from _simulated_kind(draft, axis)
    yield from _unused_outputs(draft)
    yield from check_signals(draft)
    yield from _simulated_channels(draft)
    yield from _pace(draft)


def _references(draft: Draft, axis: str) -> Iterator[ConfigError]:
    for key, section in (("sensor", "sensors"), ("output", "outputs")):
        name = draft.text("axes", axis, key)
        if name is not None and name not in draft.names(section):
            message = f"there is no {name!r} under {section}"
            yield draft.error(("axes", axis, key), message, suggest(name, draft.names(section), section))


def _channels(draft: Draft) -> Iterator[ConfigError]:
    """Every channel that is named exists and goes the right way."""
    for sensor in draft.names("sensors"):
        yield from _channel(draft, ("sensors", sensor, "channel"), "input")
        yield from _channel(draft, ("sensors", sensor, "index", "channel"), "input")
        yield from _channel(draft, ("sensors", sensor, "valid", "channel"), "input")
    for output in draft.names("outputs"):
        yield from _channel(draft, ("outputs", output, "channel"), "output")
        yield from _channel(draft, ("outputs", output, "enable", "channel"), "output")
        for name in draft.keys("outputs", output, "fixed"):
            yield from named_channel(draft, ("outputs", output, "fixed", name), name, "output")
    lines = draft.raw("guard", "estop")
    places: list[KeyPath] = [("guard", "estop")]
    if isinstance(lines, list):
        places = [("guard", "estop", place) for place in range(len(lines))]
    for path in places:
        yield from _channel(draft, (*path, "channel"), "input")


def _channel(draft: Draft, path: KeyPath, direction: str) -> Iterator[ConfigError]:
    yield from named_channel(draft, path, draft.text(*path), direction)


def named_channel(draft: Draft, path: KeyPath, name: str | None, direction: str) -> Iterator[ConfigError]:
    """The driver has the channel that is named at a path, and it goes the right way."""
    if name is None or draft.channels is None:
        return
    found = draft.channels.get(name)
    there = [channel.name for channel in draft.channels.values() if channel.direction == direction]
    if found is None:
        message = f"the driver has no channel {name!r}"
        yield draft.error(path, message, suggest(name, there, f"{direction} channels"))
    elif found.direction != direction:
        message = f"{name!r} is an {found.direction} of the driver; an {direction} is needed here"
        yield draft.error(path, message, suggest("", there, f"{direction} channels"))


def _channel_units(draft: Draft) -> Iterator[ConfigError]:
    for name in draft.names("sensors"):
        sensor = draft.sensor(name)
        if isinstance(sensor, ScaledConfig):
            yield from _channel_unit(draft, ("sensors", name), sensor)
    for name in draft.names("outputs"):
        yield from _channel_unit(draft, ("outputs", name), draft.section(OutputConfig, "outputs", name))


def _channel_unit(
    draft: Draft, path: KeyPath, config: ScaledConfig | OutputConfig | None
) -> Iterator[ConfigError]:
    """With scale 1 nothing is converted: the unit must be the channel's, where that is known."""
    channel = (draft.channels or {}).get(config.channel) if config else None
    if config is None or channel is None or config.scale != 1:
        return
    if channel.unit in UNITS and channel.unit not in ("", config.unit):
        message = f"channel {channel.name!r} is in {channel.unit}, and scale 1 leaves it so"
        right = f"`unit: {channel.unit}`, or a scale that makes {config.unit} of it"
        yield draft.wrong((*path, "unit"), message, right)


def sensor_dimension(draft: Draft, axis: str) -> str | None:
    """Dimension of an axis' sensor; None if it has no valid one."""
    sensor = draft.sensor(draft.text("axes", axis, "sensor"))
    if sensor is not None:
        return sensor.dimension
    unit = draft.text("sensors", draft.text("axes", axis, "sensor") or "", "unit")
    return UNITS[unit][0] if unit in UNITS else None


def command_unit(draft: Draft, axis: str) -> str:
    """SI unit of what an axis is commanded by; V where that is not told rightly."""
    unit = draft.text("outputs", draft.text("axes", axis, "output") or "", "unit") or "V"
    dimension = UNITS[unit][0] if unit in UNITS else ""
    return BASE[dimension] if dimension in COMMANDS else "V"


def _unused_outputs(draft: Draft) -> Iterator[ConfigError]:
    """An output that no axis uses would never be commanded."""
    axes = draft.names("axes")
    used = {draft.text("axes", axis, "output") for axis in axes}
    if not axes or None in used:
        return
    for output in draft.names("outputs"):
        if output not in used:
            channel = draft.text("outputs", output, "channel") or "..."
            right = (
                f"a signal that enables an amplifier stands in the output of its axis, as "
                f"`enable: {{channel: {channel}, on: 1, off: 0}}`; one that never changes as "
                f"`fixed: {{{channel}: 1}}`"
            )
            yield draft.error(("outputs", output), "no axis uses this output: nothing would be sent", right)


def _plant(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """On a simulated rig an axis' output moves its own sensor."""
    simulation = draft.simulation
    driven = draft.text("outputs", draft.text("axes", axis, "output") or "", "channel")
    measured = draft.text("sensors", draft.text("axes", axis, "sensor") or "", "channel")
    if simulation is None or driven is None or measured is None:
        return
    moved = {plant.input: plant.output for plant in simulation.plants.values()}
    if driven not in moved:
        right = f"a plant under simulation.plants with `input: {driven}` and `output: {measured}`"
        yield draft.error(
            ("axes", axis, "output"), f"no simulated plant is moved by channel {driven!r}", right
        )
    elif moved[driven] != measured:
        message = f"channel {driven!r} moves the plant behind {moved[driven]!r}, not {measured!r}"
        yield draft.error(("axes", axis, "sensor"), message, f"a sensor with `channel: {moved[driven]}`")


def _simulated_kind(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The simulated sensor is of the kind that the rig file believes in."""
    name = draft.text("axes", axis, "sensor")
    sensor = draft.sensor(name)
    plants = draft.simulation.plants if draft.simulation else {}
    for plant_name, plant in plants.items():
        if sensor is None or plant.output != sensor.channel:
            continue
        kind = plant.sensor.kind if plant.sensor else "linear"
        if kind != sensor.kind and not (kind in LINEAR_KINDS and sensor.kind in LINEAR_KINDS):
            message = f"is {sensor.kind}, but the sensor of the simulated plant {plant_name!r} is {kind}"
            right = f"`sensor: {{kind: {sensor.kind}, ...}}` in simulation.plants.{plant_name}"
            yield draft.error(("sensors", name or "", "kind"), message, right)


def _simulated_channels(draft: Draft) -> Iterator[ConfigError]:
    """The simulated rig sits at the other end of channels that the driver has."""
    simulation = draft.simulation
    if simulation is None:
        return
    for name in simulation.plants:
        yield from _channel(draft, ("simulation", "plants", name, "input"), "output")
        yield from _channel(draft, ("simulation", "plants", name, "output"), "input")
        for channel in draft.keys("simulation", "plants", name, "enabled_by"):
            path = ("simulation", "plants", name, "enabled_by", channel)
            yield from named_channel(draft, path, channel, "output")
        yield from _channel(draft, ("simulation", "plants", name, "sensor", "index", "channel"), "input")
    inputs = [c.name for c in (draft.channels or {}).values() if c.direction == "input"]
    for name in simulation.constants:
        if draft.channels is not None and name not in inputs:
            message = f"the driver has no input channel {name!r}"
            yield draft.error(
                ("simulation", "constants", name), message, suggest(name, inputs, "input channels")
            )


def _pace(draft: Draft) -> Iterator[ConfigError]:
    loop = draft.section(LoopConfig, "loop")
    if loop and loop.pace == "sensor" and draft.driver and not draft.driver.push:
        kind = draft.text("driver", "kind")
        message = f"a sensor cannot pace the loop: driver {kind!r} has to be asked for samples"
        yield draft.error(("loop", "pace"), message, "pace: timer")
