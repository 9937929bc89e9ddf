"""Which sets of effects: a beam of the best, grown by one effect at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, SOLVED, plain_forms
from seod.diagnose.search.noise_alone import noise_alone
from seod.diagnose.search.race import elsewhere, extended
from seod.diagnose.starts.twins import twins
from seod.diagnose.tuning.search import BEAM

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.search.screen import Screen
    from seod.diagnose.starts.search_roots import Roots


def least_gain(cut: Cut) -> float:
    """What an effect must save of the mean log squared error.

    Of coarse sensors few samples make up what is left.
    """
    return (
        BEAM.least_gain_coarse
        if any(cut.series[k].slack > 0.0 for k, _, _ in cut.windows)
        else BEAM.least_gain
    )


def as_well(cut: Cut) -> float:
    """Mean log squared error up to which another set explains recordings as well."""
    return BEAM.as_well_part * least_gain(cut)


@dataclass
class Grown:
    """Sets of effects that were fitted.

    Attributes:
        best: The best first, the baseline last.
        tried: All of them by their effects.
    """

    best: list[Fitted]
    tried: dict[frozenset[str], Fitted] = field(default_factory=dict)

    @property
    def baseline(self) -> Fitted:
        """Without any effect."""
        return self.best[-1]

    def alone(self) -> dict[str, Fitted]:
        """Of each cause that was tried alone, its fit."""
        return {one.model.names[0]: one for one in self.tried.values() if len(one.model.names) == 1}

    def saved_alone(self, least: float) -> list[Fitted]:
        """Fits of one cause, no load and no wave, that saved so much of the mean log squared error.

        A plant that oscillates makes nearly a wave of noise, and of a position any noise that acts on the
        load nearly an offset.
        """
        neither = (
            one for name, one in self.alone().items() if name not in SOLVED and CAUSES[name].wave is None
        )
        return [one for one in neither if self.baseline.cost - one.cost > least]


def grow(screen: Screen, roots: Roots, progress: Callable[[float], None]) -> Grown:
    """Add one effect at a time to the best sets, until they are adequate or nothing gains any more.

    Args:
        screen: Where causes are tried.
        roots: The baseline, and what to begin from.
        progress: Called with the part of the work that is done.
    """
    sets = sorted((one for one in roots.begin if one.model.names), key=lambda one: one.cost)
    grown = Grown([*sets, roots.baseline], {frozenset(one.model.names): one for one in sets})
    beam = list(roots.begin)
    for size in range(1, BEAM.most_effects + 1):
        if noise_alone(grown.best[0], screen) or screen.budget.spent:
            break
        children = extended(screen, [*beam, *twins([min(beam, key=lambda one: one.cost)])])
        ranked = best_of_each(children)
        grown.tried |= {frozenset(one.model.names): one for one in ranked}
        if not ranked or ranked[0].cost > grown.best[0].cost - least_gain(screen.cut):
            break
        grown.best, beam = [*ranked, *grown.best], survivors(children)
        progress(size / BEAM.most_effects)
    return grown


def best_of_each(ranked: Sequence[Fitted]) -> list[Fitted]:
    """The best fit of each set."""
    best: dict[frozenset[str], Fitted] = {}
    for one in ranked:
        best.setdefault(frozenset(one.model.names), one)
    return list(best.values())


def survivors(children: Sequence[Fitted]) -> list[Fitted]:
    """Of the fits of a race, the best first, those that are grown further: the best sets, and second plants.

    Of a set that also has a richer form the plain one, if that saves too little: the richer form is tried
    again with what is added.
    """
    ranked = best_of_each(children)
    cost = {frozenset(one.model.names): one.cost for one in ranked}

    def spare(fitted: Fitted) -> bool:
        plain = [cost.get(one, math.inf) for one in plain_forms(fitted.model.names)]
        return min(plain, default=math.inf) < fitted.cost + BEAM.richer_gain

    beam = [one for one in ranked if not spare(one)][: BEAM.width]
    first = {frozenset(one.model.names): one for one in beam}
    for one in children:
        names = frozenset(one.model.names)
        if names in first and len(beam) < len(first) + BEAM.second_plants and elsewhere(one, first[names]):
            beam.append(one)
    return beam
