"""Where a search begins: Eq. 1 from a grid of frequencies and dampings, initial states by its simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.coordinates import Scales
from seod.diagnose.fit import fit, linear_gain
from seod.diagnose.model import baseline_model
from seod.diagnose.simulate import inside
from seod.diagnose.windows import Cut, dominant_hz

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.diagnose.answer import Array
    from seod.diagnose.fit import Each, Fitted
    from seod.diagnose.model import Model
    from seod.diagnose.windows import Series

DAMPINGS: Final = (0.1, 0.4, 1.2)
FREQUENCIES: Final = 12
WIDTH: Final = (0.3, 60.0)
"""Searched frequencies over the dominant one."""
KEPT: Final = 3
"""Cells of the grid from which the search goes on."""


def measured_places(cut: Cut) -> Array:
    """Initial states as far as samples show them: positions, or of speeds their integral; shape (w, 5)."""
    start = np.zeros((len(cut.windows), 5))
    for w, (k, first, last) in enumerate(cut.windows):
        one = cut.series[k]
        rows = first + np.flatnonzero(one.good[first:last])[:1]
        start[w, 2] = _travelled(one)[first] if one.sees_speed else one.y[rows[0]]
    return start


def _travelled(one: Series) -> Array:
    y = np.interp(one.t, one.t[one.good], one.y[one.good])
    return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(one.t))])


def simulated_states(model: Model, x: Array, cut: Cut) -> Array:
    """Initial states with pressure and speed of one simulation of each whole recording, shape (w, 5)."""
    start = measured_places(cut)
    record = model.record(x)
    for k in {of for of, _, _ in cut.windows}:
        whole = Cut(cut.series, ((k, 0, len(cut.series[k].t)),))
        _, states = inside(record, whole, measured_places(whole))
        for w, (of, first, _) in enumerate(cut.windows):
            if of == k:
                start[w, :2] = states[first, :2]
    return np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)


def baseline_starts(
    cut: Cut, tick: float, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]]
) -> list[tuple[Model, Array]]:
    """The best cells of a grid over omega_n and zeta, K_L solved for in each."""
    one = cut.series[cut.windows[0][0]]
    omega = 2.0 * math.pi * dominant_hz(one.t, one.y, one.good)
    frequencies = np.geomspace(WIDTH[0] * omega, min(WIDTH[1] * omega, 0.5 / tick), FREQUENCIES)
    cells = []
    for omega_n in frequencies.tolist():
        for zeta in DAMPINGS:
            model = baseline_model(_rough(cut, omega_n, tick), 1.0, sees_speed, fixed)
            K_L, cost = linear_gain(model, cut, omega_n, zeta, measured_places(cut))
            cells.append((cost, K_L, omega_n, zeta))
    cells.sort()
    return [_cell(cut, tick, sees_speed, fixed, *cell[1:]) for cell in cells[:KEPT]]


def _cell(
    cut: Cut,
    tick: float,
    sees_speed: bool,
    fixed: Mapping[str, Mapping[str, float]],
    K_L: float,
    omega_n: float,
    zeta: float,
) -> tuple[Model, Array]:
    model = baseline_model(_rough(cut, omega_n, tick), math.copysign(1.0, K_L), sees_speed, fixed)
    return model, model.searched({"K_L": K_L, "omega_n": omega_n, "zeta": zeta})


def _rough(cut: Cut, omega_n: float, tick: float) -> Scales:
    """Sizes as far as the samples alone show them."""
    y = cut.gathered("y")[cut.good]
    size = max(float(np.std(y)), 1e-12)
    return Scales(1.0, size * omega_n, size * omega_n**2, 0.0, size, size, omega_n, 1.0, tick)


def baseline(
    cut: Cut, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]], each: Each = map
) -> Fitted:
    """Eq. 1, with the effects that the rig's file has, fitted from several starts."""
    tick = max(one.tick for one in cut.series)
    starts = baseline_starts(cut, tick, sees_speed, fixed)
    found: list[Fitted] = list(each(lambda start: fit(*_from(start, cut), most=20), starts))
    return min(found, key=lambda one: one.cost)


def _from(start: tuple[Model, Array], cut: Cut) -> tuple[Model, Cut, Array, Array]:
    model, x = start
    return model, cut, x, simulated_states(model, x, cut)


def scales(fitted: Fitted, cut: Cut) -> Scales:
    """Sizes in the recordings, by the baseline's simulation."""
    _, states = inside(fitted.model.record(fitted.x), cut, fitted.start)
    used = [cut.series[k] for k in sorted({k for k, _, _ in cut.windows})]
    speed = states[:, 1]
    omega_n = fitted.model.values(fitted.x)["omega_n"]
    position = states[:, 2]
    return Scales(
        volts=max(float(np.max(np.abs(one.u - 0.0))) for one in used),
        speed=float(np.std(speed)),
        pressure=float(np.quantile(np.abs(states[:, 0]), 0.999)),
        centre=float(np.mean(position)),
        travel=float(np.ptp(position)),
        swing=_swing(position, speed, cut),
        omega_n=omega_n,
        span_s=max(float(one.t[-1] - one.t[0]) for one in used),
        tick_s=max(one.tick for one in used),
        warmer=any(len(one.warmth) > 0 and float(np.ptp(one.warmth)) > 0.5 for one in used),
        pressed=any(len(one.supply) > 0 and float(np.ptp(one.supply)) > 0.02 for one in used),
    )


def _swing(position: Array, speed: Array, cut: Cut) -> float:
    """Median movement from one reversal of the speed to the next; of a speed that has none the travel."""
    moves: list[float] = []
    for piece in cut.slices:
        turns = np.flatnonzero(np.diff(np.sign(speed[piece])))
        moves += np.abs(np.diff(position[piece][turns])).tolist()
    return float(np.median(moves)) if len(moves) > 3 else max(float(np.ptp(position[cut.slices[0]])), 1e-12)
