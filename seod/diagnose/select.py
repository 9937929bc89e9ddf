"""Which set of effects: a beam of the best sets, grown by one effect at a time, then thinned out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.begin import simulated_states
from seod.diagnose.coordinates import searched_causes
from seod.diagnose.fit import Fitted, fit
from seod.diagnose.score import HeldOut, held_out

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.screen import Screen
    from seod.diagnose.windows import Cut

BEAM: Final = 3
"""Sets that are kept."""
MOST: Final = 4
"""Effects in a set."""
GAIN: Final = 0.02
"""Mean log squared error that an effect must save; on clean recordings the best saves some 0.002."""
ADEQUATE: Final = 1.03
"""Squared error over the noise's, at which the search ends: the noise is known to some percent."""
FINALISTS: Final = 3


def excess(found: Fitted, cut: Cut) -> float:
    """Geometric mean of the windows' squared errors over the noise's."""
    weights = cut.sizes / cut.sizes.sum()
    return float(np.exp(found.cost - weights @ np.log(cut.noise**2)))


@dataclass(frozen=True, slots=True)
class Judged:
    """A set of effects fitted to all windows, and its simulation of those held out."""

    found: Fitted
    held: HeldOut


@dataclass
class Grown:
    """Sets of effects that were fitted.

    Attributes:
        best: The best first, the baseline last.
        tried: All of them by their effects.
    """

    best: list[Fitted]
    tried: dict[frozenset[str], Fitted] = field(default_factory=dict)


def grow(screen: Screen, roots: Sequence[Fitted], progress: Callable[[float], None]) -> Grown:
    """Add one effect at a time to the best sets, until they are adequate or nothing gains any more.

    Args:
        screen: Where causes are tried.
        roots: The baseline, and others of the same form to begin from.
        progress: Called with the part of the work that is done.
    """
    causes = searched_causes(roots[0].model.scales)
    grown, beam = Grown([roots[0]]), list(roots)
    for size in range(1, MOST + 1):
        if excess(grown.best[0], screen.cut) < ADEQUATE:
            break
        found: dict[frozenset[str], Fitted] = {}
        for parent in beam:
            for child in screen.extended(parent, [c for c in causes if c not in parent.model.names]):
                key = frozenset(child.model.names)
                if key not in found or child.cost < found[key].cost:
                    found[key] = child
        grown.tried |= found
        ranked = sorted(found.values(), key=lambda one: one.cost)
        if not ranked or ranked[0].cost > grown.best[0].cost - GAIN:
            break
        grown.best, beam = [*ranked, *grown.best], ranked[:BEAM]
        progress(size / MOST)
    return grown


def refined(found: Fitted, cut: Cut, screen: Screen) -> Fitted:
    """The same fitted to all windows."""
    start = simulated_states(found.model, found.x, cut)
    return fit(found.model, cut, found.x, start, each=screen.each)


def without(found: Fitted, name: str, cut: Cut, screen: Screen) -> Fitted:
    """A set without one of its effects, fitted anew."""
    model = found.model.without(name)
    x = model.searched(found.model.values(found.x))
    return fit(model, cut, x, simulated_states(model, x, cut), each=screen.each)


def thinned(found: Fitted, cut: Cut, aside: Cut, screen: Screen) -> tuple[Judged, dict[str, Judged]]:
    """Without the effects that gain too little, and of those left the set without each.

    They have to gain where they were fitted (`cut`), and on the windows held out (`aside`).
    """
    own = Judged(found, held_out(found.model, found.x, aside))
    while True:
        rest = {name: _left(own.found, name, cut, aside, screen) for name in own.found.model.names}
        if not rest:
            return own, {}
        least = min(rest.values(), key=lambda one: _gain(one, own))
        if _gain(least, own) >= GAIN:
            return own, rest
        own = least


def _left(found: Fitted, name: str, cut: Cut, aside: Cut, screen: Screen) -> Judged:
    fewer = without(found, name, cut, screen)
    return Judged(fewer, held_out(fewer.model, fewer.x, aside))


def _gain(fewer: Judged, more: Judged) -> float:
    """Of mean log squared error, where it is least: fitted, or held out, where half of it is enough."""
    held = fewer.held.log_error - more.held.log_error
    return min(fewer.found.cost - more.found.cost, 2.0 * held)


def finalists(best: Sequence[Fitted]) -> list[Fitted]:
    """Sets that deserve a fit to all windows: those near the best, smaller ones first."""
    near = [one for one in best if one.cost < best[0].cost + 2.0 * GAIN]
    return sorted(near, key=lambda one: (len(one.model.names), one.cost))[:FINALISTS]
