"""One effect more: every cause tried from every start, the promising ones fitted further."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np

from seod.diagnose.ahead import Ahead
from seod.diagnose.cell import BEGUN, CONTACTS, SHAKEN, bristles
from seod.diagnose.cells import cells
from seod.diagnose.command_period import in_step
from seod.diagnose.coordinates import RICHER_FRICTION, WAVES, begun_from, further_causes, group, remote
from seod.diagnose.fit import NOISE_ALONE, Fitted, fit, settle
from seod.diagnose.simulate import inside
from seod.diagnose.states import best_states, carried_states, simulated_states, travelled
from seod.diagnose.waves import lines, starts
from seod.diagnose.windows import Cut, sample, sparse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.budget import Budget
    from seod.diagnose.cell import Cell
    from seod.diagnose.coordinates import Values
    from seod.diagnose.fit import Each
    from seod.diagnose.model import Model

One = TypeVar("One")
Made = TypeVar("Made")

PROBED_S: Final = 3.0
"""Of windows on which every start is tried."""
OUTSTANDING: Final = 4.0
"""Squared error in a window over the most in those, from which on it is one of them."""
GLANCING: Final = 0.6
"""Of the time that is left when a race begins, what its glances may use."""
FIRST: Final = 12
"""Starts whose promise is believed before others are tried."""
SCREENED_S: Final = 6.0
"""Of windows on which the better causes are fitted."""
GLANCE: Final = 2
"""Steps from every start."""
FAR: Final = 12
"""Steps from one whose K_L and zeta are far from the baseline's."""
QUICK: Final = 0.015
"""Part of the search's time that a glance or a look may use: some plants are slow to simulate."""
LOOK: Final = 3
"""Further steps of the better causes."""
WHOLE: Final = 4
"""Steps of the promising ones on all windows for trying."""
LAST: Final = 12
"""Further steps of the best."""
CAUSES: Final = 9
"""Causes of a parent that are looked at."""
BENT: Final = 1.02
"""Wavenumbers of a ripple over the least, up to which the least has stopped it."""
PROMISING: Final = 5
"""Causes of a parent that are fitted to all windows for trying."""
SLOWLY: Final = 20.0
"""Speed at which friction has fallen, over the typical one, where it begins as one that hardly does."""
LITTLE: Final = 0.1
"""Slope of that friction over the damping of the plant, at most: it drives the load."""
SWINGS: Final = 0.3
"""Damping below which a plant's own swinging may be a disturbance."""
APART: Final = 0.3
"""Difference of the logarithm of omega_n or zeta from which on plants are others."""
FRONT: Final = 4
NEAR: Final = 1.0
"""Sets that are fitted to the end, at least; the others whose mean log error is that near the best."""


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


