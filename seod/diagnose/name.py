"""The effects of a found set, each with what it is good for and what could stand in its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from seod.diagnose.answer import FoundEffect, Gain
from seod.diagnose.intervals import covariance, effect_parameters, p_value
from seod.diagnose.judge import refined
from seod.diagnose.select import as_well, least_gain
from seod.diagnose.thin import alike
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.diagnose.fit import Fitted
    from seod.diagnose.judge import Judged
    from seod.diagnose.score import HeldOut
    from seod.diagnose.screen import Screen


@dataclass(frozen=True, slots=True)
class Chosen:
    """A set of effects fitted to all windows, with what came of leaving each out.

    Attributes:
        found: The set.
        without: Of each effect the set without it, fitted anew.
        held: Its simulation of the windows held out.
    """

    found: Fitted
    without: Mapping[str, Judged]
    held: HeldOut


def found_effects(
    chosen: Chosen, screen: Screen, tried: Mapping[frozenset[str], Fitted]
) -> list[FoundEffect]:
    """In order of gain."""
    out = []
    spread = covariance(chosen.found)
    for name, rest in chosen.without.items():
        if not EFFECTS[name].cause:
            continue
        out.append(
            FoundEffect(
                name=name,
                parameters=effect_parameters(chosen.found, name, spread),
                gain=Gain(rest.held.nrmse, chosen.held.nrmse),
                p_value=p_value(rest.held, chosen.held),
                indistinguishable_from=tuple(_in_place_of(name, chosen.found, rest.found, screen, tried)),
            )
        )
    return sorted(out, key=lambda each: -each.gain.nrmse_without)


def _in_place_of(
    name: str, found: Fitted, rest: Fitted, screen: Screen, tried: Mapping[frozenset[str], Fitted]
) -> list[str]:
    """Causes that explain as well what `name` does, the others of the set fitted anew."""
    others = frozenset(rest.model.names)
    siblings: Sequence[Fitted] = [one for names, one in tried.items() if others < names and name not in names]
    siblings = [one for one in siblings if len(one.model.names) == len(others) + 1]
    if not siblings:
        siblings = screen.extended([refined(rest, screen.cut, screen)], found.model.names)
    few, every = screen.cut, screen.every
    reach = refined(found, few, screen).cost + 2.0 * least_gain(few)
    near = [one for one in siblings if one.cost < reach]
    near += alike(found, name, screen)
    own, *near = screen.side_by_side(lambda one, within: refined(one, every, within), [found, *near])
    good = sorted((one for one in near if one.cost < own.cost + as_well(every)), key=lambda one: one.cost)
    return list(dict.fromkeys(next(iter(set(one.model.names) - others)) for one in good))
