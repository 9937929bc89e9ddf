"""From recordings to a diagnosis: baseline, causes, what they gain, what is left."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from seod.diagnose.account.account import accounted
from seod.diagnose.account.prediction_errors import Predicted, Predictions
from seod.diagnose.causes.table import LATE, WITHOUT_SIGN
from seod.diagnose.extend.rig_baseline import rated
from seod.diagnose.fitting.command_lead import lead_remarks
from seod.diagnose.fitting.free_run import fitted_in_one_run, fitted_to_all_rows
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.load_drift import drifting_load
from seod.diagnose.fitting.work import counted
from seod.diagnose.record.blocks import in_blocks
from seod.diagnose.record.closed_form import (
    ClosedForm,
    Types,
    UserValues,
    closed_form,
    output_types,
    taken_for,
)
from seod.diagnose.record.column_checks import different_units, gain_remarks, with_believed_supply
from seod.diagnose.record.defects import examine
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import (
    Cut,
    all_but,
    can_be_scored,
    cut,
    exchanged,
    fitted_windows,
    whole_windows,
)
from seod.diagnose.result import RELEVANCE, DiagnoseError
from seod.diagnose.search.beam import grow
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.final_choice import Choice, choose
from seod.diagnose.search.other_timing import OtherTiming, other_timing
from seod.diagnose.search.refine import fitted_over_all
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import BaselineFits, Fixed, baseline
from seod.diagnose.starts.common_baseline import common_baseline
from seod.diagnose.starts.search_roots import hidden_by_offset, search_roots
from seod.diagnose.starts.sizes import scales
from seod.diagnose.tuning.account import PREDICTION
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.record import CLOSED_FORM
from seod.diagnose.tuning.verdict import PIPELINE
from seod.diagnose.verdict.answer import EXCHANGED, Searched, answered, most_left, trimmed, unseen_by_fits
from seod.diagnose.verdict.effects import Chosen, found_effects, without_a_size
from seod.machine.limits import processors

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.defects import Defects
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Diagnosis, Hold, Output
    from seod.diagnose.search.budget import Effort
    from seod.diagnose.search.screen import Screen

    Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Options:
    """What the user tells.

    Attributes:
        output: What `y` is; None: both are tried.
        config: The rig whose model is the baseline; None: Eq. 1.
        axis: Of that rig; None: its first.
        effort: How much may be simulated before no further cause is tried; `thorough`: all there is to try.
        hold: Whether a command holds until the next row or runs straight on to it; None: it holds, unless a
            cause is not needed where it runs on.
        gain: K_L [unit/s/V] if it is known.
        delay: From the command to the valve [s] if it is known, beyond the recordings' own times.
        usual: What `y` is taken for if both outputs do about as well.
        relevance: Systematic rest from which on it is `unexplained`, over the movement's standard deviation.
    """

    output: Output | None = "position"
    config: RigConfig | None = None
    axis: str | None = None
    effort: Effort = "normal"
    hold: Hold | None = None
    gain: float | None = None
    delay: float | None = None
    usual: Output = "position"
    relevance: float = RELEVANCE


def diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    options: Options | None = None,
    progress: Progress = lambda _what, _part: None,
) -> Diagnosis:
    """Find what Eq. 1, or a rig's model, gets wrong in recordings.

    Args:
        recordings: At least one.
        holdout: Further ones, that no fit sees.
        options: See there.
        progress: Called with what is being done and the part of all work that is.

    Raises:
        DiagnoseError: A recording tells nothing.
    """
    with threadpool_limits(1, "blas"):  # sums of several threads differ in their last digits
        return _diagnose(recordings, holdout, options or Options(), progress)


def _diagnose(
    recordings: Sequence[Recording], holdout: Sequence[Recording], asked: Options, progress: Progress
) -> Diagnosis:
    if different := different_units([*recordings, *holdout]):
        raise DiagnoseError(different)
    recordings, holdout, unbelieved = _believed(recordings, holdout)
    types = _types(recordings, asked)
    rig = rated(asked.config, asked.axis)
    checked = [examine(each) for each in (*recordings, *holdout)]
    rows = _Rows(recordings, holdout, checked, asked.hold, nominal_conditions(recordings) | rig.conditions)
    with ThreadPoolExecutor(processors()) as pool:
        parallel, fixed = counted(pool.map), _fixed(asked, rig.effects)

        def searched_as(output: Output, show: Progress) -> _Told:
            every = rows.series(sees_speed=output == "velocity")
            samples = sum(last - first for one in every[0] for first, last in one.blocks)
            way = _Way(output == "velocity", fixed, parallel, Budget.of(samples, asked.effort), show)
            told, way = _in_either_half(every, way, types.closed[output])
            if asked.hold is not None:
                return told
            return _timed_otherwise(told, every, way, types.closed[output])

        progress("fitting Eq. 1", 0.0)
        told, output, typed = _as_either(types, searched_as, progress)
        start, unseen, found, budget, timed, in_others = told
        if any(defects.has_outliers for defects in checked):
            found = trimmed(found)
        common = common_baseline(
            start.base.found, start.to_fit, start.held_out, types.closed[output], fixed, parallel
        )
    progress("comparing", 0.9)
    answer = answered(found, start.to_fit, unseen, checked, output, asked.relevance)
    answer = replace(answer, baseline=replace(answer.baseline, common=common))
    remarks = gain_remarks(str(recordings[0].paths[0]), told_gain(answer, rig.effects), rig.K_L)
    remarks += lead_remarks(found.chosen.last) if timed is None else [timed.sentence]
    searched = start.to_fit.series
    remarks += [EXCHANGED] if in_others else []
    remarks += [_long(searched)] if any(len(one.blocks) > 1 for one in searched) else []
    answer = replace(answer, remarks=(*typed, *unbelieved, *answer.remarks, *remarks, *budget.remarks))
    progress("done", 1.0)
    return answer


class _Rows(NamedTuple):
    """Recordings, those that no fit sees, their defects, how commands hold, and a model's conditions."""

    recordings: Sequence[Recording]
    holdout: Sequence[Recording]
    checked: Sequence[Defects]
    hold: Hold | None
    nominal: Mapping[str, float]

    def series(self, *, sees_speed: bool) -> tuple[Sequence[Series], Sequence[Series]]:
        """As they are simulated."""
        every = [
            series(
                each,
                defects.bad,
                sees_speed=sees_speed,
                step=defects.step,
                late=defects.late,
                taken=defects.taken,
                hold=self.hold,
                nominal_ps=self.nominal.get("nominal_ps"),
                nominal_temperature=self.nominal.get("nominal_temperature"),
                nominal_f=self.nominal.get("nominal_f"),
            )
            for each, defects in zip((*self.recordings, *self.holdout), self.checked, strict=True)
        ]
        first = len(self.recordings)
        return in_blocks(every[:first]), in_blocks(every[first:])


