"""Sets with what Eq. 1 does not tell: they explain as much, and causes are searched from there, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, OFFSET, TWINS, begun_from, group
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.starts.baseline import unchanged
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.model import Model


def twins(some: Sequence[Fitted]) -> list[Fitted]:
    """Of each set in which nothing shows a cause of `TWINS` the set with it.

    Its other numbers are unchanged, but beside a load, whose effect depends on where the damping acts: there
    the set is fitted from the cause's last start.
    """
    return [_twin(fitted, name) for fitted in some for name in TWINS if _is_open(fitted.model, name)]


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
