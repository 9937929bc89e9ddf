"""From a channel's number to SI, for each sensor kind; plain arithmetic, about a microsecond, every tick.

`trouble` tells why the newest number is no measurement (a broken wire): the guard stops the rig on it.
`saturated` tells that it lies where the sensor clips. How much a sensor lags is the estimators' affair.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from seod.config.linkage_angle import Linkage, make_linkage
from seod.config.sensors import (
    AbsoluteEncoderConfig,
    FvConverterConfig,
    IncrementalEncoderConfig,
    LinearScaleConfig,
)
from seod.config.units import UNITS, to_si

if TYPE_CHECKING:
    from seod.config.sensors import SensorConfig


class Sensor(ABC):
    """One sensor of the rig file, with what it remembers.

    Attributes:
        trouble: Why the newest number is no measurement; "" where it is one.
        saturated: The newest number is one at which the sensor clips.
    """

    def __init__(self, config: SensorConfig) -> None:
        self.low, self.high = config.range or (-math.inf, math.inf)
        self.floor, self.ceiling = config.saturation or (-math.inf, math.inf)
        self.trouble = ""
        self.saturated = False

    def read(self, raw: float) -> float:
        """The value in SI; nan where the number is none that a sound sensor gives."""
        if not self.low <= raw <= self.high:
            return self._unsound(raw)
        self.trouble = ""
        self.saturated = not self.floor < raw < self.ceiling
        return self.convert(raw)

    @abstractmethod
    def convert(self, raw: float) -> float:
        """The value in SI of a number within the range; may set `trouble`."""

    def mark(self, level: float) -> None:
        """The index channel reads `level`, at the time of the next `read`; only some encoders have one."""
        raise TypeError(f"{type(self).__name__} has no index (level {level:g})")

    def _unsound(self, raw: float) -> float:
        if not math.isnan(raw):  # else the guard's word is non_finite
            self.trouble = f"the channel reads {raw:g}, a sound sensor {self.low:g} to {self.high:g}"
        return math.nan


class Linear(Sensor):
    """value = raw * scale + offset, in SI."""

    def __init__(self, config: SensorConfig, scale: float, offset: float) -> None:
        super().__init__(config)
        self.scale, self.offset = scale, offset

    def convert(self, raw: float) -> float:
        """The value in SI."""
        return raw * self.scale + self.offset


class LinkedScale(Linear):
    """A linear scale on a cylinder, seen through its linkage."""

    def __init__(self, config: SensorConfig, scale: float, offset: float, linkage: Linkage) -> None:
        super().__init__(config, scale, offset)
        self.angle = linkage.angle

    def convert(self, raw: float) -> float:
        """The angle [rad]."""
        return self.angle(raw * self.scale + self.offset)


class Encoder(Sensor):
    """A counter that wraps, made continuous: the movement between two samples is the shorter way round.

    So samples may be missing, as long as the shaft moves by less than half the counter's range meanwhile. A
    larger movement looks like a smaller one the other way; that can be seen only where it exceeds
    `largest_step`, and then where the shaft stands is not known.

    Args:
        config: Of either encoder.
        period: Counts after which the counter begins anew.
        per_count: [SI unit].
        offset: Value at count 0 [SI unit].
    """

    def __init__(self, config: SensorConfig, period: int, per_count: float, offset: float) -> None:
        super().__init__(config)
        self.period, self.half = period, period // 2
        self.per_count, self.offset = per_count, offset
        self.largest_step = (period - 1) // 2
        self.last: int | None = None
        self.count = 0

    def convert(self, raw: float) -> float:
        """The value in SI, continuous."""
        now = round(raw)
        if self.last is None:
            self.begin(now)
        else:
            step = (now - self.last + self.half) % self.period - self.half
            self.count += step
            if abs(step) > self.largest_step:
                self.lost(step)
        self.last = now
        return self.count * self.per_count + self.offset

    def begin(self, now: int) -> None:
        """The first number."""

    def lost(self, step: int) -> None:
        """The counter jumped further than the shaft can move."""
        self.trouble = (
            f"the counter jumped by {step} between two samples, at most {self.largest_step} can be a movement"
        )


class IncrementalEncoder(Encoder):
    """Starts at 0 where it stands; an index pulse makes its count 0 at the mark.

    The zero is set by the first pulse only, so that the position never jumps once the axis may move: without
    it, `trouble` forbids to start. It is as good as one sample: the mark passed up to a sample earlier.
    """

    def __init__(self, config: IncrementalEncoderConfig) -> None:
        factor = UNITS[config.unit][1]
        per_count = (
            2.0 * math.pi / config.counts_per_rev
            if config.counts_per_rev
            else factor / (config.counts_per_unit or math.inf)
        )
        super().__init__(config, 1 << config.bits, per_count, config.offset * factor)
        self.largest_step = config.largest_step or self.largest_step
        self.low, self.high = config.range or (-float(self.half), self.period - 1.0)
        self.has_index = config.index is not None
        self.homed = not self.has_index
        self.level = math.nan
        self.rose = False

    def convert(self, raw: float) -> float:
        """The value in SI, continuous."""
        value = super().convert(raw)
        if self.homed:
            return value
        rose, self.rose = self.rose, False
        if rose and not self.trouble:
            self.count, self.homed = 0, True
            return self.offset
        self.trouble = self.trouble or "the index mark has not passed yet: move the actuator over it"
        return value

    def mark(self, level: float) -> None:
        """The index channel reads `level`: where it leaves 0 the mark is here."""
        if self.level == 0.0 and level != 0.0 and not math.isnan(level):
            self.rose = True
        self.level = level

    def lost(self, step: int) -> None:
        """The counter jumped further than the shaft can move: the zero is lost too."""
        super().lost(step)
        self.homed = not self.has_index


class AbsoluteEncoder(Encoder):
    """Starts within half a turn of the offset, then goes on over turns."""

    def __init__(self, config: AbsoluteEncoderConfig) -> None:
        counts = config.counts_per_rev or float(1 << config.bits)
        offset = config.offset * UNITS[config.unit][1]
        super().__init__(config, int(abs(counts)), 2.0 * math.pi / counts, offset)
        self.low, self.high = config.range or (0.0, float((1 << config.bits) - 1))

    def begin(self, now: int) -> None:
        """Of all turns, the one nearest to the offset."""
        self.count = (now + self.half) % self.period - self.half


def make_sensor(config: SensorConfig) -> Sensor:
    """The sensor of a rig file's section."""
    if isinstance(config, IncrementalEncoderConfig):
        return IncrementalEncoder(config)
    if isinstance(config, AbsoluteEncoderConfig):
        return AbsoluteEncoder(config)
    factor = UNITS[config.unit][1]
    if isinstance(config, FvConverterConfig):
        return Linear(config, config.scale * factor, -config.offset_v * config.scale * factor)
    scale, offset = config.scale * factor, to_si(config.offset, config.unit)
    if isinstance(config, LinearScaleConfig) and config.linkage is not None:
        return LinkedScale(config, scale, offset, make_linkage(config.linkage, config.unit))
    return Linear(config, scale, offset)
