"""Rules about numbers that must fit each other: limits, relay, times against the loop's period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.config.ages import PULSE_SAMPLES
from seod.config.axis import EstimatorConfig, HoldConfig, LimitsConfig, PolarityConfig, RelayConfig
from seod.config.excitation import ExcitationConfig
from seod.config.guard import GuardConfig
from seod.config.linkage_angle import make_linkage
from seod.config.model import LoopConfig
from seod.config.outputs import OutputConfig
from seod.config.sensors import (
    AbsoluteEncoderConfig,
    FvConverterConfig,
    IncrementalEncoderConfig,
    LinearScaleConfig,
)
from seod.config.units import UNITS, parse_quantity, to_si
from seod.config.wiring import command_unit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath
    from seod.config.sensors import SensorConfig


def check_numbers(draft: Draft) -> Iterator[ConfigError]:
    """All numbers that do not fit each other."""
    for axis in draft.names("axes"):
        yield from _voltages(draft, axis)
        yield from _movements(draft, axis)
        yield from _excitation(draft, axis)
        yield from _cutoffs(draft, axis)
        yield from _output_range(draft, axis)
        yield from _sensor_range(draft, axis)
    yield from _guard_times(draft)
    yield from _hang_timeout(draft)


def _voltages(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Nothing that is asked for lies beyond limits.output."""
    limits = draft.section(LimitsConfig, "axes", axis, "limits")
    relay = draft.section(RelayConfig, "axes", axis, "relay")
    hold = draft.section(HoldConfig, "axes", axis, "hold")
    polarity = draft.section(PolarityConfig, "axes", axis, "polarity")
    if limits is None or relay is None:
        return
    most, bias, unit = limits.output, abs(relay.bias), command_unit(draft, axis)
    if relay.e_a + bias > most:
        message = f"e_a + |bias| = {relay.e_a + bias:g} {unit} is above limits.output = {most:g} {unit}"
        right = f"e_a of at most {max(most - bias, 0):g} {unit}"
        yield draft.error(("axes", axis, "relay", "e_a"), message, right)
    if hold and hold.output and hold.output + bias > most:
        message = f"with |bias| must be at most limits.output = {most:g} {unit}"
        yield draft.wrong(("axes", axis, "hold", "output"), message)
    if polarity and polarity.pulse and polarity.pulse + bias > most:
        message = f"with |bias| must be at most limits.output = {most:g} {unit}"
        yield draft.wrong(("axes", axis, "polarity", "pulse"), message)


