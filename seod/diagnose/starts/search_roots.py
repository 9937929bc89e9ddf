"""Plants from which causes are searched: the baseline, and others that it may have missed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import CAUSES, PULLS, PULLS_PLACES, SOLVED, searched_causes
from seod.diagnose.fitting.initial_states import settled_states, simulated_states
from seod.diagnose.fitting.least_squares import fit, weighted
from seod.diagnose.fitting.work import uncounted
from seod.diagnose.starts.baseline import BaselineFits, unchanged
from seod.diagnose.starts.hidden_plants import hidden_plants
from seod.diagnose.starts.pulled_back import pulled_back
from seod.diagnose.starts.sizes import scales
from seod.diagnose.starts.unsigned import unsigned_root
from seod.diagnose.tuning.starts import EFFECT_STARTS, SEARCH_ROOTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.fitting.judged import Judged
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
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


class Roots(NamedTuple):
    """Where a search begins.

    Attributes:
        baseline: With sizes by which effects are scaled.
        begin: What it begins from: the baseline and other plants, or sets with one effect.
    """

    baseline: Fitted
    begin: list[Fitted]


def search_roots(
    base: Fitted, fits: BaselineFits, sizes: Scales, cut: Cut, parallel: ParallelMap = map
) -> Roots:
    """The baseline and the other fits where they differ, or Eq. 1 with a load, if that hid the plant.

    Where something pulls the load back, or the valve hardly comes to where it is sent, all sizes are those of
    that plant: Eq. 1 is none. Where readings have lost their sign the baseline behind such a sensor is one of
    them.
    """
    roots = _roots(base, fits, sizes, cut)
    hidden = _hidden(roots, parallel)
    if hidden is None:
        return _also_unsigned(roots, cut)
    sizes = replace(scales(hidden, cut), given=sizes.given)
    roots = _also_unsigned(_roots(base, fits, sizes, cut), cut)
    (name,) = hidden.model.names
    hidden = _as_start(roots.baseline.model, name, hidden.model.values(hidden.x), cut)
    return roots._replace(begin=[hidden, *roots.begin])


def _roots(base: Fitted, fits: BaselineFits, sizes: Scales, cut: Cut) -> Roots:
    """Those of Eq. 1, with a load or without."""
    model = replace(base.model, scales=sizes)
    found = [fit(model, cut, base.x, settled_states(model, base.x, cut))]
    for one in filter(None, (fits.closed, fits.near, fits.other, fits.damped)):
        other = replace(one.model, scales=sizes)
        start, nothing = settled_states(other, one.x, cut), np.zeros(len(one.x), np.bool_)
        root = fit(other, cut, one.x, start, free=nothing)
        if all(_differ(root, each) for each in found):
            found.append(root)
    return Roots(found[0], _with_load(found) or found)


def _also_unsigned(roots: Roots, cut: Cut) -> Roots:
    """And the baseline behind a sensor without sign, where readings have lost it."""
    unsigned = unsigned_root(roots.baseline.model, cut, roots.baseline.model.scales)
    if unsigned is None:
        return roots
    root = unchanged(unsigned.model, unsigned.x, cut)
    hidden = root.cost < roots.baseline.cost - SEARCH_ROOTS.shows_no_sign
    return roots._replace(begin=[*roots.begin, root]) if hidden else roots


def also_from(roots: Roots, known: Fitted, cut: Cut) -> Roots:
    """With a set that is known of the same recordings, at the sizes by which effects are scaled here."""
    values = known.model.values(known.x)
    model = roots.baseline.model.turned(values["K_L"])
    for name in known.model.names:
        model = model.with_effect(name)
    model = replace(model, moved=known.model.moved)
    x = model.searched(values)
    return roots._replace(begin=[*roots.begin, fit(model, cut, x, simulated_states(model, x, cut))])


def _with_load(found: Sequence[Fitted]) -> list[Fitted]:
    """Eq. 1 with an offset or a measured load, where it leaves so much less that those plants are none.

    A position runs away with any offset, unequal gains too: whatever Eq. 1 makes of that, effects that are
    tried beside it gain nothing, and take what the search may take.
    """
    loads = [each for each in SOLVED if each in searched_causes(found[0].model.scales)]
    if not loads or found[0].excess < SEARCH_ROOTS.far_from_noise:
        return []
    loaded = min((_fitted_with(each, root) for each in loads for root in found), key=lambda one: one.cost)
    if not loaded.cost < min(one.cost for one in found) - SEARCH_ROOTS.load_saves:
        return []
    (name,) = loaded.model.names
    oscillating = _oscillating(found, name) if _zeta(loaded) > SEARCH_ROOTS.over_damped else []
    return [loaded, *oscillating, *(_about_its_null(loaded) if _off_zero(loaded.cut) else ())]


def _hidden(roots: Roots, parallel: ParallelMap) -> Fitted | None:
    """A plant with what hides it from Eq. 1, if that leaves so much less that Eq. 1, loaded or not, is none.

    Eq. 1 of a position that comes to rest where u stands still is as far from it as can be.
    """
    model, cut = roots.baseline.model, roots.baseline.cut
    if roots.baseline.excess < SEARCH_ROOTS.far_from_noise:
        return None
    every: list[Fitted] = []
    if PULLS not in model.fixed:
        places = (*BASE, *PULLS_PLACES)
        plants = [dict(zip(places, one, strict=True)) for one in pulled_back(cut)]
        starts = sorted(_starts(model, PULLS, plants, cut), key=lambda one: one.cost)
        every += _fitted(starts[: SEARCH_ROOTS.pulled_back])
    if not cut.relayed:  # which has a grid of its own
        behind = uncounted(lambda: _fitted(_behind_causes(model, cut, parallel)))
        every += [one for one in behind if is_another_plant(one, roots.baseline)]
    best = min(every, key=lambda one: one.cost, default=None)
    least = min(one.cost for one in roots.begin) - SEARCH_ROOTS.load_saves
    return best if best is not None and best.cost < least else None


def _behind_causes(model: Model, cut: Cut, parallel: ParallelMap) -> list[Fitted]:
    """The nearest plants of the grid, each with the cause that it is behind."""
    every = hidden_plants(model, cut, parallel)
    return [start for name, plants in every for start in _starts(model, name, plants, cut)]


def _starts(model: Model, name: str, plants: Sequence[Values], cut: Cut) -> list[Fitted]:
    """Plants with a cause, within limits of their own."""

    def limited(omega_n: float) -> Model:
        return replace(model, scales=replace(model.scales, omega_n=omega_n))

    return [_as_start(limited(one["omega_n"]), name, one, cut) for one in plants]


def _fitted(starts: Sequence[Fitted]) -> list[Fitted]:
    return [fit(one.model, one.cut, one.x, one.start) for one in starts]


def is_another_plant(fitted: Fitted, other: Fitted) -> bool:
    """Whether a fit has another plant: else the other is near enough to begin from."""
    own, others = fitted.model.values(fitted.x), other.model.values(other.x)
    apart = max(abs(math.log(own[of] / others[of])) for of in ("omega_n", "zeta"))
    return apart > EFFECT_STARTS.other_plant


def _as_start(model: Model, name: str, values: Mapping[str, float], cut: Cut) -> Fitted:
    own = model.turned(values["K_L"]).with_effect(name)
    return unchanged(own, own.searched(values), cut)


def _oscillating(found: Sequence[Fitted], name: str) -> list[Fitted]:
    """The plant nearest to the recordings that oscillates, as it is, with a load.

    What bends the flow at small openings damps Eq. 1 beside a load, from where no fit comes back.
    """
    roots = [root for root in found if SEARCH_ROOTS.hardly_damped < _zeta(root) < 1.0]
    every = [_fitted_with(name, root, load_alone=True) for root in roots]
    return [min(every, key=lambda one: one.cost)] if every else []


def _zeta(fitted: Fitted) -> float:
    return fitted.model.values(fitted.x)["zeta"]


def _off_zero(cut: Cut) -> bool:
    """Whether commands are farther from 0 than from their mean: of a valve that is closed at 50 %."""
    return any(abs(float(np.mean(one.u))) > float(np.std(one.u)) for one in cut.series)


def _about_its_null(loaded: Fitted) -> list[Fitted]:
    """The load as what it may be as well while the flow is straight: where that is 0, it may bend."""
    model, cut = loaded.model, loaded.cut
    (name,), values, out = model.names, model.values(loaded.x), []
    for other in (each for each in CAUSES[name].alike if each.distinguished_by):
        about = model.without(name).with_effect(other.name)
        x = about.searched(values | other.same(values, model.scales))
        out.append(fit(about, cut, x, simulated_states(about, x, cut)))
    return out


def _fitted_with(name: str, root: Fitted, *, load_alone: bool = False) -> Fitted:
    model, values = root.model.with_effect(name), root.model.values(root.x)
    x = model.searched({each.place: 0.0 for each in model.coordinates} | values)
    free = np.array([not load_alone or each.place not in values for each in model.coordinates])
    return fit(model, root.cut, x, simulated_states(model, x, root.cut), free=free)


def _differ(fitted: Fitted, other: Fitted) -> bool:
    """Whether two plants simulate the same windows otherwise, by what they leave of them."""
    residuals = [
        weighted(each.model, each.cut, each.x, each.start)[each.cut.good] for each in (fitted, other)
    ]
    apart = float(np.linalg.norm(residuals[0] - residuals[1]))
    return apart > SEARCH_ROOTS.different_plant * min(float(np.linalg.norm(each)) for each in residuals)
