"""A valve whose speed is limited: no cause of the list, but under a relay two linear ones pass for it.

Each switch of a relay is as high as the others, so its ramps last equally long: they are a moving mean of
what the plant would do without them. That is linear, and a lag beside a resonance comes near it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from seod.diagnose.cell import DELAYS
from seod.diagnose.fit import fit
from seod.diagnose.left import ADEQUATE
from seod.diagnose.model import BASE, baseline_model
from seod.diagnose.select import as_well
from seod.diagnose.states import simulated_states
from seod.diagnose.stretch import Stretch
from seod.diagnose.windows import Cut, sample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.cell import Cell
    from seod.diagnose.fit import Fitted
    from seod.diagnose.windows import Series

QUICKER: Final = tuple(np.geomspace(0.4, 8.0, 16).tolist())
DAMPINGS: Final = (0.05, 0.15, 0.3, 0.6, 1.2, 4.0)
"""Plants that are tried: omega_n over the limit cycle's frequency, and zeta."""
APART: Final = 0.2
KEPT: Final = 3
"""Logarithm of their ramps' times by which they differ, at least, and how many are fitted."""
COMPARED_S: Final = 6.0
"""Of windows on which it is compared with the set."""
NEAR: Final = 0.03
TRIALS: Final = 10
"""Of the ramps' time how far and how often it is looked for beside where these ended."""
STEPS: Final = 8
"""Of a fit at each."""
STAIRS: Final = 16
"""Steps that stand for a ramp: the plant sees the same but for some 1e-4 of them."""


class Ramped(NamedTuple):
    """Eq. 1 behind a valve that is no faster than `rate` [V/s]."""

    rate: float
    found: Fitted

    @property
    def said(self) -> str:
        """What the user has to know."""
        K_L, omega_n, zeta = (self.found.model.values(self.found.x)[name] for name in BASE)
        return (
            f"a valve no faster than {self.rate:.4g} V/s, which is not on the list, explains the recordings "
            f"as well as the best set of causes does, with fewer numbers (K_L {K_L:.4g}, "
            f"omega_n {omega_n:.4g} rad/s, zeta {zeta:.4g}). Commands of several sizes tell the two apart"
        )


def ramped_instead(chosen: Fitted, sees_speed: bool) -> Ramped | None:
    """Such a plant where it explains a relay's recordings as well as a larger set; None where it does not.

    Args:
        chosen: The set.
        sees_speed: The sensor sees the speed.
    """
    names = chosen.model.names
    relayed = all(one.relayed for one in chosen.cut.series)
    if not relayed or len(names) < 2 or DELAYS.isdisjoint(names) or chosen.model.fixed:
        return None
    own = _on_few(chosen)
    tried = [_refined(cell, own, sees_speed) for cell in _cells(own.cut)]
    best = min(tried, key=_cost, default=None)
    if best is None or best.found.excess > ADEQUATE or best.found.cost > own.cost + as_well(own.cut):
        return None
    return best


def _on_few(chosen: Fitted) -> Fitted:
    """The set as it is on some of its windows."""
    few = sample(chosen.cut, COMPARED_S)
    start = chosen.start[[chosen.cut.windows.index(window) for window in few.windows]]
    return fit(chosen.model, few, chosen.x, start, 0)


def _cells(cut: Cut) -> list[Cell]:
    """Plants with ramps of different time: the best of those that least squares reach from a grid."""
    grid = Stretch(cut, ramped=True)
    if not grid.pieces:
        return []
    first: dict[float, Cell] = {}
    every = [cell for at in product(QUICKER, DAMPINGS) for cell in grid.cells(*at, {})]
    for cell in sorted(every, key=lambda one: one.cost):
        if cell.delay > 0.0:
            first.setdefault(cell.delay, cell)
    kept: list[Cell] = []
    for cell in sorted((grid.settled(cell) for cell in first.values()), key=lambda one: one.cost):
        if all(abs(math.log(cell.delay / one.delay)) > APART for one in kept):
            kept.append(cell)
    return kept[:KEPT]


def _refined(cell: Cell, chosen: Fitted, sees_speed: bool) -> Ramped:
    """That plant fitted to the windows of the set."""
    height = max(float(np.ptp(one.u)) for one in chosen.cut.series)
    model = baseline_model(chosen.model.scales, math.copysign(1.0, cell.K_L), sees_speed, {})
    x = model.searched({"K_L": cell.K_L, "omega_n": cell.omega_n, "zeta": cell.zeta})
    tried: list[Ramped] = []

    def cost(logarithm: float) -> float:
        rate = math.exp(logarithm)
        cut = Cut(with_ramps(chosen.cut.series, rate), chosen.cut.windows)
        begin = min(tried, key=_cost).found.x if tried else x
        tried.append(Ramped(rate, fit(model, cut, begin, simulated_states(model, begin, cut), STEPS)))
        return tried[-1].found.cost

    at = math.log(height / cell.delay)
    cost(at)
    minimize_scalar(cost, bounds=(at - NEAR, at + NEAR), method="bounded", options={"maxiter": TRIALS})
    return min(tried, key=_cost)


def _cost(one: Ramped) -> float:
    return one.found.cost


def with_ramps(every: Sequence[Series], rate: float) -> list[Series]:
    """Recordings whose commands go no faster than that [V/s], in small steps."""
    return [_with_ramps(one, rate) for one in every]


def _with_ramps(one: Series, rate: float) -> Series:
    """The valve begins at 0; it ends a ramp, or turns where the next command comes before."""
    told = np.flatnonzero(np.diff(one.u, prepend=np.nan) != 0.0)
    begins, levels = one.t_u[told], one.u[told]
    part = (np.arange(STAIRS) + 0.5) / STAIRS
    times, values, at = [], [], 0.0
    for begin, end, level in zip(begins, [*begins[1:], math.inf], levels, strict=True):
        lasts = min(abs(level - at) / rate, end - begin)
        change = math.copysign(rate * lasts, level - at)
        times.append(begin + np.append(part - part[0], 1.0) * lasts)
        values.append(at + np.append(part, 1.0) * change)
        at += change
    return replace(one, t_u=np.concatenate(times), u=np.concatenate(values))
