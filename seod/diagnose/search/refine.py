"""A set of effects fitted to all windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.causes.table import begun_from
from seod.diagnose.fitting.held_out import ADEQUATE
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.judged import known_states
from seod.diagnose.fitting.least_squares import LEAST_IMPROVEMENT, MOST_STEPS, Fitted, fit
from seod.diagnose.record.windows import Cut, segments

if TYPE_CHECKING:
    from seod.diagnose.fitting.least_squares import Each
    from seod.diagnose.result import Array
    from seod.diagnose.search.screen import Screen


STEPS_ELSEWHERE: Final = 8
"""Steps of a fit from each other plant of the grid."""
UNEVEN_ERRORS: Final = 1.4
"""Squared error of a window over another's from which on they are not fitted alike."""
FEWEST_SAMPLES: Final = 50
"""Of a segment whose other rows are held out: with fewer its initial state is all that they tell."""
FINE_STEPS: Final = 40
FINE_IMPROVEMENT: Final = 1e-6
"""Improvement of the mean log error below which a fit has settled."""


def refined(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """The same fitted to all windows."""
    return _refined(found, cut, screen)


def settled(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """Likewise, to where hardly anything changes: along a bent valley steps gain little and lead far."""
    return _refined(found, cut, screen, FINE_STEPS, FINE_IMPROVEMENT)


def fitted_over_all(found: Fitted, cut: Cut, each: Each) -> Fitted:
    """The same numbers fitted to more windows, from initial states that are settled first."""
    small = segments(cut)
    good = small.good
    small = small.only(k for k, rows in enumerate(small.slices) if good[rows].sum() > FEWEST_SAMPLES)
    start = begun_states(found.model, found.x, small)
    return fit(found.model, small, found.x, start, FINE_STEPS, each=each, enough=FINE_IMPROVEMENT)


def _refined(
    found: Fitted, cut: Cut, screen: Screen, most: int = MOST_STEPS, enough: float = LEAST_IMPROVEMENT
) -> Fitted:
    model, ended = found.model, screen.budget.last_fit()

    def fitted(x: Array, steps: int) -> Fitted:
        start = begun_states(model, x, cut, *known_states(found, cut))
        return fit(model, cut, x, start, steps, each=screen.each, ended=ended, enough=enough)

    best = fitted(found.x, most)
    if not _uneven(best):
        return best
    values = model.values(best.x)
    others = [
        model.searched(begun_from(values, plant.values())) for plant in screen.plants(model, model.names)
    ]
    return min([best, *(fitted(x, STEPS_ELSEWHERE) for x in others)], key=lambda one: one.cost)


def _uneven(found: Fitted) -> bool:
    """Whether it fits some windows and not the others, as another plant of its valley may."""
    square = found.error / found.cut.allowed**2
    return bool(np.min(square) < ADEQUATE and np.max(square) > UNEVEN_ERRORS * np.min(square))
