"""The effects of a found set, each with what it is good for and what could stand in its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seod.diagnose.causes.table import CAUSES, OFFSET, answered_as, causes_tried, commuting
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.uncertainty import covariance, effect_parameters, p_value, reaches_null
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.result import FoundEffect, Gain, Parameter
from seod.diagnose.search.beam import as_well, least_gain
from seod.diagnose.search.prune import alike
from seod.diagnose.search.race import extended
from seod.diagnose.search.refine import refined
from seod.diagnose.tuning.search import PRUNE
from seod.diagnose.tuning.verdict import FOUND_EFFECTS
from sim.effects import EFFECTS, parameter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.load_drift import Drift
    from seod.diagnose.result import Array
    from seod.diagnose.search.final_choice import Choice
    from seod.diagnose.search.screen import Screen


@dataclass(frozen=True, slots=True)
class Chosen:
    """A set of effects fitted to all windows, with what came of leaving each out.

    Attributes:
        searched: The set, fitted to the windows in which causes are searched.
        without_held_out: The same fitted to all rows but those held out: of a long recording these are more.
        all_rows: The same fitted to all rows; no error held out is by it.
        without: Of each effect the set without it, fitted anew.
        held: Its simulation of the windows held out.
        drift: The same beside a load that drifts, where recordings show one.
        noise_alone: Fitted by prediction errors, the set leaves nothing systematic.
        in_loop: And commands answer to what disturbs the load: its numbers are by prediction errors.
        per_holdout: `reported` fitted anew to each recording that no fit has seen; None where too little of
            one counts.
    """

    searched: Fitted
    without_held_out: Fitted
    all_rows: Fitted
    without: Mapping[str, Judged]
    held: HeldOut
    drift: Drift | None = None
    noise_alone: bool = False
    in_loop: bool = False
    per_holdout: tuple[Fitted | None, ...] = ()

    @property
    def reported(self) -> Fitted:
        """By which numbers and intervals are reported."""
        return self.all_rows if self.drift is None else self.drift.fitted


def found_effects(
    chosen: Chosen, screen: Screen, tried: Mapping[frozenset[str], Fitted]
) -> list[FoundEffect]:
    """In order of gain."""
    out = []
    spread = covariance(chosen.reported)
    causes = causes_tried(chosen.searched.model.scales)
    for name, rest in chosen.without.items():
        if not EFFECTS[name].cause:
            continue
        others = (
            *_commuting(name, chosen.searched),
            *_in_place_of(name, chosen, rest.found, screen, tried),
            *_over_the_sweep(name, chosen.searched, tried),
            *_unrepeated(name, chosen.searched),
        )
        out.append(
            FoundEffect(
                name=answered_as(name),
                parameters=_numbers(chosen.reported, name, spread),
                gain=Gain(rest.held.nrmse, chosen.held.nrmse),
                p_value=p_value(rest.held, chosen.held, causes),
                indistinguishable_from=_indistinguishable(name, others),
                holdout=_in_other_recordings(chosen, name),
            )
        )
    if chosen.drift is not None and OFFSET not in {each.name for each in out}:
        numbers = effect_parameters(chosen.reported, OFFSET, spread)
        gain = Gain(chosen.drift.without, chosen.drift.with_it)
        again = _in_other_recordings(chosen, OFFSET)
        by_chance = min(1.0, causes * chosen.drift.p_value)
        out.append(FoundEffect(OFFSET, numbers, gain, by_chance, holdout=again))
    return sorted(out, key=lambda each: -each.gain.nrmse_without)


def without_a_size(chosen: Chosen, choice: Choice) -> str | None:
    """An effect whose interval, as told, reaches the value at which it does nothing; None where none does.

    Of several the one that saves least of windows held out; none that saves much, as when sets are thinned.
    Windows of recordings that only score are not asked.
    """
    spread, own = covariance(chosen.reported), choice.best.held.log_error
    none = [
        (rest.held.log_error, name)
        for name, rest in choice.without.items()
        if EFFECTS[name].cause
        and name in chosen.reported.model.names
        and rest.held.log_error - own < PRUNE.surely
        and reaches_null(chosen.reported, name, spread)
    ]
    return min(none)[1] if none else None


def _indistinguishable(name: str, others: Sequence[str]) -> tuple[str, ...]:
    """Names that the answer lists beside this effect, each once."""
    names = dict.fromkeys(answered_as(other) for other in others)
    return tuple(other for other in names if other != answered_as(name))


def _in_other_recordings(chosen: Chosen, name: str) -> tuple[dict[str, Parameter], ...]:
    """Parameters of an effect by each recording that no fit had seen; none where too little of one counts."""
    return tuple({} if one is None else _numbers(one, name, covariance(one)) for one in chosen.per_holdout)


def _numbers(fitted: Fitted, name: str, spread: Array) -> dict[str, Parameter]:
    """Parameters of an effect; of one that counts as another cause that one's before them, in proportion."""
    own = effect_parameters(fitted, name, spread)
    counted = EFFECTS[name].counts_as
    becomes = next((each.becomes for each in CAUSES[name].plain if each.name == counted), None)
    if becomes is None:
        return own
    ((place, value),) = becomes(fitted.model.values(fitted.x), fitted.model.scales).items()
    (size,) = own.values()
    factor = value / size.value
    low, high = sorted(factor * end for end in size.ci95)
    _, wanted = parameter(place)
    return {wanted.name: Parameter(value, wanted.unit, (low, high)), **own}