class _Told(NamedTuple):
    """Where causes are searched, all windows that no fit sees, what was found, and what that used.

    `timed` is when commands were given, where that was found; `exchanged`: the halves of the windows were.
    """

    start: _Start
    unseen: Cut
    found: Searched
    budget: Budget
    timed: OtherTiming | None = None
    exchanged: bool = False


def _searched(every: tuple[Sequence[Series], Sequence[Series]], way: _Way, closed: ClosedForm) -> _Told:
    """What is found in the first recordings; no choice sees the others."""
    searched, others = every
    halves = cut(searched)
    if way.exchanged:
        halves = exchanged(*halves)
    start = _start(*halves, way)
    unseen = _with(start.held_out, others)
    found = _search(start, unseen, way, closed)
    return _Told(start, unseen, found, way.budget, exchanged=way.exchanged)


def _in_either_half(
    every: tuple[Sequence[Series], Sequence[Series]], way: _Way, closed: ClosedForm
) -> tuple[_Told, _Way]:
    """What is found, and how: with the halves exchanged, where one held out shows what no fit has seen.

    A machine's operation may have one long move. If causes are named of it that leave less in either half,
    they are told.
    """
    told = _searched(every, way, closed)
    own = _in_own_windows(told)
    if not unseen_by_fits(own):
        return told, way
    other = way._replace(budget=way.budget.anew(), progress=_later(way.progress), exchanged=True)
    try:
        again = _searched(every, other, closed)
    except DiagnoseError:  # the other half says nothing
        return told, way
    if again.found.effects and most_left(_in_own_windows(again)) < most_left(own):
        return again, other
    return told, way


