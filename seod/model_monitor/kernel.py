"""The compiled kernel: for rigs with effects. Importing this imports numba: seconds, and not everywhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sim.experiment import plant_record
from sim.state import new_state
from sim.windows import INSIDE, START, follow_windows

if TYPE_CHECKING:
    from seod.model_monitor.window import Array, Segment
    from sim.config import PlantConfig

_STEPS: Final = 6
"""Gauss-Newton steps to the initial state, at most; a linear plant needs one."""
_PARTS: Final = (1.0, 0.4, 0.1)
"""Of a step that are tried."""
_NOTHING: Final = np.empty(0)


class KernelModel:
    """A simulated plant with its effects; pressure, speed and position at the beginning are free.

    Args:
        plant: It.
        slope: Axis units for each of the plant's.
        per_volt: The plant's volts for each of the axis'.
        zero: The plant's volts at 0 V.
        delay: Beyond the plant's own [s].
        supply: Supply pressure over nominal where no row tells it.
        warmth: Temperature above nominal [K].
    """

    name = "kernel"

    def __init__(
        self,
        plant: PlantConfig,
        slope: float = 1.0,
        per_volt: float = 1.0,
        zero: float = 0.0,
        delay: float = 0.0,
        supply: float = 1.0,
        warmth: float = 0.0,
    ) -> None:
        self._record = plant_record(plant)
        self._record["transport_delay_time"] += delay
        self._slope, self._per_volt, self._zero = slope, per_volt, zero
        self._conditions = supply, warmth
        self._columns = [0, 1] if plant.measures_speed else [0, 1, 2]

    def residual(self, segment: Segment) -> Array:
        """See `Model`."""
        y = segment.y / self._slope
        starts = self._guesses(segment, y)
        return min((self._fitted(segment, y, start) for start in starts), key=_power) * self._slope

    def _fitted(self, segment: Segment, y: Array, start: Array) -> Array:
        """What is left after Gauss-Newton steps from a guess, each shortened until it helps."""
        left = y - self._simulated(segment, start)
        for _ in range(_STEPS):
            step, before = self._step(segment, start, left, y), _power(left)
            for part in _PARTS:
                after = y - self._simulated(segment, start + part * step)
                if _power(after) < before:
                    start, left = start + part * step, after
                    break
            if not _power(left) < (1.0 - 1e-3) * before:
                break
        return left

    def _guesses(self, segment: Segment, y: Array) -> list[Array]:
        """By a parabola through the first samples; the pressure also as what moves the load the other way."""
        since = segment.t - segment.t[0]
        first = since < 1.0 / float(self._record["omega_n"][0])
        first[:8] = True
        bend, slope, place = np.polyfit(since[first], y[first], 2).tolist()
        speed, rate = (place, slope) if len(self._columns) == 2 else (slope, 2.0 * bend)
        position = 0.0 if len(self._columns) == 2 else place
        rest = [0.0] * (len(START) - 3)
        return [np.array([pressure, speed, position, *rest]) for pressure in (rate, -rate, 0.0)]

    def _step(self, segment: Segment, start: Array, left: Array, y: Array) -> Array:
        """Of least squares, by forward differences."""
        omega_n = float(self._record["omega_n"][0])
        size = 1e-3 * max(float(np.ptp(y)), 1e-12)
        speed = size if len(self._columns) == 2 else size * omega_n
        sizes = (speed * omega_n, speed, size)
        base = y - left
        columns = []
        for column in self._columns:
            moved = start.copy()
            moved[column] += sizes[column]
            columns.append((self._simulated(segment, moved) - base) / sizes[column])
        found = np.linalg.lstsq(np.stack(columns, axis=1), left, rcond=None)[0]
        step = np.zeros(len(START))
        step[self._columns] = found
        return step

    def _simulated(self, segment: Segment, start: Array) -> Array:
        """Readings from that initial state, shape (n,)."""
        begin = float(min(segment.t[0], segment.t_u[0]))
        valve, load = new_state(self._record, begin), new_state(self._record, begin)
        for state in (valve, load):
            state["supply"], state["warmth"] = self._conditions
        n, volts = len(segment.t), segment.u * self._per_volt + self._zero
        y, window = np.empty(n), (np.zeros(1, np.int64), np.full(1, n, np.int64), start[None, :])
        given = segment.t_u, volts, segment.t, segment.supply, _NOTHING, _NOTHING
        nothing = np.empty((0, len(INSIDE)))
        follow_windows(self._record, valve, load, *given, *window, math.inf, y, nothing)
        return y


def _power(left: Array) -> float:
    """Mean square; infinite where the simulation ran away."""
    power = float(np.mean(left**2))
    return power if np.isfinite(power) else np.inf
