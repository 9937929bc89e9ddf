"""Plants from which causes are searched: the baseline, and others that it may have missed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.initial_states import settled_states, simulated_states
from seod.diagnose.fitting.least_squares import fit, weighted
from seod.diagnose.starts.baseline import BaselineFits, unchanged
from seod.diagnose.starts.unsigned import unsigned_root
from seod.diagnose.tuning.starts import SEARCH_ROOTS

if TYPE_CHECKING:
    from seod.diagnose.causes.scales import Scales
    from seod.diagnose.fitting.judged import Judged
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.closed_form import ClosedForm
    from seod.diagnose.record.windows import Cut


def hidden_by_offset(fits: BaselineFits, base: Judged, closed: ClosedForm) -> BaselineFits:
    """With the plant of Eq. 1 beside an offset and a delay, where it leaves much less than the baseline.

    Short segments are spoilt by a delay as the baseline is.
    """
    if not closed.values or closed.nrmse > SEARCH_ROOTS.hidden * base.held.nrmse:
        return fits
    near = fits.near
    model = near.model.turned(closed.values["K_L"])
    x = model.searched(closed.values)
    return fits._replace(closed=unchanged(model, x, near.cut))


def search_roots(base: Fitted, fits: BaselineFits, sizes: Scales, cut: Cut) -> list[Fitted]:
    """The baseline, and the other fits where they differ: with sizes by which effects are scaled.

    Where readings have lost their sign the baseline behind such a sensor is one of them.
    """
    model = replace(base.model, scales=sizes)
    found = [less_damped(fit(model, cut, base.x, settled_states(model, base.x, cut)))]
    for one in filter(None, (fits.closed, fits.near, fits.other)):
        other = replace(one.model, scales=sizes)
        start, nothing = settled_states(other, one.x, cut), np.zeros(len(one.x), np.bool_)
        root = less_damped(fit(other, cut, one.x, start, free=nothing))
        if all(_differ(root, each) for each in found):
            found.append(root)
    unsigned = unsigned_root(base.model, cut, sizes)
    if unsigned is None:
        return found
    root = unchanged(unsigned.model, unsigned.x, cut)
    return [*found, root] if root.cost < found[0].cost - SEARCH_ROOTS.shows_no_sign else found


def less_damped(root: Fitted) -> Fitted:
    """One that is damped less in the place of an overdamped plant far from the noise, if it fits as well.

    Of its two rates samples show the slower one: the other is where fits end by chance, often as fast as can
    be, and slow to simulate. Once an effect accounts for what the damping did, both rates count.
    """
    values = root.model.values(root.x)
    if values["zeta"] < SEARCH_ROOTS.overdamped_above or root.excess < SEARCH_ROOTS.far_from_noise:
        return root
    part = SEARCH_ROOTS.less_damping / values["zeta"]
    x = root.model.searched(values | {"omega_n": part * values["omega_n"], "zeta": SEARCH_ROOTS.less_damping})
    free = np.array([coordinate.place != "omega_n" for coordinate in root.model.coordinates])
    found = fit(root.model, root.cut, x, simulated_states(root.model, x, root.cut), free=free)
    less = found.model.values(found.x)["zeta"] < SEARCH_ROOTS.overdamped_above
    return found if less and found.cost < root.cost + SEARCH_ROOTS.as_good else root


def _differ(fitted: Fitted, other: Fitted) -> bool:
    """Whether two plants simulate the same windows otherwise, by what they leave of them."""
    residuals = [
        weighted(each.model, each.cut, each.x, each.start)[each.cut.good] for each in (fitted, other)
    ]
    apart = float(np.linalg.norm(residuals[0] - residuals[1]))
    return apart > SEARCH_ROOTS.different_plant * min(float(np.linalg.norm(each)) for each in residuals)
