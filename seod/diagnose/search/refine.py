"""A set of effects fitted to all windows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.causes.table import begun_from
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.judged import known_states
from seod.diagnose.fitting.least_squares import Fitted, fit
from seod.diagnose.record.windows import Cut, segments
from seod.diagnose.tuning.fitting import FIT, HELD_OUT
from seod.diagnose.tuning.search import REFINE

if TYPE_CHECKING:
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.result import Array
    from seod.diagnose.search.screen import Screen


def refined(
    found: Fitted, cut: Cut, screen: Screen, most: int = FIT.most_steps, enough: float = FIT.least_improvement
) -> Fitted:
    """The same set fitted to these windows; where it fits some of them alone, also from the grid's plants."""
    model, ended = found.model, screen.budget.last_fit()

    def fitted(x: Array, steps: int) -> Fitted:
        start = begun_states(model, x, cut, *known_states(found, cut))
        return fit(model, cut, x, start, steps, parallel=screen.parallel, ended=ended, enough=enough)

    best = fitted(found.x, most)
    if not _uneven(best):
        return best
    values = model.values(best.x)
    others = [
        model.searched(begun_from(values, plant.values())) for plant in screen.plants(model, model.names)
    ]
    return min([best, *(fitted(x, REFINE.steps_elsewhere) for x in others)], key=lambda one: one.cost)


def settled(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """Likewise, to where hardly anything changes: along a bent valley steps gain little and lead far."""
    return refined(found, cut, screen, REFINE.fine_steps, REFINE.fine_improvement)


def fitted_over_all(fitted: Fitted, cut: Cut, parallel: ParallelMap) -> Fitted:
    """The same numbers fitted to more windows, from initial states that are settled first."""
    small = segments(cut)
    good = small.good
    small = small.only(k for k, rows in enumerate(small.slices) if good[rows].sum() > REFINE.fewest_samples)
    start = begun_states(fitted.model, fitted.x, small)
    return fit(
        fitted.model,
        small,
        fitted.x,
        start,
        REFINE.fine_steps,
        parallel=parallel,
        enough=REFINE.fine_improvement,
    )


def _uneven(fitted: Fitted) -> bool:
    """Whether it fits some windows and not the others, as another plant of its valley may."""
    square = fitted.error / fitted.cut.allowed**2
    return bool(np.min(square) < HELD_OUT.adequate and np.max(square) > REFINE.uneven_errors * np.min(square))
