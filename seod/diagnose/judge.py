"""A set of effects fitted to all windows, and what it is worth where no fit has seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from seod.diagnose.coordinates import begun_from
from seod.diagnose.fit import ENOUGH, STEPS, Fitted, fit
from seod.diagnose.left import ADEQUATE
from seod.diagnose.score import HeldOut, held_out, wholes
from seod.diagnose.states import alike_states, begun_states, carried_states

if TYPE_CHECKING:
    from seod.diagnose.answer import Array
    from seod.diagnose.screen import Screen
    from seod.diagnose.windows import Cut


ELSEWHERE: Final = 8
"""Steps of a fit from each other plant of the grid."""
UNEVEN: Final = 1.4
"""Squared error of a window over another's from which on they are not fitted alike."""
FINE_STEPS: Final = 40
FINE: Final = 1e-6
"""Improvement of the mean log error below which a fit has settled."""


@dataclass(frozen=True)
class Judged:
    """A set of effects fitted to all windows, and its simulation of those held out."""

    found: Fitted
    held: HeldOut

    @classmethod
    def of(cls, found: Fitted, aside: Cut) -> Self:
        """A fitted set, simulated where no fit has seen."""
        return cls(found, held_out(found.model, found.x, aside, *_known(found, aside)))

    @cached_property
    def whole(self) -> float:
        """NRMSE of one simulation of each whole recording."""
        return wholes(self.found.model, self.found.x, self.held.cut)[1]


def refined(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """The same fitted to all windows."""
    return _refined(found, cut, screen)


def settled(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """Likewise, to where hardly anything changes: along a bent valley steps gain little and lead far."""
    return _refined(found, cut, screen, FINE_STEPS, FINE)


def _refined(found: Fitted, cut: Cut, screen: Screen, most: int = STEPS, enough: float = ENOUGH) -> Fitted:
    model, ended = found.model, screen.budget.last_fit()

    def fitted(x: Array, steps: int) -> Fitted:
        start = begun_states(model, x, cut, *_known(found, cut))
        return fit(model, cut, x, start, steps, each=screen.each, ended=ended, enough=enough)

    best = fitted(found.x, most)
    if not _uneven(best):
        return best
    values = model.values(best.x)
    others = [model.searched(begun_from(values, cell.values())) for cell in screen.plants(model, model.names)]
    return min([best, *(fitted(x, ELSEWHERE) for x in others)], key=lambda one: one.cost)


def _uneven(found: Fitted) -> bool:
    """Whether it fits some windows and not the others, as another plant of its valley may."""
    square = found.error / found.cut.allowed**2
    return bool(np.min(square) < ADEQUATE and np.max(square) > UNEVEN * np.min(square))


def _known(found: Fitted, cut: Cut) -> list[Array]:
    """Initial states of windows by those that were fitted."""
    relayed = all(one.relayed for one in cut.series)
    return [carried_states(found, cut), *([alike_states(found, cut)] if relayed else [])]


def gain(fewer: Judged, more: Judged) -> float:
    """Of mean log squared error, where it is least: fitted, or held out, where half of it is enough."""
    held = fewer.held.log_error - more.held.log_error
    return min(fewer.found.cost - more.found.cost, 2.0 * held)
