"""Plants behind a valve of limited speed.

Where such a valve seldom comes to where it is sent, Eq. 1 alone takes its ramps for a slow plant, or is no
better than a mean. No fit comes back from there. So the baseline's grid is asked again behind ramps: from the
speed at which half of the command is lost down to ones that hardly let anything through. Neighbouring speeds
leave very different places after many commands, so steps from one to the next are small.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import RAMPS, RAMPS_PLACE
from seod.diagnose.record.windows import beginnings, sample
from seod.diagnose.starts.baseline import Fixed, plants_of_grid
from seod.diagnose.tuning.starts import BASELINE, RAMP_GRID
from sim.effects import parameter

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def behind_ramps(model: Model, cut: Cut, parallel: ParallelMap) -> list[Values]:
    """The nearest plants of the grid behind ramps of different speed, numbers by place; the best first."""
    few = beginnings(sample(cut, BASELINE.windows_s), RAMP_GRID.rows)
    _, limits = parameter(RAMPS_PLACE)
    found = []
    for speed in _speeds(few):
        if not limits.low <= speed <= limits.high:
            continue
        fixed = Fixed({**model.fixed, RAMPS: {limits.name: speed}}, model.known_gain)
        nearest = plants_of_grid(few, model.sees_speed, fixed, parallel)[0]
        numbers = dict(zip(BASE, (nearest.K_L, nearest.omega_n, nearest.zeta), strict=True))
        found.append((nearest.cost, numbers | {RAMPS_PLACE: speed}))
    ranked = sorted(found, key=lambda one: one[0])
    return [numbers for _, numbers in ranked[: RAMP_GRID.kept]]


def _speeds(cut: Cut) -> list[float]:
    """Of a valve [V/s] that loses from half of the command on, in the recording that moves the valve most."""
    series = [cut.series[k] for k in sorted({k for k, _, _ in cut.windows})]
    half = max(_half_lost(one.t, one.u_of_rows) for one in series)
    return [half * RAMP_GRID.step**-k for k in range(RAMP_GRID.speeds)]


def _half_lost(t: Array, u: Array) -> float:
    """Speed [V/s] at which a valve loses half of the deviation of its commands u, shape (n,)."""
    slow, quick = (float(np.ptp(u) / s) for s in (t[-1] - t[0], np.min(np.diff(t))))
    most = RAMP_GRID.lost * float(np.std(u))
    for _ in range(RAMP_GRID.halvings):
        middle = math.sqrt(slow * quick)
        if float(np.std(_ramped(t, u, middle) - u)) > most:
            slow = middle
        else:
            quick = middle
    return math.sqrt(slow * quick)


def _ramped(t: Array, u: Array, speed: float) -> Array:
    """Where a valve of this speed [V/s] is at each row, shape (n,), from the first command on."""
    place, out = float(u[0]), []
    for command, travel in zip(u.tolist(), (speed * np.diff(t, append=t[-1])).tolist(), strict=True):
        out.append(place)
        place += min(max(command - place, -travel), travel)
    return np.array(out)
