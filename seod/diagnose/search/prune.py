"""A set's effects looked at again: those that gain too little, richer forms of a simple one, alike ones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, causes_tried
from seod.diagnose.fitting.beside import part_beside_slow_offset
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.judged import Judged, gain, loses_its_place, mean_gain
from seod.diagnose.fitting.least_squares import Fitted, fit
from seod.diagnose.fitting.uncertainty import covariance, is_at_null, may_be_chance, reaches_null
from seod.diagnose.search.beam import as_well
from seod.diagnose.search.refine import refined
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.search import PRUNE
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.diagnose.causes.scales import Scales, Values
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array
    from seod.diagnose.search.screen import Screen

    Tried = Mapping[frozenset[str], Fitted]


def plainer(own: Judged, held_out: Cut, screen: Screen, enough: float) -> Judged:
    """The set with the plain form of effects, where the richer one gains too little over it.

    Or where its own size may be none: what a spring as soft as that adds to a constant load is not known.
    """
    for rich in own.found.model.names:
        simpler = [Judged.of(one, held_out) for one in _plainly(own.found, rich, screen)]
        if simpler:
            nearest = min(simpler, key=lambda one: gain(one, own))
            unsure = _may_be_none(own, rich, covariance(own.found)) and not _much(nearest, own)
            own = nearest if unsure or gain(nearest, own) < enough else own
    return own


def _plainly(fitted: Fitted, rich: str, screen: Screen) -> list[Fitted]:
    """The set with each simpler cause that an effect contains in its place, fitted to the same windows."""
    simpler = {each.name: each.becomes for each in CAUSES[rich].plain if each.becomes is not None}
    return _in_place_of(rich, simpler, fitted, screen)


def best_alike(own: Judged, held_out: Cut, screen: Screen) -> Judged:
    """The set with whichever of effects that act alike fits best: which it is shows last of all."""
    own, found = best_placed(own, held_out, screen), own.found
    others = [one for name in found.model.names for one in alike(found, name, screen)]
    least = min((own.found, *others), key=lambda one: one.cost)
    return own if least is own.found else Judged.of(least, held_out)


def best_placed(own: Judged, held_out: Cut, screen: Screen) -> Judged:
    """The set with an effect at its other place in the signal's way, where it fits better there."""
    found = own.found
    others = [one for name in found.model.names for one in _elsewhere(found, name, screen)]
    least = min(others, default=found, key=lambda one: one.cost)
    return Judged.of(least, held_out) if least.cost < found.cost - as_well(found.cut) else own


def alike(fitted: Fitted, name: str, screen: Screen) -> list[Fitted]:
    """The set with each cause alike to one of its own in that one's place, fitted to the same windows."""
    model = fitted.model
    others = {
        other.name: other.same
        for other in CAUSES[name].alike
        if (model.scales.two_commands or not other.two_commands_only)
        and (not other.distinguished_by or not other.distinguished_by.isdisjoint(model.names))
        and not (model.scales.two_commands and CAUSES[other.name].hidden)
    }
    return _in_place_of(name, others, fitted, screen)


def _elsewhere(fitted: Fitted, name: str, screen: Screen) -> list[Fitted]:
    """The set with an effect at its other place, where that can be told from the usual one."""
    model, other = fitted.model, CAUSES[name].elsewhere
    if other is None or other.distinguished_by.isdisjoint(model.names):
        return []
    return [_fitted(model.at_other_place(name), model.values(fitted.x), fitted, screen)]


def _in_place_of(
    name: str, others: Mapping[str, Callable[[Values, Scales], Values]], fitted: Fitted, screen: Screen
) -> list[Fitted]:
    """The set with each other cause, begun at what it is by the set's values, in the place of an effect."""
    model, values = fitted.model, fitted.model.values(fitted.x)
    return [
        _fitted(model.without(name).with_effect(other), values | begin(values, model.scales), fitted, screen)
        for other, begin in others.items()
        if other not in {*model.names, *model.scales.given}
    ]


def _fitted(model: Model, values: Values, fitted: Fitted, screen: Screen) -> Fitted:
    x = model.searched(values)
    cut = fitted.cut
    start = begun_states(model, x, cut, fitted.start)
    return fit(model, cut, x, start, parallel=screen.parallel, ended=screen.budget.last_fit())


def without(fitted: Fitted, name: str, screen: Screen) -> Fitted:
    """A set without one of its effects, nor what no other shows, fitted anew to the same windows."""
    return _fitted(fitted.model.without(name).shown(), fitted.model.values(fitted.x), fitted, screen)


def thinned(
    own: Judged, tried: Tried, held_out: Cut, screen: Screen, enough: float, above: float
) -> tuple[Judged, dict[str, Judged]]:
    """Without the effects that gain too little, and of those left the set without each.

    They have to gain where they were fitted, and on the windows held out (`held_out`), or foretell these
    much better; and their size has to be identified. `tried` are sets that were fitted, by their effects;
    `above` is the baseline's squared held-out NRMSE above the noise, beside an offset if it has one.
    """
    while True:
        rest = _rest(own.found, tried, held_out, screen)
        if not rest:
            return own, {}
        idle = _gaining_too_little(own, rest, enough) or _unidentified(own, rest, above, screen)
        if not idle:
            return own, rest
        own = min(idle, key=lambda one: gain(one, own))


