"""Sizes of things in the recordings, by which what is searched is scaled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from seod.diagnose.tuning.starts import BASELINE

LARGEST_DAMPING: Final = 20.0
"""Of zeta: the rates of such a plant are 1600 times apart, and of one with more the slower alone shows."""
Values = dict[str, float]
"""By place: `K_L`, `omega_n`, `zeta`, or `effect.parameter`; in starts `*K_L` and the like multiply these."""


@dataclass(frozen=True, slots=True)
class Scales:
    """Sizes of things in the recordings.

    Attributes:
        volts: Largest command, either way [V].
        speed: Standard deviation of the load's speed by the baseline [unit/s].
        pressure: Load pressure by the baseline, seldom exceeded, as acceleration [unit/s^2].
        centre: Mean position [unit].
        travel: Range of positions [unit].
        peak_to_peak: Typical movement between two reversals [unit].
        omega_n: Of the baseline [rad/s].
        span_s: Length of the longest recording [s].
        tick_s: Sampling interval [s].
        middle: Of the travel [unit].
        sees_speed: The sensor sees the speed: where the load is nobody knows.
        step: Of a coarse sensor of positions [unit], 0 where none is seen.
        slowest: Natural frequency that is searched, at least [rad/s]: of less, windows show no oscillation.
        damped: Largest zeta that is searched.
        warmer: The temperature changes.
        relayed: A relay gave the commands: two of them, with another bias four.
        levels: How many different commands there are.
        pressed: The supply pressure changes.
        force: Standard deviation of what is measured of a disturbance [its unit], 0 without such a channel.
        reading: Largest reading, either way [unit of y].
        given: Causes whose size the user tells: they are not searched.
    """

    volts: float
    speed: float
    pressure: float
    centre: float
    travel: float
    peak_to_peak: float
    omega_n: float
    span_s: float
    tick_s: float
    middle: float = 0.0
    sees_speed: bool = False
    step: float = 0.0
    slowest: float = BASELINE.slowest_plant
    damped: float = LARGEST_DAMPING
    warmer: bool = False
    relayed: bool = False
    levels: int = 1000
    pressed: bool = False
    force: float = 0.0
    reading: float = 1.0
    given: frozenset[str] = frozenset()

    @property
    def two_commands(self) -> bool:
        """There are no more than two commands: what depends on their size is another gain then."""
        return self.levels <= 2