@dataclass(frozen=True, slots=True)
class Screen:
    """Windows for trying causes.

    Attributes:
        every: All windows to fit.
        cut: Some of them.
        few: Fewer still: which of `cut`.
        each: Maps a function over trials, in parallel.
        budget: What the search may use.
        cells: Plants to begin from, of a relay's recording.
    """

    every: Cut
    cut: Cut
    few: tuple[int, ...]
    each: Each
    budget: Budget
    cells: tuple[Cell, ...] = ()

    def side_by_side(self, act: Callable[[One, Screen], Made], some: Sequence[One]) -> list[Made]:
        """What comes of each: one on each core, where the trials of a single one would wait for each other.

        `act` is given the screen to use within.
        """
        if len(some) == 1:
            return [act(some[0], self)]
        alone = replace(self, each=map)
        return list(self.each(lambda one: act(one, alone), some))

    def watching(self, base: Fitted) -> Screen:
        """With the window of which this leaves by far the most, if not yet: an effect may show in no other.

        `base` is fitted to all windows. A relay's are alike.
        """
        windows, few = self.every.windows, [self.cut.windows[k] for k in self.few]
        if any(one.relayed for one in self.every.series):
            return self
        square = dict(zip(windows, base.error / base.cut.allowed**2, strict=True))
        worst = max(windows, key=lambda one: square[one])
        if square[worst] < OUTSTANDING * max(square[one] for one in few):
            return self
        some = [k for k, one in enumerate(windows) if one == worst or one in self.cut.windows]
        at = windows.index(worst)
        nearest = min(few, key=lambda one: abs(windows.index(one) - at))
        watched = sorted(some.index(windows.index(one)) for one in {worst, *few} - {nearest})
        return replace(self, cut=self.every.only(some), few=tuple(watched))

    def start(self, parent: Model, x: Array) -> Array:
        """Initial states on `cut` for a model fitted elsewhere, shape (w, 7)."""
        return settle(parent, self.cut, x, simulated_states(parent, x, self.cut), self.cut.good)

    def extended(self, parents: Sequence[Fitted], but: Sequence[str] = ()) -> list[Fitted]:
        """Each parent with one effect more, but these; the best first.

        A race: after each round only the better ones of a parent are fitted further.
        """
        alike = {parent.model.names: parent for parent in reversed(parents)}
        begun = [each for parent in alike.values() for each in self._from_cells(parent, but)]
        begun += [each for parent in parents for each in self._entrants(parent, but)]
        begun = self.promising(begun)
        over = self.budget.share(GLANCING)
        glanced = self.each(lambda one: None if over() else self._glanced(one), begun)
        seen = best_starts(one for one in glanced if one is not None)
        seen = list(self.each(lambda one: self._on(one, LOOK), _front(parents, seen, CAUSES)))
        whole = list(self.each(self._whole, _front(parents, seen, PROMISING)))
        ranked = sorted(whole, key=lambda one: one.found.cost)
        last = sum(one.found.cost < ranked[0].found.cost + NEAR for one in ranked)
        last = max(last, FRONT)
        better = [*self.each(lambda one: self._on(one, LAST), ranked[:last]), *ranked[last:]]
        better += self._richer(better)
        found = [one.found for one in better if not self.imitates(one.found)]
        return sorted(found, key=lambda one: one.cost)

    def _entrants(self, parent: Fitted, but: Sequence[str]) -> list[Entrant]:
        names = further_causes(parent.model.scales, parent.model.names)
        return [
            Entrant(parent, name, start)
            for name in names
            if name not in but
            for start in self.starts(parent, name)
            if not remote(start) or self._reaches_far(parent, name)
        ]

    def _reaches_far(self, parent: Fitted, name: str) -> bool:
        """Whether a cause is tried from plants far from the parent's: of the baseline, unless the grid is.

        A disturbance also of the others: it may be what their plant swings with.
        """
        if parent.model.names:
            return name == SHAKEN and not self.cells
        return not (self.cells and name in CONTACTS)

    def _from_cells(self, parent: Fitted, but: Sequence[str]) -> list[Entrant]:
        """Plants of the grid for sets that they are starts of."""
        model, begun = parent.model, []
        for name in further_causes(model.scales, model.names):
            if name not in but and name in BEGUN:
                searched = group(name, model.scales)
                own = next(iter(searched.starts), {})
                some = [own | one.values() for one in self.plants(model, (*model.names, name))]
                places = {each.place for each in searched.coordinates}
                begun += [Entrant(parent, name, start) for start in some if places <= start.keys()]
        return begun

    def plants(self, model: Model, names: Iterable[str]) -> list[Cell]:
        """Those of the grid that a set of these effects may begin from, with the sign of the model's gain."""
        sign = model.coordinates[0].scale
        return [one for one in self.cells if one.K_L * sign > 0.0 and one.begins(names)]

    def promising(self, some: Iterable[Entrant]) -> list[Entrant]:
        """Those that promise the least cost first, few of them before starts far away: these promise none."""
        far, near = list[Entrant](), list[Entrant]()
        for one in some:
            (far if remote(one.start) else near).append(one)
        parents = {id(one.parent): one.parent for one in near}
        ahead = {which: Ahead(self._on_few(parent)) for which, parent in parents.items()}

        def cost(one: Entrant) -> float:
            return one.parent.cost - ahead[id(one.parent)].promise(one.name, one.start).saves

        ranked = sorted(zip(self.each(cost, near), range(len(near)), strict=True))
        near = [near[k] for _, k in ranked]
        return near[:FIRST] + far + near[FIRST:]

    def _on_few(self, parent: Fitted) -> Fitted:
        """A parent on the windows on which every start is tried."""
        few = list(self.few)
        return replace(parent, cut=self.cut.only(self.few), start=parent.start[few], error=parent.error[few])

    def _glanced(self, one: Entrant) -> Runner:
        """After a few steps on few windows."""
        parent, few = one.parent, self.cut.only(self.few)
        model = parent.model.with_effect(one.name)
        x = model.searched(begun_from(parent.model.values(parent.x), one.start))
        most, start = GLANCE, parent.start[list(self.few)]
        if remote(one.start):
            most, start = FAR, best_states(model, x, few, start, simulated_states(model, x, few))
        return Runner(parent, one.name, fit(model, few, x, start, most, ended=self.budget.trial(QUICK)))

    def _on(self, one: Runner, most: int) -> Runner:
        """So many steps more where it is."""
        at, ended = one.found, self.budget.trial(most * QUICK / LOOK)
        return one._replace(found=fit(at.model, at.cut, at.x, at.start, most, ended=ended))

    def _whole(self, one: Runner) -> Runner:
        """On all windows for trying."""
        at, start, ended = one.found, one.parent.start.copy(), self.budget.trial()
        start[list(self.few)] = at.start
        simulated = simulated_states(at.model, at.x, self.cut)
        start = best_states(at.model, at.x, self.cut, start, simulated, carried_states(at, self.cut))
        return one._replace(found=fit(at.model, self.cut, at.x, start, WHOLE, ended=ended))

    def _richer(self, some: Sequence[Runner]) -> list[Runner]:
        """Richer forms of friction, from the best set that has the plain one."""
        rubbed = sorted((one for one in some if _plainly_rubbed(one)), key=lambda one: one.found.cost)
        forms = [partial(form, one) for one in rubbed[:1] for form in (self._falling, self._on_bristles)]
        return list(self.each(lambda form: form(), forms))

    def _falling(self, one: Runner) -> Runner:
        """The same with friction that falls with the speed; it begins as one that hardly does."""
        at, ended = one.found, self.budget.trial()
        model = at.model.without("coulomb_friction").with_effect("stribeck_friction")
        values = at.model.values(at.x)
        level, speed = values["coulomb_friction.level"], model.scales.speed
        damping = 2.0 * values["zeta"] * values["omega_n"]
        speed = max(SLOWLY * speed, math.sqrt(2.0 * level * speed / (LITTLE * damping)))
        x = model.searched(values | {"stribeck_friction.level": level, "stribeck_friction.speed": speed})
        return one._replace(found=fit(model, self.cut, x, at.start, LAST, ended=ended))

    def _on_bristles(self, one: Runner) -> Runner:
        """The same with friction borne by bristles: best perhaps where plain friction is far from it."""
        at, ended = one.found, self.budget.trial()
        model, values = at.model.with_effect("lugre_friction"), at.model.values(at.x)
        bent = [cell for cell in self.plants(model, model.names) if "lugre_friction" in cell.causes]
        if bent:
            begin = begun_from(values, min(bent, key=lambda cell: cell.cost).values())
        else:
            begin = values | bristles(values["coulomb_friction.level"], model.scales.swing)
        x = model.searched(begin)
        return one._replace(found=fit(model, self.cut, x, at.start, LAST, ended=ended))

    def imitates(self, found: Fitted) -> bool:
        """A wave that stands for something else.

        A disturbance in step with the command is one line of the plant's own answer, if anything else is
        left. The longest ripple is a bend.
        """
        values = found.model.values(found.x)
        omega, wavenumber = (values.get(f"{name}.{of}") for name, of in WAVES.items())
        if omega is not None and found.excess > NOISE_ALONE and in_step(self.every, omega):
            return True
        longest = next(
            (c.low for c in found.model.coordinates if c.place == "position_ripple.wavenumber"), 0.0
        )
        return wavenumber is not None and wavenumber < BENT * longest

    def starts(self, parent: Fitted, name: str) -> tuple[Values, ...]:
        """Where to begin with an effect; with a wave at the lines of what the parent leaves."""
        searched = group(name, parent.model.scales)
        if name not in WAVES:
            return searched.starts
        size = 0.1 * searched.coordinates[0].scale
        begun = starts(name, self._lines(parent, name), size)
        return begun + self._shaken(parent, size) if name == SHAKEN else begun

    def _shaken(self, parent: Fitted, size: float) -> tuple[Values, ...]:
        """A disturbance where the plant swings, which is then damped: the parent may have taken it for that.

        A second one at the largest line near it that this one leaves: where it swings may be a fit of both.
        """
        values = parent.model.values(parent.x)
        own = values["omega_n"]
        if values["zeta"] >= SWINGS:
            return ()
        damped = replace(parent, x=parent.model.searched(values | {"zeta": SWINGS}))
        near = [line for line in self._lines(damped, SHAKEN) if abs(math.log(line / own)) < APART]
        return tuple(one | {"zeta": SWINGS} for one in starts(SHAKEN, [own, *near[:1]], size))

    def _lines(self, parent: Fitted, name: str) -> list[float]:
        """What the residual of all windows shows of a wave."""
        model, x, cut = parent.model, parent.x, self.every
        start = settle(model, cut, x, simulated_states(model, x, cut), cut.good, most=2)
        simulated, states = inside(model.record(x), cut, start)
        y, position, speed = cut.gathered("y"), states[:, 2], None
        residual = np.where(cut.good, y - simulated, 0.0)
        if model.sees_speed:  # as it was read: simulated ones have the parent's errors
            speed = np.where(cut.good, y, 0.0)
            position = np.concatenate([travelled(cut.series[k])[a:b] for k, a, b in cut.windows])
        return lines(name, cut, residual, position, speed)


