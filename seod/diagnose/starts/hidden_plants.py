"""Plants that Eq. 1 does not find behind a cause that hides them.

Behind a valve of limited speed that seldom comes to where it is sent, Eq. 1 alone takes the ramps for a slow
plant, or is no better than a mean. Where dry friction holds the load for most of the time, an oscillation
that begins anew in each segment comes nearer than a plant. No fit comes back from there. So the baseline's
grid is asked again behind such causes of different size. Steps from one size to the next are small:
neighbouring ones leave very different places after many commands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import HOLDS, HOLDS_PLACE, RAMPS, RAMPS_PLACE, searched_causes
from seod.diagnose.record.windows import beginnings, sample
from seod.diagnose.starts.baseline import Fixed, plants_of_grid
from seod.diagnose.tuning.starts import BASELINE, FRICTION_GRID, HIDDEN_PLANTS, RAMP_GRID
from sim.effects import parameter

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array
    from seod.diagnose.starts.baseline import Behind


def hidden_plants(model: Model, cut: Cut, parallel: ParallelMap) -> list[tuple[str, list[Values]]]:
    """Causes that hide plants, and the nearest of the grid behind each, numbers by place, the best first."""
    few = beginnings(sample(cut, BASELINE.windows_s), HIDDEN_PLANTS.rows)
    searched = searched_causes(model.scales) - model.fixed.keys()
    every = {RAMPS: _ramps, HOLDS: _frictions}
    return [
        (name, _nearest(of_size(few), model, few, parallel))
        for name, of_size in every.items()
        if name in searched
    ]


def _ramps(cut: Cut) -> list[Behind]:
    """Valves of different speed."""
    _, limits = parameter(RAMPS_PLACE)
    return [_ramp(speed) for speed in _speeds(cut) if limits.low <= speed <= limits.high]


def _ramp(speed: float) -> Behind:
    """A valve of this speed [V/s]."""
    return lambda _, __: {RAMPS_PLACE: speed}


def _frictions(cut: Cut) -> list[Behind]:
    """Dry friction of different level."""
    volts = max(float(np.std(one.u_of_rows)) for one in _moved(cut))
    return [_friction(part * volts) for part in FRICTION_GRID.levels]


def _friction(volts: float) -> Behind:
    """As large as the pressure under these at the plant's own frequency, where the load stands."""
    return lambda K_L, omega_n: {HOLDS_PLACE: volts * abs(K_L) * omega_n}


def _nearest(every: Iterable[Behind], model: Model, cut: Cut, parallel: ParallelMap) -> list[Values]:
    """The nearest plant behind each, with the numbers of what it is behind; the best first."""
    found = []
    for behind in every:
        fixed = Fixed(model.fixed, model.known_gain, behind=behind)
        nearest = plants_of_grid(cut, model.sees_speed, fixed, parallel)[0]
        numbers = dict(zip(BASE, (nearest.K_L, nearest.omega_n, nearest.zeta), strict=True))
        found.append((nearest.cost, numbers | behind(nearest.K_L, nearest.omega_n)))
    ranked = sorted(found, key=lambda one: one[0])
    return [numbers for _, numbers in ranked[: HIDDEN_PLANTS.kept]]


def _speeds(cut: Cut) -> list[float]:
    """Of a valve [V/s] that loses from half of the command on, in the recording that moves the valve most."""
    half = max(_half_lost(one.t, one.u_of_rows) for one in _moved(cut))
    return [half * RAMP_GRID.step**-k for k in range(RAMP_GRID.speeds)]


def _moved(cut: Cut) -> list[Series]:
    """Recordings that have windows."""
    return [cut.series[k] for k in sorted({k for k, _, _ in cut.windows})]


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
