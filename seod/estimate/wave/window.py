"""What `wave` fits: a window of samples, with the voltages applied and what is known beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from seod.estimate.known import EXACTLY_ZERO

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.known import Known
    from seod.estimate.plant.response import StepwiseVoltage


@dataclass(frozen=True, slots=True)
class Window:
    """What is measured and what is known.

    Attributes:
        t: Sample times [s], rising, shape (n,).
        y: Positions [unit] or speeds [unit/s], shape (n,).
        voltage: What was applied, seen from `t`; it knows which of both `y` is.
        K_L: Gain [unit/s/V].
        delay: Beyond the times of `voltage` [s].
        lag: Time constant of the sensor [s].
        resolution: Step of the sensor, in the unit of `y`; 0: unknown or fine.
    """

    t: Array
    y: Array
    voltage: StepwiseVoltage
    K_L: Known
    delay: Known = EXACTLY_ZERO
    lag: float = 0.0
    resolution: float = 0.0