def _movements(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Each movement that is waited for fits into the one around it."""
    limits = draft.section(LimitsConfig, "axes", axis, "limits")
    relay = draft.section(RelayConfig, "axes", axis, "relay")
    hold = draft.section(HoldConfig, "axes", axis, "hold")
    polarity = draft.section(PolarityConfig, "axes", axis, "polarity")
    if limits is None:
        return
    velocity = draft.text("axes", axis, "mode") == "velocity"
    low, high = limits.travel
    message = "the lower end must come first and lie below the upper end"
    if limits.K_L is not None and limits.K_L[0] >= limits.K_L[1]:
        yield draft.wrong(("axes", axis, "limits", "K_L"), message)
    if low >= high:
        yield draft.wrong(("axes", axis, "limits", "travel"), message)
    elif limits.amplitude > 0.5 * (high - low) and not velocity:
        message = f"must be at most half of limits.travel, {0.5 * (high - low):g}: it could never be reached"
        yield draft.wrong(("axes", axis, "limits", "amplitude"), message)
    below = f"must be below limits.amplitude = {limits.amplitude:g}"
    if relay and relay.hysteresis >= limits.amplitude:
        yield draft.wrong(("axes", axis, "relay", "hysteresis"), below)
    if velocity:  # then these are speeds
        return
    if polarity and polarity.movement >= limits.amplitude:
        yield draft.wrong(("axes", axis, "polarity", "movement"), below)
    if hold and hold.tolerance and hold.tolerance >= limits.amplitude:
        yield draft.wrong(("axes", axis, "hold", "tolerance"), below)


def _excitation(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The excitation allowed has room for what is planned."""
    limits = draft.section(LimitsConfig, "axes", axis, "limits")
    plan = draft.section(ExcitationConfig, "axes", axis, "excitation")
    if limits is None or plan is None:
        return
    path = ("axes", axis, "limits", "excitation")
    if plan.kind == "burst" and limits.excitation <= plan.entry + plan.duration:
        longest = f"{plan.entry:g} s + {plan.duration:g} s"
        yield draft.wrong(path, f"must be longer than one burst (entry + duration = {longest})")
    elif limits.excitation <= plan.entry:
        yield draft.wrong(path, f"must be longer than excitation.entry = {plan.entry:g} s")


def _cutoffs(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """Low-passes lie below half the loop rate, where a sampled one still is one."""
    loop = draft.section(LoopConfig, "loop")
    if loop is None:
        return
    half = 0.5 * loop.rate_hz
    estimator = draft.section(EstimatorConfig, "axes", axis, "estimator")
    if estimator and estimator.lowpass and estimator.lowpass >= half:
        message = f"must be below half the loop rate, {half:g} Hz"
        yield draft.wrong(("axes", axis, "estimator", "lowpass"), message)
    polarity = draft.section(PolarityConfig, "axes", axis, "polarity")
    if polarity and polarity.duration and polarity.duration < PULSE_SAMPLES / loop.rate_hz:
        least = f"{PULSE_SAMPLES / loop.rate_hz:g} s"
        message = (
            f"must be at least {PULSE_SAMPLES} periods of the loop, {least}, to be seen in as many samples"
        )
        yield draft.wrong(("axes", axis, "polarity", "duration"), message)
    if _frequency(draft, ("axes", axis, "filter")) >= half:
        yield draft.wrong(("axes", axis, "filter"), f"must be below half the loop rate, {half:g} Hz")


def _frequency(draft: Draft, path: KeyPath) -> float:
    try:
        return parse_quantity(draft.raw(*path), "frequency")
    except ValueError:  # absent, or told already
        return 0.0


def _output_range(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The channel can carry every voltage up to limits.output."""
    limits = draft.section(LimitsConfig, "axes", axis, "limits")
    output = draft.section(OutputConfig, "outputs", draft.text("axes", axis, "output") or "")
    channel = (draft.channels or {}).get(output.channel) if output else None
    if limits is None or output is None or channel is None:
        return
    swing = abs(limits.output / UNITS[output.unit][1] * output.scale)
    low, high = output.offset - swing, output.offset + swing
    if low < channel.minimum or high > channel.maximum:
        carried = f"which carries only {channel.minimum:g} to {channel.maximum:g}"
        message = f"needs {low:g} to {high:g} of channel {channel.name!r}, {carried}"
        yield draft.error(("axes", axis, "limits", "output"), message, "a lower limit or another scale")


def _sensor_range(draft: Draft, axis: str) -> Iterator[ConfigError]:
    """The channel can carry every position within limits.travel: a limit beyond it would never be seen."""
    limits = draft.section(LimitsConfig, "axes", axis, "limits")
    sensor = draft.sensor(draft.text("axes", axis, "sensor"))
    channel = (draft.channels or {}).get(sensor.channel) if sensor else None
    if limits is None or sensor is None or channel is None:
        return
    low, high = _readable(sensor, channel.minimum, channel.maximum)
    if not low <= limits.travel[0] < limits.travel[1] <= high and limits.travel[0] < limits.travel[1]:
        message = f"channel {channel.name!r} reads only {low:g} to {high:g}: the limit would never be seen"
        yield draft.wrong(("axes", axis, "limits", "travel"), message, "a narrower travel or another scale")


def _readable(sensor: SensorConfig, minimum: float, maximum: float) -> tuple[float, float]:
    """Lowest and highest value [SI] that a sensor can make of a channel's numbers."""
    if isinstance(sensor, IncrementalEncoderConfig | AbsoluteEncoderConfig):
        return -math.inf, math.inf  # goes on where the counter wraps
    offset = -sensor.offset_v * sensor.scale if isinstance(sensor, FvConverterConfig) else sensor.offset
    ends = [to_si(sensor.scale * bound + offset, sensor.unit) for bound in (minimum, maximum)]
    if isinstance(sensor, LinearScaleConfig) and sensor.linkage is not None:
        linkage = make_linkage(sensor.linkage, sensor.unit)
        bounds = linkage.bounds
        ends = [linkage.angle(max(bounds[0], min(bounds[1], end))) for end in ends]
    return min(ends), max(ends)


def _guard_times(draft: Draft) -> Iterator[ConfigError]:
    """What the guard waits for can happen at this loop rate."""
    guard = draft.section(GuardConfig, "guard")
    period = draft.period
    if guard is None or period is None:
        return
    shortest = f"must be at least one period of the loop, {period:g} s"
    for key in ("stale", "frozen", "no_switch", "rig_watchdog", "dead_man"):
        value = getattr(guard, key)
        if value is not None and value < period:
            yield draft.wrong(("guard", key), shortest)
    ticks = math.floor(guard.overruns.window / period * (1 + 1e-9))
    if guard.overruns.count > ticks:
        message = f"{ticks} ticks fit into guard.overruns.window: more overruns can never be counted"
        yield draft.wrong(("guard", "overruns", "count"), message, f"at most {ticks}, or a longer window")


def _hang_timeout(draft: Draft) -> Iterator[ConfigError]:
    loop = draft.section(LoopConfig, "loop")
    if loop and loop.hang_timeout * loop.rate_hz < 2:
        message = f"must be at least two periods of the loop, {2 / loop.rate_hz:g} s"
        yield draft.wrong(("loop", "hang_timeout"), message)
