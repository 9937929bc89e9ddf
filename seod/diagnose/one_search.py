"""One search: causes of what a baseline leaves in windows to fit, and the numbers as they are reported."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.account.account import accounted
from seod.diagnose.account.prediction_errors import Predicted, Predictions, in_closed_loop, is_moved
from seod.diagnose.fitting.free_run import fitted_in_one_run, fitted_to_all_rows
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.load_drift import drifting_load
from seod.diagnose.record.windows import (
    Cut,
    all_but,
    all_windows,
    can_be_scored,
    cut,
    exchanged,
    fitted_windows,
)
from seod.diagnose.result import DiagnoseError
from seod.diagnose.search.beam import grow
from seod.diagnose.search.final_choice import Choice, choose
from seod.diagnose.search.refine import fitted_over_all
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import BaselineFits, Fixed, baseline
from seod.diagnose.starts.search_roots import also_from, hidden_by_offset, search_roots
from seod.diagnose.starts.sizes import scales
from seod.diagnose.starts.twins import beside_all_shown
from seod.diagnose.tuning.account import PREDICTION
from seod.diagnose.tuning.fitting import FREE_RUN, HELD_OUT
from seod.diagnose.tuning.verdict import ANSWER, PIPELINE
from seod.diagnose.verdict.answer import Findings
from seod.diagnose.verdict.effects import Chosen, found_effects, without_a_size

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.switch_times import SwitchTimes
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.closed_form import ClosedForm
    from seod.diagnose.record.series import Series
    from seod.diagnose.search.beam import Grown
    from seod.diagnose.search.budget import Budget
    from seod.diagnose.search.other_timing import OtherTiming
    from seod.diagnose.search.screen import Screen

    Progress = Callable[[str, float], None]


class SearchSetup(NamedTuple):
    """How causes are searched.

    `fixed` are effects of the rig's model, and what the user tells. `exchanged`: windows are fitted that are
    held out otherwise, and the reverse.
    """

    sees_speed: bool
    fixed: Fixed
    parallel: ParallelMap
    budget: Budget
    progress: Progress
    exchanged: bool = False


class SearchStart(NamedTuple):
    """Where causes are searched: windows to fit, windows held out, and Eq. 1 on them."""

    to_fit: Cut
    held_out: Cut
    screened: Screen
    begun: BaselineFits
    base: Judged


class SearchResult(NamedTuple):
    """Where causes are searched, all windows that no fit sees, what was found, and what that used.

    `timed` is when commands were given, where that was found; `exchanged`: the halves of the windows were.
    """

    start: SearchStart
    unseen: Cut
    findings: Findings
    budget: Budget
    timed: OtherTiming | SwitchTimes | None = None
    exchanged: bool = False


def search_once(
    every: tuple[Sequence[Series], Sequence[Series]],
    setup: SearchSetup,
    closed: ClosedForm,
    known: Fitted | None = None,
) -> SearchResult:
    """What is found in the first recordings; no choice sees the others. It begins from a `known` set, too."""
    own, others = every
    halves = cut(own)
    if setup.exchanged:
        halves = exchanged(*halves)
    start = _search_start(*halves, setup)
    unseen = _with(start.held_out, others)
    findings = _findings(start, unseen, setup, closed, known)
    return SearchResult(start, unseen, findings, setup.budget, exchanged=setup.exchanged)


def _with(held_out: Cut, others: Sequence[Series]) -> Cut:
    """Windows held out of the recordings, and all those of recordings that no fit sees."""
    every = [*held_out.series, *others]
    more = [one for one in all_windows(every) if one[0] >= len(held_out.series)]
    scored = (one for one in more if can_be_scored(every[one[0]], *one[1:]))
    return Cut(every, (*held_out.windows, *scored))


def _search_start(to_fit: Cut, held_out: Cut, setup: SearchSetup) -> SearchStart:
    small = fitted_windows(to_fit)
    screened = screen(small, setup.parallel, setup.budget)
    begun = baseline(screened.cut, setup.sees_speed, setup.fixed.effects, setup.parallel, setup.fixed.gain)
    first = begun.best
    base = fit(
        first.model, small, first.x, simulated_states(first.model, first.x, small), parallel=setup.parallel
    )
    plain = simulate_held_out(base.model, base.x, held_out)
    if plain.floor > PIPELINE.mostly_noise:
        raise DiagnoseError(
            f"y is noise for the most part ({100 * plain.floor:.0f} % of its deviation within windows of "
            f"{held_out.series[0].window_s:.3g} s): a diagnosis needs a movement"
        )
    return SearchStart(to_fit, held_out, screened, begun, Judged(base, plain))


def _findings(
    start: SearchStart, unseen: Cut, setup: SearchSetup, closed: ClosedForm, known: Fitted | None
) -> Findings:
    to_fit, held_out, screened, begun, base = start
    small, progress = fitted_windows(to_fit), setup.progress
    begun = hidden_by_offset(begun, base, closed)
    near = begun.closed or begun.near
    sizes = replace(scales(near, near.cut), given=setup.fixed.given)
    if base.held.nrmse < 1.0:  # else it is no plant whose pressure says anything
        sizes = replace(sizes, pressure=min(sizes.pressure, scales(base.found, small).pressure))
    starts = search_roots(base.found, begun, sizes, screened.cut, setup.parallel)
    starts = starts if known is None else also_from(starts, known, screened.cut)
    progress("trying causes", 0.1)
    grown = grow(screened, starts, lambda part: progress("trying causes", 0.1 + 0.5 * part))
    progress("fitting the best", 0.6)
    choice = choose(base, grown, small, held_out, screened)
    progress("measuring the gain", 0.8)
    base, chosen = _reported(choice, grown, start, unseen, setup)
    while (none := without_a_size(chosen, choice)) is not None:
        choice = choice.less(none, grown.tried, held_out, screened)
        base, chosen = _reported(choice, grown, start, unseen, setup)
    chosen = _beside_all_shown(chosen, setup)
    is_base = chosen.without_held_out is base.found
    last_base = chosen.all_rows if is_base else _by_all_rows(base.found, start, setup, as_recorded=True)
    chosen = replace(chosen, per_holdout=_per_holdout(chosen.reported, len(to_fit.series), unseen, setup))
    effects = found_effects(chosen, screened, grown.tried)
    seen = Judged.of(chosen.without_held_out, to_fit).held
    return Findings(base.found, last_base, base.held, chosen, seen, tuple(effects), grown)


def _beside_all_shown(chosen: Chosen, setup: SearchSetup) -> Chosen:
    """With numbers that are told beside all that they show."""
    told = beside_all_shown(chosen.reported, setup.parallel, setup.budget.last_fit())
    if chosen.drift is None:
        return replace(chosen, all_rows=told)
    return replace(chosen, drift=chosen.drift._replace(fitted=told))


def _reported(
    choice: Choice, grown: Grown, start: SearchStart, unseen: Cut, setup: SearchSetup
) -> tuple[Judged, Chosen]:
    """Baseline and set as they are reported: where more than white noise is left, by what noise remembers."""
    base, chosen = _measured(choice, start, unseen, setup)
    return _remembering(choice, grown, base, chosen, start, unseen, setup)


def _measured(choice: Choice, start: SearchStart, unseen: Cut, setup: SearchSetup) -> tuple[Judged, Chosen]:
    """Both by their simulations: numbers by all rows but those held out, figures by all unseen."""
    best = choice.best.found
    without_held_out = best
    if any(len(recording.blocks) > 1 for recording in start.to_fit.series):
        without_held_out = fitted_over_all(best, all_but(start.to_fit.series, start.held_out), setup.parallel)
    without_held_out = fitted_in_one_run(
        without_held_out, start.held_out, _most(choice), setup.parallel, setup.budget.last_fit()
    )
    all_rows = _by_all_rows(without_held_out, start, setup)
    if without_held_out is best and unseen.windows == start.held_out.windows:
        return choice.base, Chosen(best, best, all_rows, choice.without, choice.best.held)
    every = [choice.base.found, without_held_out, *(one.found for one in choice.without.values())]
    base, own, *rest = setup.parallel(lambda one: Judged.of(one, unseen), every)
    without = dict(zip(choice.without, rest, strict=True))
    return base, Chosen(best, without_held_out, all_rows, without, own.held)


def _most(choice: Choice) -> float:
    """Root mean square that numbers for whole recordings may leave of windows held out [unit, or unit/s].

    What Eq. 1 leaves. Where the set leaves noise alone it is the plant: numbers that do worse there have
    followed something else, such as the place in a gap where one run was begun.
    """
    best, base = choice.best.held, choice.base.held
    own = FREE_RUN.as_near * best.rms if best.adequacy <= HELD_OUT.adequate else base.rms
    return min(own, base.rms)


def _remembering(
    choice: Choice,
    grown: Grown,
    base: Judged,
    chosen: Chosen,
    start: SearchStart,
    unseen: Cut,
    setup: SearchSetup,
) -> tuple[Judged, Chosen]:
    """The same where more than white noise is left: by prediction errors, or beside a load that drifts."""
    if choice.best.held.adequacy <= HELD_OUT.adequate:
        return base, chosen
    predicted = _by_predictions(choice, grown, chosen.without_held_out, start, setup)
    if predicted is None:
        drift = drifting_load(
            chosen.all_rows, chosen.all_rows.cut.series, setup.parallel, setup.budget.drift()
        )
        return base, replace(chosen, drift=drift)
    own = Judged.of(predicted.told, unseen)
    without = {name: Judged.of(one, unseen) for name, one in predicted.without.items()}
    all_rows = _by_all_rows(own.found, start, setup)
    chosen = Chosen(
        own.found, own.found, all_rows, without, own.held, noise_alone=True, in_loop=predicted.in_loop
    )
    return (base if own.found.model.names else own), chosen


def _by_predictions(
    choice: Choice, grown: Grown, found: Fitted, start: SearchStart, setup: SearchSetup
) -> Predicted | None:
    """The set fitted by prediction errors; None where these leave something systematic.

    Or where they simulate worse than a fit of the simulation: both come to the plant where noise is left. Or
    far worse than the set that was chosen: no loop makes so much of noise. Or no better than a mean: what no
    plant moves has a past as well, which foretells it. In a loop Eq. 1 alone may do all of this, if commands
    move the load for certain: what disturbs it passes for its answer there, and nothing named is lost. A
    cause that saved much by simulations has to save prediction errors as well then, or it is none.
    """
    asked = start.to_fit, start.held_out

    def may_be_far(fitted: Fitted) -> bool:
        return not found.model.names and in_closed_loop(fitted) and is_moved(fitted)

    def noise_alone(fitted: Fitted) -> bool:
        seen, held = (simulate_held_out(fitted.model, fitted.x, cut) for cut in asked)
        near = held.nrmse <= min(PREDICTION.given_up * choice.best.held.nrmse, 1.0)
        if not near and not may_be_far(fitted):
            return False
        account, _ = accounted(fitted, seen, held, choice.base.held, predicted=True)
        return account is not None and account.systematic == 0.0 and account.asked

    how = Predictions(choice.base.found, asked, setup.parallel, setup.budget.last_fit, noise_alone)
    predicted = how.predicted(found)
    if predicted is None:
        return None
    if not predicted.fitted.model.names and predicted.in_loop:
        alone = grown.saved_alone(ANSWER.saved_alone)
        if any(setup.parallel(lambda one: how.saves(one, predicted.fitted), alone)):
            return None
    own, simulated = (Judged.of(one, start.held_out).held for one in (predicted.fitted, predicted.simulated))
    near = own.nrmse <= PREDICTION.as_far * simulated.nrmse
    return predicted if near or may_be_far(predicted.fitted) else None


def _per_holdout(reported: Fitted, seen: int, unseen: Cut, setup: SearchSetup) -> tuple[Fitted | None, ...]:
    """The set fitted to each recording after the first `seen` alone: whether plant and sizes repeat."""
    every = [Cut([one], all_windows([one])) for one in unseen.series[seen:]]
    return tuple(
        fitted_to_all_rows(reported, one, setup.parallel, setup.budget.last_fit()) if one.windows else None
        for one in every
    )


def _by_all_rows(
    found: Fitted, start: SearchStart, setup: SearchSetup, *, as_recorded: bool = False
) -> Fitted:
    """Fitted to all rows of the recordings, once nothing more is asked of those that were held out."""
    series = start.held_out.series
    if any(len(one.blocks) > 1 for one in series):
        every = all_but(series, Cut(series, ()))
    else:
        every = Cut(series, tuple(sorted((*start.to_fit.windows, *start.held_out.windows))))
    return fitted_to_all_rows(found, every, setup.parallel, setup.budget.last_fit(), as_recorded)
