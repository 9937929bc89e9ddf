"""From recordings to a diagnosis: baseline, causes, what they gain, what is left."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from seod.data.pauses import between_pauses
from seod.diagnose.causes.base import BASE
from seod.diagnose.causes.table import CAUSES, LATE, WITHOUT_SIGN
from seod.diagnose.extend.rig_baseline import rated
from seod.diagnose.fitting.command_lead import lead_remarks
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.switch_times import switch_times
from seod.diagnose.fitting.uncertainty import at_limits
from seod.diagnose.fitting.work import counted
from seod.diagnose.one_search import SearchResult, SearchSetup, search_once
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
from seod.diagnose.record.windows import Cut
from seod.diagnose.result import RELEVANCE, DiagnoseError
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.other_timing import other_timing
from seod.diagnose.starts.baseline import Fixed
from seod.diagnose.starts.common_baseline import common_baseline
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.record import CLOSED_FORM, SERIES
from seod.diagnose.tuning.verdict import PIPELINE
from seod.diagnose.verdict.answer import Findings, answered, most_left, trimmed, unseen_by_fits
from seod.diagnose.verdict.remarks import EXCHANGED
from seod.machine.limits import processors

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.record.defects import Defects
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Diagnosis, Hold, Output
    from seod.diagnose.search.budget import Effort

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
    recordings, paused = between_pauses(recordings, SERIES.least_samples)
    holdout, paused_too = between_pauses(holdout, SERIES.least_samples)
    types = _types(recordings, asked)
    rig = rated(asked.config, asked.axis)
    checked = [examine(each) for each in (*recordings, *holdout)]
    rows = _Rows(recordings, holdout, checked, asked.hold, nominal_conditions(recordings) | rig.conditions)
    with ThreadPoolExecutor(processors()) as pool:
        parallel, fixed = counted(pool.map), _fixed(asked, rig.effects)

        def searched_as(output: Output, show: Progress) -> SearchResult:
            every = rows.series(sees_speed=output == "velocity")
            samples = sum(last - first for one in every[0] for first, last in one.blocks)
            setup = SearchSetup(output == "velocity", fixed, parallel, Budget.of(samples, asked.effort), show)
            result, setup = _in_either_half(every, setup, types.closed[output])
            if asked.hold is not None:
                return result
            return _timed_otherwise(result, every, setup, types.closed[output])

        progress("fitting Eq. 1", 0.0)
        result, output, typed = _as_either(types, searched_as, progress)
        start, unseen, findings, budget, timed, in_others = result
        if any(defects.has_outliers for defects in checked):
            findings = trimmed(findings)
        common = common_baseline(
            start.base.found, start.to_fit, start.held_out, types.closed[output], fixed, parallel
        )
    progress("comparing", 0.9)
    answer = answered(findings, start.to_fit, unseen, checked, output, asked.relevance)
    answer = replace(answer, baseline=replace(answer.baseline, common=common))
    no_plant = answer.grade == "useless"  # its gain says nothing
    gain = None if no_plant else told_gain(answer, rig.effects)
    remarks = gain_remarks(str(recordings[0].paths[0]), gain, rig.K_L)
    remarks += lead_remarks(findings.chosen.reported) if timed is None else [timed.sentence]
    fitted = start.to_fit.series
    remarks += [EXCHANGED] if in_others else []
    remarks += [_long(fitted)] if any(len(one.blocks) > 1 for one in fitted) else []
    answer = replace(
        answer,
        remarks=(*typed, *unbelieved, *paused, *paused_too, *answer.remarks, *remarks, *budget.remarks),
    )
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


def _in_either_half(
    every: tuple[Sequence[Series], Sequence[Series]], setup: SearchSetup, closed: ClosedForm
) -> tuple[SearchResult, SearchSetup]:
    """What is found, and how: with the halves exchanged, where one held out shows what no fit has seen.

    A machine's operation may have one long move. If causes are named of it that leave less in either half,
    they are told.
    """
    result = search_once(every, setup, closed)
    own = _in_own_windows(result)
    if setup.budget.too_late() or not unseen_by_fits(own):
        return result, setup
    other = setup._replace(budget=setup.budget.anew(), progress=_later(setup.progress), exchanged=True)
    try:
        again = search_once(every, other, closed)
    except DiagnoseError:  # the other half says nothing
        return result, setup
    if again.findings.effects and most_left(_in_own_windows(again)) < most_left(own):
        return again, other
    return result, setup


def _in_own_windows(result: SearchResult) -> Findings:
    """What was found, with errors held out of the first recordings alone: no choice sees the others."""
    findings, held_out = result.findings, result.start.held_out
    if result.unseen.windows == held_out.windows:
        return findings
    base, best = (Judged.of(one, held_out).held for one in (findings.base, findings.chosen.without_held_out))
    return replace(findings, held=base, chosen=replace(findings.chosen, held=best))


def _timed_otherwise(
    result: SearchResult,
    every: tuple[Sequence[Series], Sequence[Series]],
    setup: SearchSetup,
    closed: ClosedForm,
) -> SearchResult:
    """What is found where commands were given other than recorded.

    If a cause is not needed then, or if each switch of a relay has a time of its own: not where all that is
    left is the rounding of a coarse sensor, within which times may be any.
    """
    over = setup.budget.too_late
    if over():  # a search that tries nothing would find less
        return result
    chosen, start = result.findings.chosen, result.start
    without = {name: one.found for name, one in chosen.without.items()}
    anew = setup._replace(budget=setup.budget.anew(), progress=_later(setup.progress))
    timed = other_timing(chosen.searched, without, start.held_out, setup.parallel, over)
    if timed is not None:
        own, others = ([timed.timing.of(one) for one in part] for part in every)
        again = search_once((own, others), anew, closed)
        more = len(again.findings.effects) > len(result.findings.effects)
        return result if more else again._replace(timed=timed)
    if start.held_out.coarse and most_left(result.findings) <= HELD_OUT.adequate:
        return result
    windows = Cut(every[0], tuple(sorted((*start.to_fit.windows, *start.held_out.windows))))
    sets = [start.base.found, *without.values(), chosen.searched] if without else [chosen.searched]
    model = result.findings.grown.best[-1].model
    switches = switch_times(sets, windows, setup.parallel, lambda: start.screened.grid_sets(model), over)
    if switches is None or over():
        return result
    again = search_once((switches.of(every[0]), every[1]), anew, closed, switches.told_by)
    return again._replace(timed=switches)


def _as_either(
    types: Types, searched_as: Callable[[Output, Progress], SearchResult], progress: Progress
) -> tuple[SearchResult, Output, tuple[str, ...]]:
    """What is found, what y is, and what is said of that.

    Where nobody tells, and much besides noise is left of the likelier type or its plant is at a limit, the
    other one is searched as well: a position that a spring holds follows u as a speed does, and Eq. 1 of a
    position is farther from it.
    """
    likelier = types.likelier
    result = searched_as(likelier, progress)
    left = result.findings.chosen.held.nrmse
    limited = bool(types.said) and _is_limited(result)
    explained = left <= CLOSED_FORM.good or most_left(result.findings) <= HELD_OUT.adequate
    if not limited and (not types.said or explained):
        return result, likelier, types.said
    second: Output = "velocity" if likelier == "position" else "position"
    try:
        again = searched_as(second, _later(progress))
    except DiagnoseError:  # as this type it says nothing
        return result, likelier, types.said
    nearer = again.findings.chosen.held.nrmse
    no_farther = limited and nearer <= left and not _is_limited(again)
    if no_farther or nearer < CLOSED_FORM.nearer * left:
        return again, second, (taken_for(second, nearer, left, "what is found leaves, held out,"),)
    return result, likelier, types.said


def _is_limited(result: SearchResult) -> bool:
    """Whether K_L, omega_n or zeta is at an end of what is searched."""
    return not set(BASE).isdisjoint(at_limits(result.findings.chosen.reported))


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
        return Types(asked.output, {asked.output: closed_form(recordings, asked.output, told)}, ())
    tried: dict[Output, ClosedForm] = {
        "position": closed_form(recordings, "position", told),
        "velocity": closed_form(recordings, "velocity", told),
    }
    return output_types(tried, asked.usual)


def _fixed(asked: Options, effects: Mapping[str, Mapping[str, float]]) -> Fixed:
    """The rig's effects, and what the user tells."""
    told = {} if asked.delay is None else {LATE: {CAUSES[LATE].pure_delay: asked.delay}}
    return Fixed({**effects, **told}, asked.gain, frozenset(told))


def _long(searched: Sequence[Series]) -> str:
    seconds = sum(float(one.t[b - 1] - one.t[a]) for one in searched for a, b in one.blocks)
    return (
        f"a long recording: causes were searched in blocks of it, {seconds:.0f} s together; the extended "
        "model's numbers are fitted to all of it"
    )