def _in_own_windows(told: _Told) -> Searched:
    """What was found, with errors held out of the first recordings alone: no choice sees the others."""
    found, held_out = told.found, told.start.held_out
    if told.unseen.windows == held_out.windows:
        return found
    base, best = (Judged.of(one, held_out).held for one in (found.base, found.chosen.over_all))
    return replace(found, held=base, chosen=replace(found.chosen, held=best))


def _timed_otherwise(
    told: _Told, every: tuple[Sequence[Series], Sequence[Series]], way: _Way, closed: ClosedForm
) -> _Told:
    """What is found where commands were given other than recorded, if a cause is not needed then."""
    chosen = told.found.chosen
    without = {name: one.found for name, one in chosen.without.items()}
    timed = other_timing(chosen.found, without, told.start.held_out, way.parallel)
    if timed is None:
        return told
    searched, others = ([timed.timing.of(one) for one in part] for part in every)
    anew = way._replace(budget=way.budget.anew(), progress=_later(way.progress))
    again = _searched((searched, others), anew, closed)
    return told if len(again.found.effects) > len(told.found.effects) else again._replace(timed=timed)


def _as_either(
    types: Types, searched_as: Callable[[Output, Progress], _Told], progress: Progress
) -> tuple[_Told, Output, tuple[str, ...]]:
    """What is found, what y is, and what is said of that.

    Where Eq. 1 leaves it open, and much is left of the likelier type, the other one is searched as well.
    """
    likelier, *other = types.open
    told = searched_as(likelier, progress)
    left = told.found.chosen.held.nrmse
    if not other or left <= CLOSED_FORM.good:
        return told, likelier, types.said
    try:
        again = searched_as(other[0], _later(progress))
    except DiagnoseError:  # as this type it says nothing
        return told, likelier, types.said
    nearer = again.found.chosen.held.nrmse
    if nearer < CLOSED_FORM.nearer * left:
        return again, other[0], (taken_for(other[0], nearer, left, "what is found leaves, held out,"),)
    return told, likelier, types.said


def _later(progress: Progress) -> Progress:
    """What tells of causes that are searched once more."""
    return lambda what, _: progress(what, PIPELINE.searched_again)


def told_gain(answer: Diagnosis, fixed: Mapping[str, Mapping[str, float]]) -> float:
    """K_L of the extended model [unit/s/V]; without its sign where a cause hides that.

    `fixed` are the effects of the rig's own model.
    """
    acting = {*fixed, *(each.name for each in answer.effects)}
    return answer.extended.K_L if WITHOUT_SIGN.isdisjoint(acting) else abs(answer.extended.K_L)


def _believed(
    recordings: Sequence[Recording], holdout: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording], tuple[str, ...]]:
    """The recordings without supply pressures that are none, and what is said of these."""
    every = [with_believed_supply(each) for each in (*recordings, *holdout)]
    kept = [one for one, _ in every]
    said = tuple(sentence for _, sentences in every for sentence in sentences)
    return kept[: len(recordings)], kept[len(recordings) :], said


def nominal_conditions(recordings: Sequence[Recording]) -> dict[str, float]:
    """Supply pressure, temperature and measured disturbance at which the model's numbers hold.

    They are those of the recordings that are fitted, all together: recordings at other pressures, also those
    that only score, then differ by what the pressure does.
    """
    channels = {
        "nominal_ps": [float(np.nanmedian(each.ps)) for each in recordings if each.ps is not None],
        "nominal_temperature": [
            float(np.nanmean(each.temperature)) for each in recordings if each.temperature is not None
        ],
        "nominal_f": [float(np.nanmean(each.f)) for each in recordings if each.f is not None],
    }
    return {name: float(np.mean(middles)) for name, middles in channels.items() if middles}


def _types(recordings: Sequence[Recording], asked: Options) -> Types:
    """What y may be, and Eq. 1 in closed form."""
    told = UserValues(asked.hold or "zero", asked.gain, asked.delay)
    if asked.output is not None:
        return Types((asked.output,), {asked.output: closed_form(recordings, asked.output, told)}, ())
    tried: dict[Output, ClosedForm] = {
        "position": closed_form(recordings, "position", told),
        "velocity": closed_form(recordings, "velocity", told),
    }
    return output_types(tried, asked.usual)


