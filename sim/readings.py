"""What becomes of a measured value on its way: noise, quantisation, and the defects of records met live."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from random import Random

LATE = 3.0
"""A jittering sample is stamped this many standard deviations back: it is taken before or after its stamp."""
ON_TIME = 1e-9
"""Part of the time for which readings are held, by which one may be early."""


class Readings:
    """Noise, quantisation and defects of one sensor.

    Args:
        random: Where chance comes from; seed it for repeatable readings.
        noise: Standard deviation of white noise [unit, or unit/s].
        effects: `sensor_quantization`, `held_readings`, `outliers`, `missing_samples` and `timing_jitter` are
            looked at.

    Attributes:
        hold: For so long a reading is repeated [s]; 0: each is a new one.
        jitter: Standard deviation of the time at which a sample is taken [s].
        punctual: Each sample comes, and is taken when it is asked for.
    """

    __slots__ = (
        "_begins",
        "_ends",
        "_gap",
        "_number",
        "hold",
        "jitter",
        "noise",
        "outliers",
        "punctual",
        "random",
        "size",
        "step",
    )

    def __init__(self, random: Random, noise: float, effects: Mapping[str, Mapping[str, float]]) -> None:
        self.random = random
        self._gap = False
        self._number = -math.inf
        self.adopt(noise, effects)

    def adopt(self, noise: float, effects: Mapping[str, Mapping[str, float]]) -> None:
        """Be like this from now on."""

        def value(name: str, of: str, null: float = 0.0) -> float:
            return effects.get(name, {}).get(of, null)

        self.noise = noise
        self.step = value("sensor_quantization", "step")
        self.hold = value("held_readings", "time")
        self.outliers, self.size = value("outliers", "rate"), value("outliers", "size")
        self.jitter = value("timing_jitter", "deviation")
        rate = value("missing_samples", "rate")
        odds = rate / max(1e-12, 1.0 - rate)
        length = max(odds, value("missing_samples", "length", 1.0))  # so many cannot be lost in shorter gaps
        self._begins, self._ends = odds / length, 1.0 / length
        self.punctual = not (rate or self.jitter)

    def read(self, value: float) -> float:
        """One reading of the true value [unit, or unit/s]."""
        if self.noise:
            value += self.random.gauss(0.0, self.noise)
        if self.step:
            value = round(value / self.step) * self.step
        if self.outliers and self.random.random() < self.outliers:
            value += self.random.gauss(0.0, self.size)
        return value

    def due(self, t: float) -> bool:
        """Whether a new reading is taken at `t` [s]; else the last is repeated."""
        if not self.hold:
            return True
        number, before = math.floor(t / self.hold + ON_TIME), self._number
        self._number = number
        return number != before

    def missing(self) -> bool:
        """Whether the next sample never comes: a chain of two states, in which as many gaps end as begin."""
        chance = 1.0 - self._ends if self._gap else self._begins
        self._gap = chance > 0.0 and self.random.random() < chance
        return self._gap

    def taken(self, t: float) -> tuple[float, float]:
        """When a sample that is read at `t` [s] was taken, and when its stamp says [s]."""
        if not self.jitter:
            return t, t
        stamp = t - LATE * self.jitter
        return min(t, stamp + self.random.gauss(0.0, self.jitter)), stamp
