"""Which of the sets that were found: fitted to all windows, thinned out, compared where no fit has seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from seod.diagnose.begin import simulated_states
from seod.diagnose.fit import Fitted, fit
from seod.diagnose.left import ADEQUATE
from seod.diagnose.score import HeldOut, held_out, wholes
from seod.diagnose.select import GAIN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.screen import Screen
    from seod.diagnose.select import Grown
    from seod.diagnose.windows import Cut

FINALISTS: Final = 3
"""Sets that are fitted to all windows."""
LOOKED_AT: Final = 12
"""Sets of each size whose held-out error is looked at, where none comes down to the noise."""
MISFIT_GAIN: Final = 0.1
"""What an effect must save there, where any effect takes up a little of what is wrong."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A set of effects fitted to all windows, and its simulation of those held out."""

    found: Fitted
    held: HeldOut

    @classmethod
    def of(cls, found: Fitted, aside: Cut) -> Self:
        """A fitted set, simulated where no fit has seen."""
        return cls(found, held_out(found.model, found.x, aside))

    @property
    def whole(self) -> float:
        """NRMSE of one simulation of each whole recording."""
        return wholes(self.found.model, self.found.x, self.held.cut)[1]


def choose(
    base: Judged, grown: Grown, cut: Cut, aside: Cut, screen: Screen
) -> tuple[Judged, dict[str, Judged]]:
    """The best set and of its effects the set without each; never one that simulates worse than the baseline.

    Where a set comes down to the noise what was fitted decides. Where none does, initial states and effects
    make up for each other in the windows, and the windows held out and the whole recording decide.
    """
    complete = [refined(each, cut, screen) for each in finalists(grown.best) if each.model.names]
    least = GAIN
    if complete:
        best = Judged.of(min(complete, key=lambda one: one.cost), aside)
        if best.held.adequacy > ADEQUATE:
            least = MISFIT_GAIN
            rivals = [
                Judged.of(refined(each, cut, screen), aside) for each in _looked_at(grown, aside, screen)
            ]
            best = min((best, *rivals, base), key=_unseen)
    else:
        best = base
    own, rest = thinned(best, cut, aside, screen, least)
    return (base, {}) if worse(own, base) else (own, rest)


def worse(one: Judged, base: Judged) -> bool:
    """Whether a set simulates windows held out, or the whole recording, worse than the baseline.

    One that leaves the noise alone may: over a whole recording a plant that integrates drifts by chance.
    """
    if one.held.nrmse > base.held.nrmse:
        return True
    return one.held.adequacy > ADEQUATE and one.whole > base.whole


def _unseen(one: Judged) -> float:
    """Log squared errors of windows held out and of one simulation of the whole recording."""
    return 2.0 * math.log(one.held.nrmse + 1e-300) + 2.0 * math.log(one.whole + 1e-300)


def _looked_at(grown: Grown, aside: Cut, screen: Screen) -> list[Fitted]:
    """Of the better sets of each size, large ones first, those with the least error on windows held out."""
    over, held = screen.budget.looking(), []
    for one in _better(grown):
        if over():
            break
        held.append((held_out(one.model, one.x, aside).nrmse, one))
    return [one for _, one in sorted(held, key=lambda pair: pair[0])[:FINALISTS]]


def _better(grown: Grown) -> list[Fitted]:
    some: list[Fitted] = []
    for size in sorted({len(one.model.names) for one in grown.best} - {0}, reverse=True):
        own = [one for one in grown.best if len(one.model.names) == size]
        some += sorted(own, key=lambda one: one.cost)[:LOOKED_AT]
    return some


def refined(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """The same fitted to all windows."""
    start = simulated_states(found.model, found.x, cut)
    return fit(found.model, cut, found.x, start, each=screen.each, ended=screen.budget.last_fit())


def without(found: Fitted, name: str, cut: Cut, screen: Screen) -> Fitted:
    """A set without one of its effects, fitted anew."""
    model = found.model.without(name)
    x = model.searched(found.model.values(found.x))
    start = simulated_states(model, x, cut)
    return fit(model, cut, x, start, each=screen.each, ended=screen.budget.last_fit())


def thinned(
    own: Judged, cut: Cut, aside: Cut, screen: Screen, enough: float = GAIN
) -> tuple[Judged, dict[str, Judged]]:
    """Without the effects that gain too little, and of those left the set without each.

    They have to gain where they were fitted (`cut`), and on the windows held out (`aside`).
    """
    while True:
        rest = {name: _left(own.found, name, cut, aside, screen) for name in own.found.model.names}
        if not rest:
            return own, {}
        least = min(rest.values(), key=lambda one: _gain(one, own))
        if _gain(least, own) >= enough:
            return own, rest
        own = least


def _left(found: Fitted, name: str, cut: Cut, aside: Cut, screen: Screen) -> Judged:
    return Judged.of(without(found, name, cut, screen), aside)


def _gain(fewer: Judged, more: Judged) -> float:
    """Of mean log squared error, where it is least: fitted, or held out, where half of it is enough."""
    held = fewer.held.log_error - more.held.log_error
    return min(fewer.found.cost - more.found.cost, 2.0 * held)


def finalists(best: Sequence[Fitted]) -> list[Fitted]:
    """Sets that deserve a fit to all windows: those near the best, smaller ones first."""
    near = [one for one in best if one.cost < best[0].cost + 2.0 * GAIN]
    return sorted(near, key=lambda one: (len(one.model.names), one.cost))[:FINALISTS]