def _fixed(asked: Options, effects: Mapping[str, Mapping[str, float]]) -> Fixed:
    """The rig's effects, and what the user tells."""
    told = {} if asked.delay is None else {LATE: {"time": asked.delay}}
    return Fixed({**effects, **told}, asked.gain, frozenset(told))


class _Way(NamedTuple):
    """How it is searched.

    `fixed` are effects of the rig's model, and what the user tells. `exchanged`: windows are fitted that are
    held out otherwise, and the reverse.
    """

    sees_speed: bool
    fixed: Fixed
    parallel: ParallelMap
    budget: Budget
    progress: Progress
    exchanged: bool = False


class _Start(NamedTuple):
    """Where causes are searched: windows to fit, windows held out, and Eq. 1 on them."""

    to_fit: Cut
    held_out: Cut
    screened: Screen
    begun: BaselineFits
    base: Judged


def _long(searched: Sequence[Series]) -> str:
    seconds = sum(float(one.t[b - 1] - one.t[a]) for one in searched for a, b in one.blocks)
    return (
        f"a long recording: causes were searched in blocks of it, {seconds:.0f} s together; the extended "
        "model's numbers are fitted to all of it"
    )


def _with(held_out: Cut, others: Sequence[Series]) -> Cut:
    """Windows held out of the recordings, and all those of recordings that no fit sees."""
    every = [*held_out.series, *others]
    more = [one for one in whole_windows(every) if one[0] >= len(held_out.series)]
    told = (one for one in more if can_be_scored(every[one[0]], *one[1:]))
    return Cut(every, (*held_out.windows, *told))


def _start(to_fit: Cut, held_out: Cut, way: _Way) -> _Start:
    small = fitted_windows(to_fit)
    screened = screen(small, way.parallel, way.budget)
    begun = baseline(screened.cut, way.sees_speed, way.fixed.effects, way.parallel, way.fixed.gain)
    first = begun.best
    base = fit(
        first.model, small, first.x, simulated_states(first.model, first.x, small), parallel=way.parallel
    )
    plain = simulate_held_out(base.model, base.x, held_out)
    if plain.floor > PIPELINE.mostly_noise:
        raise DiagnoseError(
            f"y is noise for the most part ({100 * plain.floor:.0f} % of its deviation): "
            "a diagnosis needs a movement"
        )
    return _Start(to_fit, held_out, screened, begun, Judged(base, plain))


def _search(start: _Start, unseen: Cut, way: _Way, closed: ClosedForm) -> Searched:
    to_fit, held_out, screened, begun, base = start
    small, progress = fitted_windows(to_fit), way.progress
    begun = hidden_by_offset(begun, base, closed)
    near = begun.closed or begun.near
    sizes = replace(scales(near, near.cut), given=way.fixed.given)
    if base.held.nrmse < 1.0:  # else it is no plant whose pressure says anything
        sizes = replace(sizes, pressure=min(sizes.pressure, scales(base.found, small).pressure))
    starts = search_roots(base.found, begun, sizes, screened.cut)
    progress("trying causes", 0.1)
    grown = grow(screened, starts, lambda part: progress("trying causes", 0.1 + 0.5 * part))
    progress("fitting the best", 0.6)
    choice = choose(base, grown, small, held_out, screened)
    progress("measuring the gain", 0.8)
    base, chosen = _told(choice, start, unseen, way)
    while (none := without_a_size(chosen, choice)) is not None:
        choice = choice.less(none, grown.tried, held_out, screened)
        base, chosen = _told(choice, start, unseen, way)
    is_base = chosen.over_all is base.found
    last_base = chosen.to_all if is_base else _last(base.found, start, way, as_recorded=True)
    chosen = replace(chosen, again=_fitted_again(chosen.last, len(to_fit.series), unseen, way))
    effects = found_effects(chosen, screened, grown.tried)
    seen = Judged.of(chosen.over_all, to_fit).held
    return Searched(base.found, last_base, base.held, chosen, seen, tuple(effects), grown)


def _told(choice: Choice, start: _Start, unseen: Cut, way: _Way) -> tuple[Judged, Chosen]:
    """Baseline and set as they are told: where more than white noise is left, by what noise remembers."""
    return _remembering(choice, *_measured(choice, start, unseen, way), start, unseen, way)