def _commuting(name: str, fitted: Fitted) -> list[str]:
    """Causes that are the same in a plant such as this.

    Of two lags one may have a state more in each window, by which it is nearer to noise that remembers.
    """
    model = fitted.model
    if model.moved:
        return []
    beside = {*model.names, *(CAUSES.keys() & model.fixed.keys())} - {name}
    return [each for each in commuting(name, beside) if each not in model.scales.given]


def _over_the_sweep(name: str, fitted: Fitted, tried: Mapping[frozenset[str], Fitted]) -> list[str]:
    """Causes that gain something too, alone or beside the others, where a plant changes under a sweep.

    What depends on frequency or amplitude depends on time then.
    """
    if EFFECTS[name].enters != "plant" or not any(
        sweeps(recording.t, recording.u) for recording in fitted.cut.series
    ):
        return []
    others, found = frozenset(fitted.model.names) - {name}, []
    for base in dict.fromkeys((frozenset[str](), others)):
        sets = [one for names, one in tried.items() if base < names and len(names) == len(base) + 1]
        known = [tried[base].cost] if base in tried else []
        enough = max([*known, *(one.cost for one in sets)], default=0.0) - least_gain(fitted.cut)
        gaining = sorted((one for one in sets if one.cost < enough), key=lambda one: one.cost)
        found += [next(iter(set(one.model.names) - base)) for one in gaining]
    return [each for each in dict.fromkeys(found) if each not in fitted.model.names]


def _unrepeated(name: str, fitted: Fitted) -> list[str]:
    """What a wave over places may be as well where the load passes fewer than two of it."""
    wave, scales = CAUSES[name].wave, fitted.model.scales
    if wave is None or wave.unrepeated is None or not CAUSES[wave.unrepeated].searched(scales):
        return []
    number = fitted.model.values(fitted.x)[f"{name}.{wave.number}"]
    seen = number * scales.travel / (2.0 * math.pi)
    return [wave.unrepeated] if seen < FOUND_EFFECTS.repeated else []


def _in_place_of(
    name: str, chosen: Chosen, rest: Fitted, screen: Screen, tried: Mapping[frozenset[str], Fitted]
) -> list[str]:
    """Causes that explain as well what `name` does, the others of the set fitted anew.

    As well is also what windows held out do not tell to be worse: where noise remembers, it bends a fit
    by more than the fits of two causes differ.
    """
    fitted, others = chosen.searched, frozenset(rest.model.names)
    siblings: Sequence[Fitted] = [one for names, one in tried.items() if others < names and name not in names]
    siblings = [one for one in siblings if len(one.model.names) == len(others) + 1]
    if not siblings:
        siblings = extended(screen, [refined(rest, screen.cut, screen)], fitted.model.names)
    few, every = screen.cut, screen.every.remembering(fitted.cut.memory)
    reach = refined(fitted, few, screen).cost + FOUND_EFFECTS.near * least_gain(few)
    near = [one for one in siblings if one.cost < reach]
    near += alike(fitted, name, screen)
    own, *near = screen.parallel(lambda one: refined(one, every, screen), [fitted, *near])
    foretold = Judged.of(own, chosen.held.cut).held
    good = [one for one in near if one.cost < own.cost + as_well(every) or not _foretells_less(one, foretold)]
    good.sort(key=lambda one: one.cost)
    return list(dict.fromkeys(next(iter(set(one.model.names) - others)) for one in good))


def _foretells_less(other: Fitted, own: HeldOut) -> bool:
    """Whether windows held out tell that another set is worse."""
    return p_value(Judged.of(other, own.cut).held, own) < FOUND_EFFECTS.surely_worse
