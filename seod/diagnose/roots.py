"""Plants from which causes are searched: the baseline, and others that it may have missed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.fit import fit, weighted
from seod.diagnose.states import simulated_states

if TYPE_CHECKING:
    from seod.diagnose.begin import Begun
    from seod.diagnose.coordinates import Scales
    from seod.diagnose.fit import Fitted
    from seod.diagnose.screen import Screen

DIFFERENT: Final = 0.2
"""Part of what a plant leaves by which another must differ there, to be a start of its own."""
OVERDAMPED: Final = 2.0
"""Damping from which on one rate of a plant hardly shows."""
DAMPED: Final = 1.5
"""Damping of a plant in its place."""
FAR_OFF: Final = 3.0
"""Squared error of such a plant over the noise's."""
AS_GOOD: Final = 0.1
"""Further mean log error of the one in its place, at most."""


def roots(base: Fitted, begun: Begun, sizes: Scales, screened: Screen) -> list[Fitted]:
    """The baseline, and the other fits where they differ: with sizes by which effects are scaled."""
    model = replace(base.model, scales=sizes)
    found = [less_damped(fit(model, screened.cut, base.x, screened.start(model, base.x)))]
    for one in (begun.near, begun.other):
        other = replace(one.model, scales=sizes)
        start, nothing = screened.start(other, one.x), np.zeros(len(one.x), np.bool_)
        root = less_damped(fit(other, screened.cut, one.x, start, free=nothing))
        if all(_differ(root, each) for each in found):
            found.append(root)
    return found


def less_damped(root: Fitted) -> Fitted:
    """One that is damped less in the place of an overdamped plant far from the noise, if it fits as well.

    Of its two rates samples show the slower one: the other is where fits end by chance, often as fast as can
    be, and slow to simulate. Once an effect accounts for what the damping did, both rates count.
    """
    values = root.model.values(root.x)
    if values["zeta"] < OVERDAMPED or root.excess < FAR_OFF:
        return root
    part = DAMPED / values["zeta"]
    x = root.model.searched(values | {"omega_n": part * values["omega_n"], "zeta": DAMPED})
    free = np.array([each.place != "omega_n" for each in root.model.coordinates])
    found = fit(root.model, root.cut, x, simulated_states(root.model, x, root.cut), free=free)
    less = found.model.values(found.x)["zeta"] < OVERDAMPED
    return found if less and found.cost < root.cost + AS_GOOD else root


def _differ(one: Fitted, other: Fitted) -> bool:
    """Whether two plants simulate the same windows otherwise, by what they leave of them."""
    residuals = [weighted(each.model, each.cut, each.x, each.start)[each.cut.good] for each in (one, other)]
    apart = float(np.linalg.norm(residuals[0] - residuals[1]))
    return apart > DIFFERENT * min(float(np.linalg.norm(each)) for each in residuals)
