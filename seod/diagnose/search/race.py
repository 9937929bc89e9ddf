"""One effect more: every cause tried from its best starts, the promising ones fitted further."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.causes.table import (
    CAUSES,
    FROM_GRID,
    IN_GRID,
    RICHER,
    SETTLED,
    SHAKES,
    bare,
    begun_from,
    further_causes,
    group,
    grown,
    remote,
    wave_of,
)
from seod.diagnose.fitting.initial_states import best_states, carried_states, simulated_states
from seod.diagnose.fitting.least_squares import Fitted, fit
from seod.diagnose.record.command_period import in_step
from seod.diagnose.search.first_order_gain import ParentResidual
from seod.diagnose.starts.effect_starts import effect_starts
from seod.diagnose.starts.search_roots import is_another_plant
from seod.diagnose.tuning.fitting import FIT
from seod.diagnose.tuning.search import RACE

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.causes.scales import Values
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.search.screen import Screen


class Entrant(NamedTuple):
    """An effect more for a parent, from this start."""

    parent: Fitted
    name: str
    start: Values


class Runner(NamedTuple):
    """An effect more for a parent, as far as it was fitted."""

    parent: Fitted
    name: str
    found: Fitted


def extended(screen: Screen, parents: Sequence[Fitted], but: Sequence[str] = ()) -> list[Fitted]:
    """Each parent with one effect more, but these; the best first.

    A race: after each round only the better ones of a parent are fitted further.
    """
    alike = {parent.model.names: parent for parent in reversed(parents)}
    begun = [each for parent in alike.values() for each in _from_grid(screen, parent, but)]
    begun += [each for parent in parents for each in _entrants(screen, parent, but)]
    begun = promising(screen, begun)
    seen = best_starts(_all_glanced(screen, begun))
    seen = list(
        screen.parallel(
            lambda one: _on(screen, one, RACE.look_steps), _front(parents, seen, RACE.causes_looked_at)
        )
    )
    whole = list(screen.parallel(lambda one: _whole(screen, one), _front(parents, seen, RACE.causes_on_all)))
    ranked = sorted(whole, key=lambda one: one.found.cost)
    last = sum(one.found.cost < ranked[0].found.cost + RACE.finished_within for one in ranked)
    last = max(last, RACE.finished_at_least)
    better = [*screen.parallel(lambda one: _on(screen, one, RACE.last_steps), ranked[:last]), *ranked[last:]]
    better += _richer(screen, better)
    found = [one.found for one in better if not imitates(one.found, screen.every)]
    return sorted(found, key=lambda one: one.cost)


def _entrants(screen: Screen, parent: Fitted, but: Sequence[str]) -> list[Entrant]:
    names = further_causes(parent.model.scales, parent.model.names)
    return [
        Entrant(parent, name, start)
        for name in names
        if name not in but
        for start in effect_starts(parent, name, screen.every)
        if not remote(start) or _reaches_far(screen, parent, name)
    ]


def _reaches_far(screen: Screen, parent: Fitted, name: str) -> bool:
    """Whether a cause is tried from plants far from the parent's: of the baseline, unless the grid is.

    A disturbance also of the others: it may be what their plant oscillates with.
    """
    if not bare(parent.model.names):
        return name == SHAKES and not screen.grid_plants
    return not (screen.grid_plants and name in IN_GRID)


def _from_grid(screen: Screen, parent: Fitted, but: Sequence[str]) -> list[Entrant]:
    """Plants of the grid for sets that they are starts of."""
    model, begun = parent.model, []
    for name in further_causes(model.scales, model.names):
        if name not in but and name in FROM_GRID:
            searched = group(name, model.scales)
            own = next(iter(searched.starts), {})
            some = [own | one.values() for one in screen.plants(model, (*model.names, name))]
            places = {coordinate.place for coordinate in searched.coordinates}
            begun += [Entrant(parent, name, start) for start in some if places <= start.keys()]
    return begun


def promising(screen: Screen, some: Iterable[Entrant]) -> list[Entrant]:
    """Of each cause those that promise the least cost, the best first, few before starts far away.

    Starts far away promise none, and are all kept.
    """
    far, near = list[Entrant](), list[Entrant]()
    for one in some:
        (far if remote(one.start) else near).append(one)
    parents = {id(one.parent): one.parent for one in near}
    ahead = {which: ParentResidual(_on_few(screen, parent)) for which, parent in parents.items()}

    def cost(entrant: Entrant) -> float:
        return entrant.parent.cost - ahead[id(entrant.parent)].promise(entrant.name, entrant.start).saves

    ranked = sorted(zip(screen.parallel(cost, near), range(len(near)), strict=True))
    near = _few_of_each([near[k] for _, k in ranked])
    return near[: RACE.first_tried] + far + near[RACE.first_tried :]


def _few_of_each(ranked: Sequence[Entrant]) -> list[Entrant]:
    """Of each parent's every cause the starts that promise most."""
    count: Counter[tuple[int, str]] = Counter()
    out = []
    for one in ranked:
        of = id(one.parent), one.name
        count[of] += 1
        if count[of] <= RACE.starts_of_a_cause:
            out.append(one)
    return out


def _on_few(screen: Screen, parent: Fitted) -> Fitted:
    """A parent on the windows on which every start is tried."""
    few = list(screen.few)
    return replace(parent, cut=screen.cut.only(screen.few), start=parent.start[few], error=parent.error[few])