def _gaining_too_little(own: Judged, rest: Mapping[str, Judged], enough: float) -> list[Judged]:
    """Of effects that gain too little and foretell no window that no fit has seen, the set without each."""
    spread = covariance(own.found)
    return [
        one
        for name, one in rest.items()
        if gain(one, own) < enough and not _foretells(own, name, one, spread)
    ]


def _foretells(own: Judged, name: str, fewer: Judged, spread: Array) -> bool:
    """Whether windows held out need a cause whose size fitted windows tell, little as it acts in these.

    In a machine's operation the one long move that its valve is too slow for may be in a window held out.
    """
    saved = fewer.held.log_error - own.held.log_error
    return EFFECTS[name].cause and saved >= PRUNE.foretold and not _may_be_none(own, name, spread)


def _unidentified(own: Judged, rest: Mapping[str, Judged], above: float, screen: Screen) -> list[Judged]:
    """Of effects without a share, or whose size or gain may be none, or another's, the set without each.

    That of a window's beginning, or of an offset that moves slowly.
    """
    spread = covariance(own.found)
    return [
        one
        for name, one in rest.items()
        if _has_no_share(own, one, above)
        or (_may_be_none(own, name, spread) and not _much(one, own))
        or (EFFECTS[name].cause and is_at_null(own.found, name))
        or _gains_by_chance(own, name, one)
        or (not loses_its_place(own.found.model, name) and _in_windows_alone(own, one))
        or _moves_as_slowly_as_an_offset(own, one, screen)
    ]


def _has_no_share(own: Judged, fewer: Judged, above: float) -> bool:
    """Whether next to nothing of the baseline's error comes back without an effect.

    Not where noise alone is left with it, and more without: an offset may throw the baseline anywhere.
    """
    needed = own.held.adequacy <= HELD_OUT.adequate < fewer.held.adequacy
    return not needed and fewer.held.nrmse**2 - own.held.nrmse**2 < PRUNE.least_share * above


def _gains_by_chance(own: Judged, name: str, fewer: Judged) -> bool:
    """Whether windows held out show of a cause no more than chance does."""
    tried = causes_tried(own.found.model.scales)
    most = PRUNE.much_by_chance if _much(fewer, own) else PRUNE.by_chance
    return EFFECTS[name].cause and may_be_chance(fewer.held, own.held, tried, most)


def _in_windows_alone(own: Judged, fewer: Judged) -> bool:
    """Whether one run of the whole recordings gains next to nothing of what windows gain by an effect.

    Then it is what each window begins with that makes the gain: a spring far off its centre is an offset that
    moves slowly. A run that is far off says nothing, unless it is near without the effect.
    """
    harmed = fewer.whole <= min(own.whole, PRUNE.far_off * fewer.held.nrmse)
    if not (harmed or own.whole <= PRUNE.far_off * own.held.nrmse):
        return False
    in_windows, in_one_run = _saved(fewer.held.nrmse, own.held.nrmse), _saved(fewer.whole, own.whole)
    return in_one_run < PRUNE.part_in_one_run * in_windows


def _moves_as_slowly_as_an_offset(own: Judged, fewer: Judged, screen: Screen) -> bool:
    """Whether a sensor whose zero moves slowly explains what an effect does, so that it saves no more.

    Where the set leaves white noise the sensor has no offset of which an effect saves much, nor one as large
    as the movement. Under a relay the noise may be white all the same: commands answer to the offset, and an
    effect makes up for them.
    """
    white = own.held.adequacy <= HELD_OUT.adequate and not own.found.cut.relayed
    if (white and _much(fewer, own)) or fewer.held.nrmse > PRUNE.most_offset:
        return False
    return part_beside_slow_offset(own.found, fewer.found, screen.parallel) < PRUNE.beside_slow_offset


def _saved(without: float, with_it: float) -> float:
    """Of the log NRMSE."""
    return math.log(without + 1e-300) - math.log(with_it + 1e-300)


def _much(fewer: Judged, more: Judged) -> bool:
    """Whether an effect saves so much that its size is not none, whatever its interval says.

    Where it saves least, or in the mean: of what noise that remembers does not foretell, a fit saves little.
    """
    return max(gain(fewer, more), mean_gain(fewer, more)) >= PRUNE.surely


def _may_be_none(own: Judged, name: str, spread: Array) -> bool:
    tried = causes_tried(own.found.model.scales)
    return EFFECTS[name].cause and reaches_null(own.found, name, spread, tried)


def _rest(fitted: Fitted, tried: Tried, held_out: Cut, screen: Screen) -> dict[str, Judged]:
    """By its name the set without each effect."""
    names = fitted.model.names
    without = screen.parallel(lambda name: _pruned(fitted, name, tried, held_out, screen), names)
    return dict(zip(names, without, strict=True))


def _pruned(fitted: Fitted, name: str, tried: Tried, held_out: Cut, screen: Screen) -> Judged:
    """A set without one of its effects: fitted from where the set is, and from where it was found without."""
    rest = [without(fitted, name, screen)]
    before = tried.get(frozenset(rest[0].model.names))
    if before is not None:
        rest.append(before if before.cut is fitted.cut else refined(before, fitted.cut, screen))
    return Judged.of(min(rest, key=lambda one: one.cost), held_out)