def _plainly_rubbed(one: Runner) -> bool:
    """Whether friction was added that is the same at all speeds."""
    names = one.found.model.names
    return "coulomb_friction" in names and RICHER_FRICTION.isdisjoint(names)


def best_starts(some: Iterable[Runner]) -> list[Runner]:
    """Of each parent's every cause the one that came farthest, of a contact also from another plant."""
    best: dict[tuple[int, str], list[Runner]] = {}
    for one in sorted(some, key=lambda one: one.found.cost):
        kept = best.setdefault((id(one.parent), one.name), [])
        if not kept or (len(kept) == 1 and one.name in CONTACTS and elsewhere(one.found, kept[0].found)):
            kept.append(one)
    return [one for kept in best.values() for one in kept]


def elsewhere(one: Fitted, other: Fitted) -> bool:
    """Whether a fit that is not much worse than another of the same effects has another plant."""
    own, others = one.model.values(one.x), other.model.values(other.x)
    apart = max(abs(math.log(own[of] / others[of])) for of in ("omega_n", "zeta"))
    return one.cost < other.cost + NEAR and apart > APART


def _front(parents: Sequence[Fitted], some: Sequence[Runner], most: int) -> list[Runner]:
    """So many of each parent's causes, the best."""
    ranked, out = sorted(some, key=lambda one: one.found.cost), []
    for parent in parents:
        own = [one for one in ranked if one.parent is parent]
        names = list(dict.fromkeys(one.name for one in own))[:most]
        out += [one for one in own if one.name in names]
    return out


def screen(every: Cut, each: Each, budget: Budget) -> Screen:
    """Windows for trying causes, chosen from all windows to fit."""
    cut = sparse(sample(every, SCREENED_S))
    count = max(2, round(len(cut.windows) * PROBED_S / SCREENED_S))
    few = np.unique(np.linspace(0, len(cut.windows) - 1, count).round().astype(int))
    since = budget.clock()
    begun = cells(cut) if all(one.relayed for one in every.series) else ()
    budget.excuse(since)
    return Screen(every, cut, tuple(few.tolist()), each, budget, begun)