def _all_glanced(screen: Screen, entrants: Sequence[Entrant]) -> list[Runner]:
    """As many as their part of the budget allows, some at a time: each one sees only what it uses itself."""
    over, out = screen.budget.share(RACE.glances_part), list[Runner]()
    for k in range(0, len(entrants), RACE.glanced_together):
        if over():
            break
        out += screen.parallel(lambda one: _glanced(screen, one), entrants[k : k + RACE.glanced_together])
    return out


def _glanced(screen: Screen, entrant: Entrant) -> Runner:
    """After a few steps on few windows."""
    parent, few = entrant.parent, screen.cut.only(screen.few)
    values = begun_from(parent.model.values(parent.x), entrant.start)
    model = parent.model.with_effect(entrant.name).turned(values["K_L"])
    x = model.searched(values)
    most, start = RACE.glance_steps, parent.start[list(screen.few)]
    if remote(entrant.start):
        most, start = RACE.remote_steps, best_states(model, x, few, start, simulated_states(model, x, few))
    return Runner(
        parent, entrant.name, fit(model, few, x, start, most, ended=screen.budget.trial(RACE.glance_part))
    )


def _on(screen: Screen, runner: Runner, most: int) -> Runner:
    """So many steps more where it is."""
    at, ended = runner.found, screen.budget.trial(most * RACE.glance_part / RACE.look_steps)
    return runner._replace(found=fit(at.model, at.cut, at.x, at.start, most, ended=ended))


def _whole(screen: Screen, runner: Runner) -> Runner:
    """On all windows for trying."""
    at, start, ended = runner.found, runner.parent.start.copy(), screen.budget.trial()
    start[list(screen.few)] = at.start
    simulated = simulated_states(at.model, at.x, screen.cut)
    start = best_states(at.model, at.x, screen.cut, start, simulated, carried_states(at, screen.cut))
    return runner._replace(found=fit(at.model, screen.cut, at.x, start, RACE.whole_steps, ended=ended))


def _richer(screen: Screen, some: Sequence[Runner]) -> list[Runner]:
    """Richer forms of a cause, from the best set with a plain one of it and no richer form of that."""
    ranked = sorted(some, key=lambda one: one.found.cost)
    begun = {rich: next((one for one in ranked if _may_grow(one, rich)), None) for rich in RICHER}
    forms = [partial(_grown, screen, one, rich) for rich, one in begun.items() if one is not None]
    return list(screen.parallel(lambda form: form(), forms))


def _may_grow(runner: Runner, rich: str) -> bool:
    names, plain = set(runner.found.model.names), set(RICHER[rich])
    return not plain.isdisjoint(names) and all(plain.isdisjoint(RICHER.get(name, ())) for name in names)


def _plain_of(runner: Runner, rich: str) -> list[str]:
    """Plain forms of a cause that a set has."""
    return [name for name in RICHER[rich] if name in runner.found.model.names]


def _grown(screen: Screen, runner: Runner, rich: str) -> Runner:
    """The same with a richer form of a cause: best perhaps where the plain one is far from it."""
    at, ended, plain = runner.found, screen.budget.trial(), _plain_of(runner, rich)
    model = at.model
    for name in plain if not CAUSES[rich].needs else ():
        model = model.without(name)
    model, values = model.with_effect(rich), at.model.values(at.x)
    bent = [plant for plant in screen.plants(model, model.names) if rich in plant.causes and rich in SETTLED]
    if bent:
        begin = begun_from(values, min(bent, key=lambda plant: plant.cost).values())
    else:
        begin = values | grown(rich, plain[0], values, model.scales)
    x = model.searched(begin)
    return runner._replace(found=fit(model, screen.cut, x, at.start, RACE.last_steps, ended=ended))


def imitates(fitted: Fitted, every: Cut) -> bool:
    """A wave that stands for something else.

    A disturbance in step with the command is one line of the plant's own answer, if anything else is
    left. The longest ripple is a bend.
    """
    values = fitted.model.values(fitted.x)
    for name in fitted.model.names:
        if CAUSES[name].wave is None:
            continue
        place = f"{name}.{wave_of(name).number}"
        if wave_of(name).over == "time":
            if fitted.excess > FIT.noise_alone and in_step(every, values[place]):
                return True
        elif values[place] < RACE.longest_wave * _least(fitted, place):
            return True
    return False


def _least(fitted: Fitted, place: str) -> float:
    return next(coordinate.low for coordinate in fitted.model.coordinates if coordinate.place == place)


def best_starts(some: Iterable[Runner]) -> list[Runner]:
    """Of each parent's every cause the one that came farthest, of a contact also from another plant."""
    best: dict[tuple[int, str], list[Runner]] = {}
    for one in sorted(some, key=lambda one: one.found.cost):
        kept = best.setdefault((id(one.parent), one.name), [])
        if not kept or (len(kept) == 1 and one.name in IN_GRID and elsewhere(one.found, kept[0].found)):
            kept.append(one)
    return [one for kept in best.values() for one in kept]


def elsewhere(fitted: Fitted, other: Fitted) -> bool:
    """Whether a fit that is not much worse than another of the same effects has another plant."""
    return fitted.cost < other.cost + RACE.finished_within and is_another_plant(fitted, other)


def _front(parents: Sequence[Fitted], some: Sequence[Runner], most: int) -> list[Runner]:
    """So many of each parent's causes, the best."""
    ranked, out = sorted(some, key=lambda one: one.found.cost), []
    for parent in parents:
        own = [one for one in ranked if one.parent is parent]
        names = list(dict.fromkeys(one.name for one in own))[:most]
        out += [one for one in own if one.name in names]
    return out
