"""Where a search begins: Eq. 1 from a grid of frequencies and dampings, initial states by its simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.coordinates import DAMPED_BY_RELAY, Scales
from seod.diagnose.fit import fit
from seod.diagnose.linear import linear_gain
from seod.diagnose.model import BASE, baseline_model
from seod.diagnose.simulate import inside
from seod.diagnose.states import measured_places, simulated_states, travelled
from seod.diagnose.windows import Cut, dominant_hz, pieces, sample, undivided

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.diagnose.answer import Array
    from seod.diagnose.fit import Each, Fitted
    from seod.diagnose.model import Model
    from seod.diagnose.windows import Series

DAMPINGS: Final = (0.1, 0.4, 1.2, 5.0)
FREQUENCIES: Final = 14
LOWEST: Final = 0.3
"""Searched frequency over the dominant one, at least; half a period is in each window, too."""
KEPT: Final = 3
"""Cells of the grid from which the search goes on."""
GRID_S: Final = 3.0
"""Of windows in which the grid is searched."""
QUICKER: Final = 1.2
DAMPED: Final = 0.3
"""A plant's natural frequency over its limit cycle's, which delay and play make slower; and its damping."""
FEW: Final = 1e-3
"""Part of the samples at each end of the travel that do not count: outliers."""
SHORT_S: Final = 0.25
SHORT_ROWS: Final = 100
"""Least length of the short pieces [s, samples]."""


class Begun(NamedTuple):
    """Eq. 1, with the effects that the rig's file has, on windows.

    Where Eq. 1 alone is far off the other two are nearer to the plant.

    Attributes:
        best: Fitted to them from several starts.
        near: Fitted to short pieces of them with a free load bias, which slow effects hardly touch.
        other: Fitted to whole recordings, whose one initial state makes up for nothing; of those of a relay
            a plant whose own frequency is near the limit cycle's, as every plant's is that a relay drives.
    """

    best: Fitted
    near: Fitted
    other: Fitted


def baseline(cut: Cut, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]], each: Each = map) -> Begun:
    """Search for Eq. 1 from a grid of natural frequencies and damping ratios."""
    few = sample(cut, GRID_S)
    short = pieces(few, max(SHORT_S, SHORT_ROWS * max(one.tick for one in cut.series)))
    cells = _cells(short, sees_speed, fixed, each)[:KEPT]
    local = min(each(lambda cell: _biased(cell, short), cells), key=lambda one: one.cost)
    starts = [local, *_cells(few, sees_speed, fixed, each)[: KEPT - 1]]
    found: list[Fitted] = list(each(lambda cell: _plain(cell, cut), starts))
    near = unchanged(*_begun(local, cut), cut)
    best = min(found, key=lambda one: one.cost)
    if all(one.relayed for one in cut.series):
        return Begun(best, near, _swung(cut, sees_speed, fixed))
    wide = undivided(cut)
    of_whole = _plain(_cells(wide, sees_speed, fixed, each)[0], wide)
    return Begun(best, near, unchanged(of_whole.model, of_whole.x, cut))


def _swung(cut: Cut, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]]) -> Fitted:
    at = cut.series[cut.windows[0][0]]
    omega = QUICKER * 2.0 * math.pi * dominant_hz(at.t, at.y, at.good)
    return unchanged(*_begun(_cell(cut, sees_speed, fixed, (omega, DAMPED)), cut), cut)


def unchanged(model: Model, x: Array, cut: Cut) -> Fitted:
    """A plant fitted elsewhere, on these windows."""
    return fit(model, cut, x, simulated_states(model, x, cut), free=np.zeros(len(x), np.bool_))


class _Cell(NamedTuple):
    """A start: K_L, a load bias, omega_n and zeta, sorted by the cost."""

    cost: float
    K_L: float
    bias: float
    omega_n: float
    zeta: float
    sees_speed: bool
    fixed: Mapping[str, Mapping[str, float]]


def _cells(cut: Cut, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]], each: Each) -> list[_Cell]:
    """A grid over omega_n and zeta, K_L and a load bias solved for in each cell; the best first."""
    one = cut.series[cut.windows[0][0]]
    omega = 2.0 * math.pi * dominant_hz(one.t, one.y, one.good)
    slowest = max(LOWEST * omega, _slowest(cut))
    frequencies = np.geomspace(slowest, max(0.5 / one.tick, 2.0 * slowest), FREQUENCIES)
    points = product(frequencies.tolist(), DAMPINGS)
    return sorted(each(lambda at: _cell(cut, sees_speed, fixed, at), points), key=lambda one: one.cost)


def _cell(
    cut: Cut, sees_speed: bool, fixed: Mapping[str, Mapping[str, float]], at: tuple[float, float]
) -> _Cell:
    """K_L and a load bias solved for at this omega_n and zeta."""
    omega_n, zeta = at
    model = baseline_model(_rough(cut, omega_n), 1.0, sees_speed, fixed)
    x = model.searched({"K_L": 1.0, "omega_n": omega_n, "zeta": zeta})
    K_L, bias, cost = linear_gain(model, cut, x, measured_places(cut))
    return _Cell(cost, K_L, bias, omega_n, zeta, sees_speed, fixed)


def _begun(cell: _Cell, cut: Cut) -> tuple[Model, Array]:
    sign = math.copysign(1.0, cell.K_L)
    model = baseline_model(_rough(cut, cell.omega_n), sign, cell.sees_speed, cell.fixed)
    return model, model.searched({"K_L": cell.K_L, "omega_n": cell.omega_n, "zeta": cell.zeta})


def _rough(cut: Cut, omega_n: float) -> Scales:
    """Sizes as far as the samples alone show them."""
    y = cut.gathered("y")[cut.good]
    size = max(float(np.std(y)), 1e-12)
    tick = max(one.tick for one in cut.series)
    rough = Scales(1.0, size * omega_n, size * omega_n**2, 0.0, size, size, omega_n, 1.0, tick)
    relayed = all(one.relayed for one in cut.series)
    damped = DAMPED_BY_RELAY if relayed else rough.damped
    return replace(rough, slowest=max(rough.slowest, _slowest(cut)), damped=damped, relayed=relayed)


def _slowest(cut: Cut) -> float:
    """Half a period in each window [rad/s]: free initial states make up for less."""
    return math.pi / min(float(cut.series[k].t[b - 1] - cut.series[k].t[a]) for k, a, b in cut.windows)


def _plain(cell: _Cell, cut: Cut) -> Fitted:
    model, x = _begun(cell, cut)
    return fit(model, cut, x, simulated_states(model, x, cut), most=20)


def _biased(cell: _Cell, cut: Cut) -> _Cell:
    """The cell after a fit with a free load bias."""
    plain, x = _begun(cell, cut)
    model = plain.with_effect("load_bias")
    x = model.searched({**plain.values(x), "load_bias.acceleration": cell.bias})
    found = fit(model, cut, x, simulated_states(model, x, cut), most=20)
    values = model.values(found.x)
    K_L, omega_n, zeta = (values[name] for name in BASE)
    return cell._replace(cost=found.cost, K_L=K_L, omega_n=omega_n, zeta=zeta)


def scales(fitted: Fitted, cut: Cut) -> Scales:
    """Sizes in the recordings, by the baseline's simulation."""
    _, states = inside(fitted.model.record(fitted.x), cut, fitted.start)
    used = [cut.series[k] for k in sorted({k for k, _, _ in cut.windows})]
    speed = states[:, 1]
    omega_n = fitted.model.values(fitted.x)["omega_n"]
    position = states[:, 2]
    places = np.concatenate([_places(one) for one in used])
    return Scales(
        volts=max(float(np.max(np.abs(one.u - 0.0))) for one in used),
        speed=float(np.std(speed)),
        pressure=float(np.quantile(np.abs(states[:, 0]), 0.95)),
        centre=float(np.mean(places)),
        travel=float(np.ptp(places)),
        swing=_swing(position, speed, cut),
        omega_n=omega_n,
        span_s=max(float(one.t[-1] - one.t[0]) for one in used),
        tick_s=max(one.tick for one in used),
        step=0.0 if fitted.model.sees_speed else max(one.step for one in used),
        warmer=any(len(one.warmth) > 0 and float(np.ptp(one.warmth)) > 0.5 for one in used),
        relayed=all(len(np.unique(one.u)) <= 2 for one in used),
        pressed=any(len(one.supply) > 0 and float(np.ptp(one.supply)) > 0.02 for one in used),
    )


def _places(one: Series) -> Array:
    """Positions of the load, but for the farthest few, as samples show them: their integral, of a speed."""
    places = travelled(one) if one.sees_speed else one.y[one.good]
    return np.clip(places, *np.quantile(places, (FEW, 1.0 - FEW)))


def _swing(position: Array, speed: Array, cut: Cut) -> float:
    """Median movement from one reversal of the speed to the next; of a speed that has none the travel."""
    moves: list[float] = []
    for piece in cut.slices:
        turns = np.flatnonzero(np.diff(np.sign(speed[piece])))
        moves += np.abs(np.diff(position[piece][turns])).tolist()
    return float(np.median(moves)) if len(moves) > 3 else max(float(np.ptp(position[cut.slices[0]])), 1e-12)
