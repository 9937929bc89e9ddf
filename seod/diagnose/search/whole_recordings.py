"""Sets of effects grown on whole recordings, where none explains the windows down to the noise.

Each window has an initial state of its own, which makes up for a part of what a wrong model does. Over a
whole recording it cannot. Simulations of it take long, so each start of a cause is tried by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.diagnose.causes.table import begun_from, further_causes, group, remote
from seod.diagnose.fitting.least_squares import Fitted, fit
from seod.diagnose.search.beam import as_well
from seod.diagnose.search.first_order_gain import ParentResidual, Promise
from seod.diagnose.search.race import imitates
from seod.diagnose.search.refine import refined
from seod.diagnose.starts.effect_starts import effect_starts
from seod.diagnose.tuning.search import BEAM, WHOLE_RECORDINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.search.screen import Screen


def widened(first: Fitted, screen: Screen, over: Callable[[], bool]) -> list[Fitted]:
    """Grow a set that was fitted to whole recordings, one effect at a time; the last one is the best.

    Args:
        first: The set.
        screen: Starts of causes.
        over: Tells when there is no time for more.
    """
    grown = [first]
    while len(grown[-1].model.names) < BEAM.most_effects and not over():
        parent = grown[-1]
        more = further_causes(parent.model.scales, parent.model.names)
        best = most_saving(parent, more, screen)[: WHOLE_RECORDINGS.fitted_causes] + far_starts(parent, more)
        saving = (
            one
            for one in _fitted(best, parent, screen, over)
            if one.cost < parent.cost - WHOLE_RECORDINGS.least_saving
        )
        found = next((one for one in saving if not over() and gains_in_windows(parent, one, screen)), None)
        if found is None:
            break
        grown.append(found)
    return grown


def one_more(parent: Fitted, screen: Screen, over: Callable[[], bool], most: int) -> list[Fitted]:
    """A set fitted to whole recordings with each of so many causes more, those that promise most."""
    if len(parent.model.names) >= WHOLE_RECORDINGS.most_effects or over():
        return []
    more = further_causes(parent.model.scales, parent.model.names)
    return _fitted(most_saving(parent, more, screen)[:most], parent, screen, over)


def gains_in_windows(fewer: Fitted, more: Fitted, screen: Screen) -> bool:
    """Whether windows gain by what one effect more saves of whole recordings.

    There a single event shifts all that comes after it, where the plant integrates: whatever happens to make
    up for that event saves much. Windows show an effect wherever it is.
    """
    cut = screen.every
    return refined(more, cut, screen).cost < refined(fewer, cut, screen).cost - as_well(cut)


def _fitted(
    best: Sequence[Promise], parent: Fitted, screen: Screen, over: Callable[[], bool]
) -> list[Fitted]:
    """What a few steps make of each, and some more of the better ones; the best first."""
    cut = parent.cut

    def tried(promise: Promise) -> Fitted:
        enough = screen.budget.later_trial()
        return fit(promise.model, cut, promise.x, parent.start, ended=lambda: over() or enough())

    def finished(fitted: Fitted) -> Fitted:
        enough = screen.budget.last_fit()
        return fit(fitted.model, cut, fitted.x, fitted.start, ended=lambda: over() or enough())

    begun = [one for one in screen.parallel(tried, best) if not imitates(one, screen.every)]
    begun.sort(key=_cost)
    done = [
        *screen.parallel(finished, begun[: WHOLE_RECORDINGS.finished_causes]),
        *begun[WHOLE_RECORDINGS.finished_causes :],
    ]
    return sorted((one for one in done if not imitates(one, screen.every)), key=_cost)


def _cost(fitted: Fitted) -> float:
    return fitted.cost


def most_saving(parent: Fitted, causes: Sequence[str], screen: Screen) -> list[Promise]:
    """Causes by what they promise to save, the most first; each from the best of its starts."""
    ahead = ParentResidual(parent)
    trials = [(name, start) for name in causes for start in effect_starts(parent, name, screen.every)]
    best: dict[str, Promise] = {}
    for name, promise in screen.parallel(lambda trial: (trial[0], ahead.promise(*trial)), trials):
        if name not in best or promise.saves > best[name].saves:
            best[name] = promise
    return sorted(best.values(), key=lambda one: -one.saves)


def far_starts(parent: Fitted, causes: Sequence[str]) -> list[Promise]:
    """Starts far from the parent's own parameters, of which a direction tells nothing."""
    out = []
    for name in causes:
        for start in group(name, parent.model.scales).starts:
            if remote(start):
                model = parent.model.with_effect(name)
                x = model.searched(begun_from(parent.model.values(parent.x), start))
                out.append(Promise(model, x, math.nan, 1))
    return out
