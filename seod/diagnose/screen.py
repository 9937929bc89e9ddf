"""One effect more: every cause tried from every start, the promising ones fitted further."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.begin import simulated_states
from seod.diagnose.command_period import in_step
from seod.diagnose.coordinates import WAVES, further_causes, group
from seod.diagnose.fit import Fitted, fit, settle
from seod.diagnose.simulate import inside
from seod.diagnose.waves import lines, starts
from seod.diagnose.windows import Cut, sample

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seod.diagnose.answer import Array
    from seod.diagnose.budget import Budget
    from seod.diagnose.coordinates import Values
    from seod.diagnose.fit import Each
    from seod.diagnose.model import Model

PROBED_S: Final = 3.0
"""Of windows on which every start is tried."""
SCREENED_S: Final = 6.0
"""Of windows on which the better causes are fitted."""
GLANCE: Final = 2
"""Steps from every start."""
FAR: Final = 12
"""Steps from one whose K_L and zeta are far from the baseline's."""
LOOK: Final = 3
"""Further steps of the better causes."""
WHOLE: Final = 4
"""Steps of the promising ones on all windows for trying."""
STEPS: Final = 12
"""Further steps of the best."""
CAUSES: Final = 12
"""Causes of a parent that are looked at."""
BENT: Final = 1.02
"""Wavenumbers of a ripple over the least, up to which the least has stopped it."""
PROMISING: Final = 8
"""Causes of a parent that are fitted to all windows for trying."""
FRONT: Final = 4
NEAR: Final = 1.0
"""Sets that are fitted to the end, at least; the others whose mean log error is that near the best."""


class _Entrant(NamedTuple):
    """An effect more for a parent, from this start."""

    parent: Fitted
    name: str
    start: Values


class _Runner(NamedTuple):
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
    """

    every: Cut
    cut: Cut
    few: tuple[int, ...]
    each: Each
    budget: Budget

    def start(self, parent: Model, x: Array) -> Array:
        """Initial states on `cut` for a model fitted elsewhere, shape (w, 7)."""
        return settle(parent, self.cut, x, simulated_states(parent, x, self.cut), self.cut.good)

    def extended(self, parents: Sequence[Fitted], but: Sequence[str] = ()) -> list[Fitted]:
        """Each parent with one effect more, but these; the best first.

        A race: after each round only the better ones of a parent are fitted further.
        """
        begun = [each for parent in parents for each in self._entrants(parent, but)]
        seen = _best_starts(one for one in self.each(self._glanced, begun) if one is not None)
        seen = list(self.each(lambda one: self._on(one, LOOK), _front(parents, seen, CAUSES)))
        whole = list(self.each(self._whole, _front(parents, seen, PROMISING)))
        ranked = sorted(whole, key=lambda one: one.found.cost)
        last = sum(one.found.cost < ranked[0].found.cost + NEAR for one in ranked)
        last = max(last, FRONT)
        better = [*self.each(lambda one: self._on(one, STEPS), ranked[:last]), *ranked[last:]]
        found = [one.found for one in better if not self.imitates(one.found)]
        return sorted(found, key=lambda one: one.cost)

    def _entrants(self, parent: Fitted, but: Sequence[str]) -> list[_Entrant]:
        names = further_causes(parent.model.scales, parent.model.names)
        return [
            _Entrant(parent, name, start)
            for name in names
            if name not in but
            for start in self.starts(parent, name)
            if not (parent.model.names and remote(start))
        ]

    def _glanced(self, one: _Entrant) -> _Runner | None:
        """After a few steps on few windows; None where no time is left."""
        if self.budget.spent:
            return None
        parent, few = one.parent, list(self.few)
        model = parent.model.with_effect(one.name)
        x = model.searched(begun_from(parent.model.values(parent.x), one.start))
        most = FAR if remote(one.start) else GLANCE
        ended = self.budget.trial()
        found = fit(model, self.cut.only(few), x, parent.start[few], most, ended=ended)
        return _Runner(parent, one.name, found)

    def _on(self, one: _Runner, most: int) -> _Runner:
        """So many steps more where it is."""
        at, ended = one.found, self.budget.trial()
        return one._replace(found=fit(at.model, at.cut, at.x, at.start, most, ended=ended))

    def _whole(self, one: _Runner) -> _Runner:
        """On all windows for trying."""
        at, start, ended = one.found, self._spread(one.parent, one.found), self.budget.trial()
        return one._replace(found=fit(at.model, self.cut, at.x, start, WHOLE, ended=ended))

    def imitates(self, found: Fitted) -> bool:
        """A wave that stands for something else.

        A disturbance in step with the command is the plant's own answer, the longest ripple a bend.
        """
        values = found.model.values(found.x)
        omega, wavenumber = (values.get(f"{name}.{of}") for name, of in WAVES.items())
        if omega is not None and in_step(self.every, omega):
            return True
        longest = next(
            (c.low for c in found.model.coordinates if c.place == "position_ripple.wavenumber"), 0.0
        )
        return wavenumber is not None and wavenumber < BENT * longest

    def _spread(self, parent: Fitted, found: Fitted) -> Array:
        start = parent.start.copy()
        start[list(self.few)] = found.start
        return start

    def starts(self, parent: Fitted, name: str) -> tuple[Values, ...]:
        """Where to begin with an effect; with a wave at the lines of what the parent leaves."""
        searched = group(name, parent.model.scales)
        if name not in WAVES:
            return searched.starts
        return starts(name, self._lines(parent, name), 0.1 * searched.coordinates[0].scale)

    def _lines(self, parent: Fitted, name: str) -> list[float]:
        """What the residual of all windows shows of a wave."""
        model, x, cut = parent.model, parent.x, self.every
        start = settle(model, cut, x, simulated_states(model, x, cut), cut.good, most=2)
        simulated, states = inside(model.record(x), cut, start)
        residual = np.where(cut.good, cut.gathered("y") - simulated, 0.0)
        speed = states[:, 1] if model.sees_speed else None
        return lines(name, cut, residual, states[:, 2], speed)


def _best_starts(some: Iterable[_Runner]) -> list[_Runner]:
    """Of each parent's every cause the one that came farthest."""
    best: dict[tuple[int, str], _Runner] = {}
    for one in some:
        key = id(one.parent), one.name
        if key not in best or one.found.cost < best[key].found.cost:
            best[key] = one
    return list(best.values())


def _front(parents: Sequence[Fitted], some: Sequence[_Runner], most: int) -> list[_Runner]:
    """So many of each parent's, the best."""
    ranked = sorted(some, key=lambda one: one.found.cost)
    return [one for parent in parents for one in [o for o in ranked if o.parent is parent][:most]]


def remote(start: Values) -> bool:
    """Whether a start is far from the parent's own plant."""
    return "*K_L" in start


def begun_from(values: Values, start: Values) -> Values:
    """A parent's parameters with those of a start, and its factors."""
    factors = {place: start.get(f"*{place}", 1.0) for place in values}
    return {place: value * factors[place] for place, value in values.items()} | start


def screen(every: Cut, each: Each, budget: Budget) -> Screen:
    """Windows for trying causes, chosen from all windows to fit."""
    cut = sample(every, SCREENED_S)
    count = max(2, round(len(cut.windows) * PROBED_S / SCREENED_S))
    few = np.unique(np.linspace(0, len(cut.windows) - 1, count).round().astype(int))
    return Screen(every, cut, tuple(few.tolist()), each, budget)
