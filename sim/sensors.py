"""The simulated side of each sensor kind: from the plant's motion to the number that its channel carries."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from typing import TYPE_CHECKING

from sim.sensor_config import (
    AbsoluteEncoderTruth,
    FvConverterTruth,
    IncrementalEncoderTruth,
    LinearTruth,
)

if TYPE_CHECKING:
    from sim.sensor_config import AdcTruth, AnySensor, CrankTruth, LinearScaleTruth, TableTruth


class Lag:
    """First-order low-pass of a signal known at some times, straight between them.

    Args:
        tau: Time constant [s].
    """

    def __init__(self, tau: float) -> None:
        self.tau = tau
        self.t = math.nan
        self.x = self.y = 0.0

    def update(self, t: float, x: float) -> float:
        """The output at `t` [s], where the input is `x`; exact for an input that is straight in between."""
        if math.isnan(self.t):
            self.t, self.x, self.y = t, x, x
        elif t > self.t:
            dt = t - self.t
            behind = (x - self.x) / dt * self.tau
            self.y = x - behind + (self.y - self.x + behind) * math.exp(-dt / self.tau)
            self.t, self.x = t, x
        return self.y


class Perfect:
    """The channel carries the position itself."""

    def sense(self, t: float, position: float, velocity: float) -> float:  # noqa: ARG002 - a sensor's form
        """What is measured at `t` [s] of a position [rad or m] and a speed [per s], in SI, before noise."""
        return position

    def number(self, value: float) -> float:
        """What the channel carries for a measured value in SI [channel's unit]."""
        return value

    def mark(self, position: float) -> float:  # noqa: ARG002 - a sensor's form
        """What the index channel carries at a position [rad]; for encoders that have one."""
        return 0.0


class PerfectSpeed(Perfect):
    """The channel carries the speed itself."""

    def sense(self, t: float, position: float, velocity: float) -> float:  # noqa: ARG002 - a sensor's form
        """The speed [rad/s or m/s]."""
        return velocity


class Kind(Perfect, ABC):
    """One kind, with its lag."""

    def __init__(self, config: AnySensor) -> None:
        self.lag = Lag(config.lag) if config.lag else None

    def sense(self, t: float, position: float, velocity: float) -> float:
        """What is measured at `t` [s], in SI, lag included, before noise."""
        value = self.measured(position, velocity)
        return value if self.lag is None else self.lag.update(t, value)

    def measured(self, position: float, velocity: float) -> float:  # noqa: ARG002 - speed for F/V converters
        """What would be measured without lag, in SI, of a position [rad or m] and a speed [per s]."""
        return position

    @abstractmethod
    def number(self, value: float) -> float:
        """What the channel carries for a measured value in SI [channel's unit]."""


class LinearSensor(Kind):
    """A scale and an offset."""

    def __init__(self, config: LinearTruth) -> None:
        super().__init__(config)
        self.scale, self.offset = config.scale, config.offset

    def number(self, value: float) -> float:
        """The value [rad or m], scaled and offset [channel's unit]."""
        return value * self.scale + self.offset


class IncrementalEncoder(Kind):
    """A counter that wraps, and an index mark once a turn."""

    def __init__(self, config: IncrementalEncoderTruth) -> None:
        super().__init__(config)
        self.counts, self.start, self.period = config.counts_per_unit, config.start, 1 << config.bits
        self.at = config.index.position if config.index else 0.0
        self.turn: int | None = None

    def number(self, value: float) -> float:
        """The counter [counts] at a position [rad or m]."""
        return float((self.start + math.floor(value * self.counts)) % self.period)

    def mark(self, position: float) -> float:
        """1 where the mark passed since the last reading."""
        turn = math.floor((position - self.at) / (2.0 * math.pi))
        passed = self.turn is not None and turn != self.turn
        self.turn = turn
        return float(passed)


class AbsoluteEncoder(Kind):
    """Where in the turn the shaft stands."""

    def __init__(self, config: AbsoluteEncoderTruth) -> None:
        super().__init__(config)
        self.counts, self.zero, self.sign = config.counts_per_rev, config.zero, config.sign

    def number(self, value: float) -> float:
        """The code [counts] at an angle [rad]."""
        turns = self.sign * (value - self.zero) / (2.0 * math.pi)
        return float(math.floor(turns * self.counts) % self.counts)


class FvConverter(Kind):
    """Speed as a voltage that ripples with the pulses it is made of."""

    def __init__(self, config: FvConverterTruth) -> None:
        super().__init__(config)
        self.config = config
        self.wave = 2.0 * math.pi * config.ripples_per_unit

    def measured(self, position: float, velocity: float) -> float:
        """The speed with its ripple [rad/s or m/s]."""
        return velocity * (1.0 + self.config.ripple * math.cos(self.wave * position))

    def number(self, value: float) -> float:
        """The voltage [V] for a speed [rad/s or m/s], clipped."""
        low, high = self.config.clip
        return counted(
            self.config.adc, max(low, min(high, value * self.config.volts_per_unit + self.config.offset_v))
        )


class LinearScale(Kind):
    """The cylinder's stroke behind a linkage."""

    def __init__(self, config: LinearScaleTruth) -> None:
        super().__init__(config)
        self.config = config

    def number(self, value: float) -> float:
        """The stroke that makes this angle [rad], scaled [channel's unit]."""
        config = self.config
        if config.crank is not None:
            value = crank_stroke(config.crank, value)
        elif config.table is not None:
            value = table_stroke(config.table, value)
        return counted(config.adc, value * config.scale + config.offset)


def counted(adc: AdcTruth | None, number: float) -> float:
    """A number [channel's unit] as an A/D converter tells it; as it is where there is none."""
    if adc is None:
        return number
    low, high = adc.range
    step = (high - low) / ((1 << adc.bits) - 1)
    return low + step * round((max(low, min(high, number)) - low) / step)


def crank_stroke(crank: CrankTruth, angle: float) -> float:
    """Stroke [m] at an angle [rad]: the distance from the fixed pivot to the end of the crank, less the rod.

    The crank's direction at angle 0 follows from the triangle of base, arm and rod + zero.
    """
    at_zero = math.acos(
        (crank.base**2 + crank.arm**2 - (crank.rod + crank.zero) ** 2) / (2.0 * crank.base * crank.arm)
    )
    direction = at_zero + crank.sign * angle
    x, y = crank.arm * math.cos(direction), crank.arm * math.sin(direction)
    return math.hypot(x - crank.base, y) - crank.rod


def table_stroke(table: TableTruth, angle: float) -> float:
    """Stroke [m] at an angle [rad], by straight lines."""
    k = min(max(bisect_right(table.angle, angle) - 1, 0), len(table.angle) - 2)
    part = (angle - table.angle[k]) / (table.angle[k + 1] - table.angle[k])
    return table.stroke[k] + part * (table.stroke[k + 1] - table.stroke[k])


def make_sensor(config: AnySensor | None, speed: bool = False) -> Perfect:
    """The sensor of a plant's section; where it has none, one of its position, or of its `speed`."""
    if config is None:
        return PerfectSpeed() if speed else Perfect()
    if isinstance(config, LinearTruth):
        return LinearSensor(config)
    if isinstance(config, IncrementalEncoderTruth):
        return IncrementalEncoder(config)
    if isinstance(config, AbsoluteEncoderTruth):
        return AbsoluteEncoder(config)
    if isinstance(config, FvConverterTruth):
        return FvConverter(config)
    return LinearScale(config)
