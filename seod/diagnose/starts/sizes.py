"""Sizes of things in the recordings, by the baseline's simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting.simulate import POSITION, PRESSURE, VELOCITY, inside
from seod.diagnose.tuning.starts import SIZES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def scales(fitted: Fitted, cut: Cut) -> Scales:
    """Sizes in the recordings, by the baseline's simulation."""
    _, states = inside(fitted.model.kernel_parameters(fitted.x), cut, fitted.start)
    used = [cut.series[k] for k in sorted({k for k, _, _ in cut.windows})]
    speed = states[:, VELOCITY]
    omega_n = fitted.model.values(fitted.x)["omega_n"]
    position = states[:, POSITION]
    places = np.concatenate([_places(one) for one in used])
    return Scales(
        volts=max(float(np.max(np.abs(one.u))) for one in used),
        speed=max(float(np.std(speed)), SIZES.least),
        pressure=max(float(np.quantile(np.abs(states[:, PRESSURE]), SIZES.usual_pressures)), SIZES.least),
        centre=float(np.mean(places)),
        travel=max(float(np.ptp(places)), SIZES.least),
        peak_to_peak=_peak_to_peak(position, speed, cut),
        omega_n=omega_n,
        span_s=max(float(one.t[-1] - one.t[0]) for one in used),
        tick_s=max(one.tick for one in used),
        middle=0.5 * float(np.min(places) + np.max(places)),
        sees_speed=fitted.model.sees_speed,
        step=0.0 if fitted.model.sees_speed else max(one.step for one in used),
        warmer=_range([one.warmth for one in used]) > SIZES.warmer,
        relayed=cut.relayed,
        levels=_levels(used),
        pressed=_range([one.supply for one in used]) > SIZES.pressed,
        force=largest_force(used),
        reading=max(SIZES.least, *(float(np.max(np.abs(one.y[one.good]))) for one in used)),
    )


def largest_force(used: Sequence[Series]) -> float:
    """Standard deviation of a measured disturbance, where it is largest [its unit]; 0 without one."""
    return max(float(np.std(one.force)) if len(one.force) else 0.0 for one in used)


def _levels(used: Sequence[Series]) -> int:
    """How many different commands all recordings have together: relays of two amplitudes have four."""
    together = np.unique(np.concatenate([one.u for one in used]))
    return max(len(together), *(one.levels for one in used))


def _range(channels: Sequence[Array]) -> float:
    """From the least to the largest of a channel in all recordings; 0 where nobody tells it."""
    every = np.concatenate(channels)
    return float(np.ptp(every)) if len(every) else 0.0


def _places(recording: Series) -> Array:
    """Positions of the load, but for the farthest few, as samples show them: their integral, of a speed."""
    places = recording.travelled if recording.sees_speed else recording.y[recording.good]
    return np.clip(places, *np.quantile(places, (SIZES.outliers_of_travel, 1.0 - SIZES.outliers_of_travel)))


def _peak_to_peak(position: Array, speed: Array, cut: Cut) -> float:
    """Median movement from one reversal of the speed to the next; of a speed that has none the travel."""
    moves: list[float] = []
    for rows in cut.slices:
        turns = np.flatnonzero(np.diff(np.sign(speed[rows])))
        moves += np.abs(np.diff(position[rows][turns])).tolist()
    several = len(moves) > SIZES.few_moves
    moved = float(np.median(moves)) if several else float(np.ptp(position[cut.slices[0]]))
    return max(moved, SIZES.least)
