"""Times of the rig file beside how often samples come: `guard.stale`, and the polarity pulse."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from seod.config.model import RigConfig

PERIODS = 2.0
"""Periods that `guard.stale` must span at least: a frame that is a little late, or lost, is no fault."""
PULSE_SAMPLES = 5
"""Samples that a polarity pulse needs at least: `seod.loop.excite.PolarityPulse.ENOUGH`."""
ROUNDING = 1.0 + 1e-9


def watched_channels(config: RigConfig) -> dict[str, str]:
    """The channels whose age the guard watches, by their keys in the rig file."""
    watched = {}
    for name in dict.fromkeys(axis.sensor for axis in config.axes.values()):
        sensor = config.sensors[name]
        watched[f"sensors.{name}"] = sensor.channel
        if sensor.valid is not None:
            watched[f"sensors.{name}.valid"] = sensor.valid.channel
    for place, line in enumerate(config.guard.estops):
        key = f"guard.estop[{place}]" if isinstance(config.guard.estop, list) else "guard.estop"
        watched[key] = line.channel
    return watched


def stale_refusal(config: RigConfig, key: str, period: float) -> Iterator[str]:
    """Why samples that come each `period` [s] are too rare for `guard.stale`; nothing if they are not."""
    stale, least = config.guard.stale, PERIODS * period
    if least <= stale * ROUNDING:
        return
    now = "always stale" if period > stale * ROUNDING else "stale whenever a frame is a little late"
    came = f"{key} comes each {period:g} s, guard.stale is {stale:g} s: {now}"
    yield f"{came}; guard.stale must be at least two periods, {least:g} s"


def short_pulses(config: RigConfig, rate_of: Callable[[str], float]) -> Iterator[str]:
    """Polarity pulses in which too few samples come.

    Args:
        config: The rig.
        rate_of: Samples per second of a channel.
    """
    for name, axis in config.axes.items():
        duration, rate = axis.polarity.duration, rate_of(config.sensors[axis.sensor].channel)
        if axis.polarity.enabled and duration is not None and duration * rate * ROUNDING < PULSE_SAMPLES:
            least = f"{PULSE_SAMPLES / rate:g} s: {PULSE_SAMPLES} samples of the sensor, or left out"
            yield f"axes.{name}.polarity.duration is {duration:g} s, it must be at least {least}"
