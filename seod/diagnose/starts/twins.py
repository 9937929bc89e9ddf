"""Sets with what Eq. 1 does not tell: they explain as much, and causes are searched from there, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, OFFSET, TWINS, begun_from, group
from seod.diagnose.fitting.initial_states import best_states, simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.starts.baseline import unchanged
from seod.diagnose.tuning.search import REFINE
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap


def twins(some: Sequence[Fitted]) -> list[Fitted]:
    """Of each set in which nothing shows a cause of `TWINS` the set with it.

    Its other numbers are unchanged, but beside a load, whose effect depends on where the damping acts: there
    the set is fitted from the cause's last start.
    """
    return [_twin(fitted, name) for fitted in some for name in TWINS if _is_open(fitted.model, name)]


def beside_all_shown(fitted: Fitted, parallel: ParallelMap, ended: Callable[[], bool]) -> Fitted:
    """The set with each cause of `TWINS` that it shows and lacks, from that one's last start.

    Whether that one gains enough to be told is not asked: as long as it is not known, neither are the others.
    A friction came out as if all damping leaked, far too small, and sure of it.
    """
    for name in TWINS:
        acting = {*fitted.model.names, *fitted.model.fixed}
        if name not in acting and not CAUSES[name].shown_by.isdisjoint(fitted.model.names):
            fitted = _beside(fitted, name, parallel, ended)
    return fitted


def _beside(fitted: Fitted, name: str, parallel: ParallelMap, ended: Callable[[], bool]) -> Fitted:
    model = fitted.model.with_effect(name)
    (*_, last) = group(name, model.scales).starts
    x = model.searched(begun_from(fitted.model.values(fitted.x), last))
    start = best_states(model, x, fitted.cut, fitted.start, simulated_states(model, x, fitted.cut))
    found = fit(model, fitted.cut, x, start, REFINE.fine_steps, parallel, ended=ended)
    return found if found.cost < fitted.cost else fitted


def _is_open(model: Model, name: str) -> bool:
    """Whether a set has neither the cause nor one that shows it."""
    acting = {*model.names, *model.fixed}
    return name not in acting and CAUSES[name].shown_by.isdisjoint(acting)


def _twin(fitted: Fitted, name: str) -> Fitted:
    model, values = _without_load(fitted.model, fitted.model.values(fitted.x))
    model = model.with_effect(name)
    if not any(EFFECTS[each].enters == "load" and each != name for each in model.names):
        return unchanged(model, model.searched(values | TWINS[name]), fitted.cut)
    (*_, last) = group(name, model.scales).starts
    x = model.searched(begun_from(values, last))
    return fit(model, fitted.cut, x, simulated_states(model, x, fitted.cut))


def _without_load(model: Model, values: Values) -> tuple[Model, Values]:
    """With a constant load as the valve's centre that it looks like: where nothing leaks it moves nothing."""
    about = next((each for each in CAUSES[OFFSET].alike if each.distinguished_by), None)
    if about is None or OFFSET not in model.names or about.name in model.names:
        return model, values
    moved = model.without(OFFSET).with_effect(about.name)
    return moved, values | about.same(values, model.scales)
