"""A relay of two phases on a plant that is known, computed ahead: what the axis will do, without noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.linalg import expm

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.plant.free_motion import Dynamics

STEPS: Final = 100
"""In a period of omega_n, where the loop's ticks are not coarser."""
SETTLING: Final = 3
"""Cycles in which the first phase comes to its limit cycle."""
LONGEST: Final = 12.0
"""Periods of omega_n that a cycle may last on average, longer by 3 zeta; beyond, nothing oscillates."""


class Drive(NamedTuple):
    """The relay.

    Attributes:
        e_a: Amplitude [V].
        hysteresis: Half-width [axis unit].
        load: What takes the place of a load: mean voltage that is lost [V].
        tick: Of the loop [s].
    """

    e_a: float
    hysteresis: float
    load: float
    tick: float


@dataclass(frozen=True, slots=True)
class Run:
    """One alternation: cycles of the first phase, of the second, and of the first again.

    Attributes:
        period: Of the first phase [s].
        step: Between the samples [s].
        y: Position [axis unit], shape (n,).
        v: Speed [axis unit/s], likewise.
        u: Voltage that leaves [V], likewise.
    """

    period: float
    step: float
    y: Array
    v: Array
    u: Array

    @property
    def swing(self) -> float:
        """Half the peak-to-peak movement [axis unit]."""
        return 0.5 * float(np.ptp(self.y))


def run(plant: Dynamics, gain: float, drive: Drive, late: float, cycles: int) -> Run | None:
    """Simulate it; None where it does not oscillate.

    Args:
        plant: omega_n, zeta and delay.
        gain: K_L [axis unit/s/V].
        drive: The relay.
        late: By which the switches of the second phase come late [s].
        cycles: Of each phase.
    """
    step = max(drive.tick, 2.0 * math.pi / (STEPS * plant.omega_n))
    a = np.eye(4, k=1)
    a[2, 1:] = -(plant.omega_n**2), -2.0 * plant.zeta * plant.omega_n, gain * plant.omega_n**2
    relay = Relay(drive.e_a, drive.hysteresis, [0.0] * (SETTLING + cycles) + [late] * cycles + [0.0] * cycles)
    cycle = LONGEST * (1.0 + 3.0 * plant.zeta) * 2.0 * math.pi / plant.omega_n
    most = int(len(relay.lateness) * cycle / step)
    rows = _simulated(expm(a * step)[:3].tolist(), relay, drive.load, (step, max(plant.delay, 0.0)), most)
    if not relay.is_over:
        return None
    begin, end = relay.ups[SETTLING], relay.ups[SETTLING + cycles]
    y, v, u = np.array(rows[round(begin / step) :]).T
    return Run((end - begin) / cycles, step, y, v, u)


class Relay:
    """What looks at the position and switches, late by another time in each cycle.

    Args:
        e_a: Amplitude [V].
        hysteresis: Half-width [axis unit].
        lateness: For each cycle [s].
    """

    def __init__(self, e_a: float, hysteresis: float, lateness: list[float]) -> None:
        self.e_a, self.hysteresis, self.lateness = e_a, hysteresis, lateness
        self.wanted = self.u = e_a
        self.due = 0.0
        self.ups: list[float] = []
        """When each cycle began [s]."""

    @property
    def is_over(self) -> bool:
        """Whether all cycles are."""
        return len(self.ups) > len(self.lateness)

    def look(self, t: float, y: float) -> float:
        """The voltage at time `t` [s], where the position is `y` from the set point."""
        e_a, hysteresis = self.e_a, self.hysteresis
        wanted = -e_a if y > hysteresis else e_a if y < -hysteresis else self.wanted
        if wanted != self.wanted:
            self.wanted = wanted
            if wanted > 0.0:
                self.ups.append(t)
            late = self.lateness[min(max(len(self.ups) - 1, 0), len(self.lateness) - 1)]
            self.due = t + late
        if t >= self.due:
            self.u = self.wanted
        return self.u


def _simulated(
    moves: list[list[float]], relay: Relay, load: float, times: tuple[float, float], most: int
) -> list[tuple[float, float, float]]:
    """Position, speed and voltage at each step until the relay's cycles are over, `most` at most."""
    step, delay = times
    (_, xv, xa, xu), (_, vv, va, vu), (_, av, aa, au) = moves
    waiting = [0.0] * round(delay / step)
    y = v = a = 0.0
    rows = []
    for k in range(most):
        u = relay.look(k * step, y)
        rows.append((y, v, u))
        if relay.is_over:
            break
        waiting.append(u)
        drive = waiting.pop(0) - load
        y, v, a = y + xv * v + xa * a + xu * drive, vv * v + va * a + vu * drive, av * v + aa * a + au * drive
    return rows