def _measured(choice: Choice, start: _Start, unseen: Cut, way: _Way) -> tuple[Judged, Chosen]:
    """Both by their simulations: numbers by all rows but those held out, figures by all unseen."""
    best = choice.best.found
    over_all = best
    if any(len(recording.blocks) > 1 for recording in start.to_fit.series):
        over_all = fitted_over_all(best, all_but(start.to_fit.series, start.held_out), way.parallel)
    most = choice.base.held.rms
    over_all = fitted_in_one_run(over_all, start.held_out, most, way.parallel, way.budget.last_fit())
    last = _last(over_all, start, way)
    if over_all is best and unseen.windows == start.held_out.windows:
        return choice.base, Chosen(best, best, last, choice.without, choice.best.held)
    every = [choice.base.found, over_all, *(one.found for one in choice.without.values())]
    base, own, *rest = way.parallel(lambda one: Judged.of(one, unseen), every)
    return base, Chosen(best, over_all, last, dict(zip(choice.without, rest, strict=True)), own.held)


def _remembering(
    choice: Choice, base: Judged, chosen: Chosen, start: _Start, unseen: Cut, way: _Way
) -> tuple[Judged, Chosen]:
    """The same where more than white noise is left: by prediction errors, or beside a load that drifts."""
    if choice.best.held.adequacy <= HELD_OUT.adequate:
        return base, chosen
    predicted = _by_predictions(choice, chosen.over_all, start, way)
    if predicted is None:
        drift = drifting_load(chosen.to_all, chosen.to_all.cut.series, way.parallel, way.budget.drift())
        return base, replace(chosen, drift=drift)
    own = Judged.of(predicted.told, unseen)
    without = {name: Judged.of(one, unseen) for name, one in predicted.without.items()}
    last = _last(own.found, start, way)
    told = Chosen(own.found, own.found, last, without, own.held, noise_alone=True)
    return (base if own.found.model.names else own), told


def _by_predictions(choice: Choice, found: Fitted, start: _Start, way: _Way) -> Predicted | None:
    """The set fitted by prediction errors; None where these leave something systematic.

    Or where they simulate worse than a fit of the simulation: both come to the plant where noise is left. Or
    far worse than the set that was chosen: no loop makes so much of noise. Or no better than a mean: what no
    plant moves has a past as well, which foretells it.
    """
    asked = start.to_fit, start.held_out

    def noise_alone(fitted: Fitted) -> bool:
        seen, held = (simulate_held_out(fitted.model, fitted.x, cut) for cut in asked)
        if held.nrmse > min(PREDICTION.given_up * choice.best.held.nrmse, 1.0):
            return False
        account, _ = accounted(fitted, seen, held, choice.base.held, predicted=True)
        return account is not None and account.systematic == 0.0 and account.asked

    how = Predictions(choice.base.found, asked, way.parallel, way.budget.last_fit, noise_alone)
    predicted = how.predicted(found)
    if predicted is None:
        return None
    own, simulated = (Judged.of(one, start.held_out).held for one in (predicted.fitted, predicted.simulated))
    return predicted if own.nrmse <= PREDICTION.as_far * simulated.nrmse else None


def _fitted_again(last: Fitted, seen: int, unseen: Cut, way: _Way) -> tuple[Fitted | None, ...]:
    """The set fitted to each recording after the first `seen` alone: whether sizes repeat."""
    if not last.model.names:
        return ()
    every = [Cut([one], whole_windows([one])) for one in unseen.series[seen:]]
    return tuple(
        fitted_to_all_rows(last, one, way.parallel, way.budget.last_fit()) if one.windows else None
        for one in every
    )


def _last(found: Fitted, start: _Start, way: _Way, *, as_recorded: bool = False) -> Fitted:
    """Fitted to all rows of the recordings, once nothing more is asked of those that were held out."""
    series = start.held_out.series
    if any(len(one.blocks) > 1 for one in series):
        every = all_but(series, Cut(series, ()))
    else:
        every = Cut(series, tuple(sorted((*start.to_fit.windows, *start.held_out.windows))))
    return fitted_to_all_rows(found, every, way.parallel, way.budget.last_fit(), as_recorded)
