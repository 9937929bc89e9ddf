"""Which of the sets that were found: fitted to all windows, thinned out, compared where no fit has seen."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.causes.table import SOLVED
from seod.diagnose.fitting.judged import Judged, loses_its_place
from seod.diagnose.record.windows import hardly_settle, undivided
from seod.diagnose.search.beam import as_well, least_gain
from seod.diagnose.search.noise_alone import in_its_noise, nothing_promised
from seod.diagnose.search.prune import best_alike, best_placed, plainer, thinned
from seod.diagnose.search.refine import refined, settled
from seod.diagnose.search.whole_recordings import one_more, widened
from seod.diagnose.starts.baseline import unchanged
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.search import FINAL_CHOICE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.search.beam import Grown
    from seod.diagnose.search.prune import Tried
    from seod.diagnose.search.screen import Screen


class Choice(NamedTuple):
    """The best set, the baseline it is compared with, and of the set's effects the set without each.

    `enough` is what an effect had to save.
    """

    base: Judged
    best: Judged
    without: dict[str, Judged]
    enough: float

    def less(self, name: str, tried: Tried, held_out: Cut, screen: Screen) -> Choice:
        """The same without one of the effects, and without those that gain too little then."""
        own, rest = _simplest(self.without[name], self.base, tried, held_out, screen, self.enough)
        return self._replace(best=own, without=rest).no_worse()

    def no_worse(self) -> Choice:
        """The baseline where the set simulates worse."""
        return self._replace(best=self.base, without={}) if worse(self.best, self.base) else self


def choose(base: Judged, grown: Grown, cut: Cut, held_out: Cut, screen: Screen) -> Choice:
    """The best set; never one that simulates worse than the baseline.

    Where a set comes down to the noise what was fitted decides. Where none does, initial states and effects
    make up for each other in the windows: whole recordings are fitted, without the rows held out, and the
    errors of both decide, of sets and of baselines.
    """
    complete = _refined([each for each in finalists(grown.best) if each.model.names], cut, screen)
    best, least = (Judged.of(plainest(complete), held_out) if complete else base), least_gain(cut)
    tried = dict(grown.tried)
    more = best.held.adequacy > HELD_OUT.adequate and not _nothing_more(best.found, undivided(cut), screen)
    if more:
        best = best_alike(best, held_out, screen)
    if more and best.held.adequacy > HELD_OUT.adequate:
        over = screen.budget.whole_recording_fits()
        plain, sets = _over_whole(base.found, grown, undivided(cut), held_out, screen, over)
        best, base = _least((best, *sets), screen), _least((base, plain), screen)
        best = best_placed(best, held_out, screen)
        if hardly_settle(held_out):
            best = _climbed(best, held_out, screen, over)
        least = FINAL_CHOICE.misfit_gain
        worst_first = sorted((one.found for one in (plain, *sets)), key=lambda one: -one.cost)
        tried |= {frozenset(one.model.names): one for one in worst_first}
    if not more and best.found.model.names:
        best = _by_its_noise(best, held_out, screen)
    own, rest = _simplest(best, base, tried, held_out, screen, least)
    if own.found.model.names and own.held.adequacy <= HELD_OUT.adequate:
        own = Judged.of(settled(own.found, own.found.cut, screen), held_out)
    return Choice(base, own, rest, least).no_worse()


def _simplest(
    best: Judged, base: Judged, tried: Tried, held_out: Cut, screen: Screen, enough: float
) -> tuple[Judged, dict[str, Judged]]:
    """Plain forms and no effect too many, until neither is left: without others a plain form may do."""
    above = _above_offset(base, tried, held_out)
    while True:
        plain = plainer(best, held_out, screen, enough)
        own, rest = thinned(plain, tried, held_out, screen, enough, above)
        if own is best:
            return own, rest
        best = own


def _above_offset(base: Judged, tried: Tried, held_out: Cut) -> float:
    """Squared error above the noise of Eq. 1, with a load where one was tried.

    An offset throws it anywhere, and of that other effects have next to no share.
    """
    sets = [tried.get(frozenset({name})) for name in SOLVED]
    loaded = [Judged.of(one, held_out).held for one in sets if one is not None]
    return min(above_noise(each) for each in (base.held, *loaded))


def _by_its_noise(best: Judged, held_out: Cut, screen: Screen) -> Judged:
    """The set fitted anew by what noise like that which it leaves does not foretell of errors.

    Noise that remembers bends a fit of errors by more than a simpler set or an alike cause differs.
    """
    cut = in_its_noise(best.found)
    if cut is best.found.cut:
        return best
    found = refined(best.found, cut, screen)
    return best_alike(Judged.of(found, held_out), held_out, screen)


def _nothing_more(found: Fitted, wide: Cut, screen: Screen) -> bool:
    """Whether nothing more is promised of windows, nor of whole recordings.

    These show what is slow, an offset of the sensor, too, which no cause is.
    """
    if not nothing_promised(found, screen):
        return False
    return nothing_promised(refined(found, wide, screen), screen, beside_slow=True)


def _over_whole(
    base: Fitted, grown: Grown, wide: Cut, held_out: Cut, screen: Screen, over: Callable[[], bool]
) -> tuple[Judged, list[Judged]]:
    """Baseline, and sets, fitted to whole recordings: those that were found, and what grows from there.

    They grow from the plant of the windows: fitted to whole recordings alone it may oscillate of its own.
    """
    root = unchanged(replace(base.model, scales=grown.best[-1].model.scales), base.x, wide)
    first, *others = _looked_at(grown)
    plain, *sets = _refined([base, *first], wide, screen)
    for more in others:
        sets += [] if over() else _refined(more, wide, screen)
    for parent in (root, *sorted(sets, key=lambda one: one.cost)[:1]):
        sets += widened(parent, screen, over)[1:]
    plainly, *judged = screen.parallel(lambda one: Judged.of(one, held_out), (plain, *sets))
    return plainly, judged


def _climbed(best: Judged, held_out: Cut, screen: Screen, over: Callable[[], bool]) -> Judged:
    """With whichever effect more errs least where no fit has seen, as long as that is much less.

    Of few rows flexible effects take up most of what is left, and foretell little of the others.
    """
    while True:
        some = one_more(best.found, screen, over, FINAL_CHOICE.climbed_causes)
        judged = list(screen.parallel(lambda one: Judged.of(one, held_out), some))
        least = _least((best, *judged), screen)
        errors = _errors_of((best, least))
        if errors(best) - errors(least) < FINAL_CHOICE.misfit_gain:
            return best
        best = least


def _refined(some: Sequence[Fitted], cut: Cut, screen: Screen) -> list[Fitted]:
    return list(screen.parallel(lambda one: refined(one, cut, screen), some))


def _looked_at(grown: Grown) -> list[list[Fitted]]:
    """The best set of every size, then the next best of each."""
    ranks: list[list[Fitted]] = [[] for _ in range(FINAL_CHOICE.of_size)]
    for size in {len(one.model.names) for one in grown.tried.values()}:
        own = [one for one in grown.tried.values() if len(one.model.names) == size]
        for rank, one in zip(ranks, sorted(own, key=lambda one: one.cost), strict=False):
            rank.append(one)
    return ranks


def above_noise(held: HeldOut) -> float:
    """Squared NRMSE above the noise; of a baseline that errs more than a mean that of the mean, 1."""
    return max(0.0, min(held.nrmse, 1.0) ** 2 - held.floor**2)


def worse(judged: Judged, base: Judged) -> bool:
    """Whether a set simulates windows held out, or the whole recording, worse than the baseline.

    One that leaves the noise alone may: over a whole recording a plant that integrates drifts by chance. And
    a baseline that is no nearer to the whole than a mean says nothing of it, nor a wave that loses its place.
    """
    if judged.held.rms > base.held.rms:
        return True
    if judged.held.adequacy <= HELD_OUT.adequate or base.whole >= 1.0 or judged.whole <= base.whole:
        return False
    model = judged.found.model
    return not any(loses_its_place(model, name) for name in model.names)


def _least(some: Sequence[Judged], screen: Screen) -> Judged:
    """The one that errs least."""
    return some[int(np.argmin(list(screen.parallel(_errors_of(some), some))))]


def _errors_of(some: Sequence[Judged]) -> Callable[[Judged], float]:
    """Log squared error of windows held out, and of one simulation of the whole recording.

    But for that one where a wave among the sets loses its place in it: it would speak for sets without.
    """
    in_windows_alone = any(
        loses_its_place(one.found.model, name) for one in some for name in one.found.model.names
    )

    def errors(judged: Judged) -> float:
        held = 2.0 * math.log(judged.held.nrmse + 1e-300)
        return held if in_windows_alone else held + 2.0 * math.log(judged.whole + 1e-300)

    return errors


def plainest(some: Sequence[Fitted]) -> Fitted:
    """The one with the fewest parameters of those that fit as well as the best."""
    least = min(one.cost for one in some)
    alike = [one for one in some if one.cost < least + as_well(one.cut)]
    return min(alike, key=lambda one: (len(one.x), one.cost))


def finalists(best: Sequence[Fitted]) -> list[Fitted]:
    """Sets that deserve a fit to all windows: those near the best, smaller ones first."""
    reach = FINAL_CHOICE.near_best
    near = [one for one in best if one.cost < best[0].cost + reach * least_gain(best[0].cut)]
    return sorted(near, key=lambda one: (len(one.model.names), one.cost))[: FINAL_CHOICE.finalists]
