"""What was found, put together as the answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.account.account import accounted
from seod.diagnose.account.grade import graded
from seod.diagnose.account.halves import noise_is_larger, one_sided
from seod.diagnose.fitting.free_run import free_runs
from seod.diagnose.fitting.held_out import wholes
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.uncertainty import base_sd, covariance
from seod.diagnose.result import (
    RELEVANCE,
    SD_OF_MEDIAN,
    Candidate,
    Diagnosis,
    FoundEffect,
    Score,
    Unexplained,
)
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.verdict import ANSWER
from seod.diagnose.verdict.figures import drawn, score, windows
from seod.diagnose.verdict.next_experiment import beyond_a_relay, next_experiment
from seod.diagnose.verdict.record_effects import record_effects, shown_by_samples
from seod.diagnose.verdict.remarks import LARGER, RARE, UNFITTED, remarks
from seod.diagnose.verdict.unexplained import relevant, systematic_part, unexplained

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.defects import Defects
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Account, Array, Mask, NextExperiment, Output, Verdict, Window
    from seod.diagnose.search.beam import Grown
    from seod.diagnose.verdict.effects import Chosen


@dataclass(frozen=True, slots=True)
class Findings:
    """What a search found.

    Attributes:
        base: The baseline, fitted to all windows to fit.
        last_base: The same fitted to all rows: its numbers are reported.
        held: Its simulation of the windows held out.
        chosen: The best set of effects.
        seen: Its simulation of the windows to fit.
        effects: Of it, in order of gain.
        grown: What was tried.
    """

    base: Fitted
    last_base: Fitted
    held: HeldOut
    chosen: Chosen
    seen: HeldOut
    effects: tuple[FoundEffect, ...]
    grown: Grown


def answered(
    findings: Findings,
    to_fit: Cut,
    held_out: Cut,
    checked: Sequence[Defects],
    output: Output,
    relevance: float = RELEVANCE,
) -> Diagnosis:
    """The diagnosis; `checked` are the defects of each recording.

    `relevance` is the systematic rest from which on it is `unexplained`, over the movement's deviation.
    """
    seen = len(to_fit.series)
    baseline, plain = _scored(findings.last_base, findings.held, seen)
    extended, whole = _scored(findings.chosen.reported, findings.chosen.held, seen)
    base, best = Judged.of(findings.base, to_fit).held, findings.seen
    rest, rare = _remainder(findings, base)
    chosen, held = findings.chosen, findings.chosen.held
    account, yardstick = accounted(
        chosen.without_held_out, best, held, findings.held, noise_alone=chosen.noise_alone
    )
    if rare:
        rest = relevant(rest, max(held.nrmse, best.nrmse), relevance)
        rare = rare if rest.fraction > 0.0 else ()
    elif _saved_alone(findings):
        rest = relevant(rest, held.nrmse, relevance)
    elif held.adequacy >= HELD_OUT.adequate:
        named, alone = bool(findings.effects), chosen.noise_alone
        rest = systematic_part(rest, account, held.nrmse, relevance, named=named, noise_alone=alone)
    defects = record_effects(checked, held, best)
    for shown in shown_by_samples(checked):
        numbers = {of: each.value for of, each in shown.parameters.items()}
        extended = replace(extended, effects=extended.effects | {shown.name: numbers})
    every = (*findings.effects, *defects)
    verdict = _verdict(every, rest)
    before, after = baseline.holdout_nrmse, extended.holdout_nrmse
    clean = verdict != "unexplained" and not findings.effects  # what samples show is no lack of the plant's
    return Diagnosis(
        verdict=verdict,
        baseline=baseline,
        effects=every,
        extended=extended,
        noise_floor_nrmse=_floor(findings.held, account, rest),
        unexplained=rest,
        next_experiment=_experiment(findings, held_out),
        output=output,
        noise_sd=tuple(recording.noise for recording in held_out.series),
        adequacy=held.adequacy,
        windows=tuple(_windows(findings, base, best)),
        whole=drawn(held_out, plain, whole),
        candidates=_candidates(findings),
        remarks=(
            *dict.fromkeys(remark for each in checked for remark in each.remarks),
            *rare,
            *remarks(chosen, findings.effects, findings.held, held_out.series, whole, seen),
        ),
        grade=graded(before, after, held.adequacy, account, clean=clean),
        account=account,
        yardstick=yardstick,
        relevance=relevance,
    )


def trimmed(findings: Findings) -> Findings:
    """The same without rows whose error is none of the rest's, where the recordings have outliers.

    Those that differ little from their neighbours are told by a model only.
    """
    near, seen = _without_outliers(findings.chosen.held), _without_outliers(findings.seen)
    chosen = replace(findings.chosen, held=replace(findings.chosen.held, scored=near))
    return replace(
        findings,
        chosen=chosen,
        held=replace(findings.held, scored=near),
        seen=replace(findings.seen, scored=seen),
    )


def _without_outliers(held: HeldOut) -> Mask:
    """Rows that count, but for those far off, if these are few.

    Far off the noise that differences show, and what is left of most rows of the window.
    """
    error = np.abs(held.cut.y - held.simulated)
    near = held.scored.copy()
    for rows, floor in zip(held.cut.slices, held.cut.floor, strict=True):
        usual = np.median(error[rows][near[rows]]) if near[rows].any() else 0.0
        near[rows] &= error[rows] <= ANSWER.outlier_beyond * max(floor, SD_OF_MEDIAN * usual)
    few = np.count_nonzero(near) >= (1.0 - ANSWER.most_outliers) * np.count_nonzero(held.scored)
    return near if few else held.scored


def unseen_by_fits(findings: Findings) -> bool:
    """Whether windows held out show something of which there is nothing in those that were fitted."""
    halves = findings.seen, findings.chosen.held
    if unexplained(findings.held, halves[1]).fraction == 0.0:
        return False
    return noise_is_larger(*halves) or (one_sided(*halves) and halves[0].adequacy < halves[1].adequacy)


def most_left(findings: Findings) -> float:
    """Mean squared error over the noise's of that half of the windows where it is larger."""
    return max(findings.seen.adequacy, findings.chosen.held.adequacy)


def _remainder(findings: Findings, base: HeldOut) -> tuple[Unexplained, tuple[str, ...]]:
    """What is left, and a remark where one half of the windows shows it alone; `base` is of those fitted."""
    halves = findings.seen, findings.chosen.held
    rest = unexplained(findings.held, findings.chosen.held)
    if rest.fraction > 0.0 and not one_sided(*halves):
        return rest, (LARGER,) if noise_is_larger(*halves) else ()
    if rest.fraction > 0.0:
        return rest, (UNFITTED,)
    if one_sided(*halves):
        return unexplained(replace(base, scored=findings.seen.scored), findings.seen), (RARE,)
    return rest, ()


def _floor(held: HeldOut, account: Account | None, rest: Unexplained) -> float:
    """NRMSE of a perfect model: that of white noise, or of noise of any colour where nothing else is left."""
    if account is None or rest.fraction > 0.0:
        return held.floor
    return max(held.floor, math.sqrt(account.not_repeatable) * held.nrmse)


def _experiment(findings: Findings, held_out: Cut) -> NextExperiment | None:
    best, every = findings.chosen.reported, held_out.series
    volts = max(float(np.max(np.abs(one.u))) for one in every)
    asked = best.model, best.x, max(one.noise for one in every), volts, max(one.tick for one in every)
    told = next_experiment(findings.effects, *asked)
    if told is not None:
        return told
    sizes = findings.grown.baseline.model.scales  # the model's own are rough ones where nothing is found
    return beyond_a_relay(replace(best.model, scales=sizes), *asked[1:]) if sizes.two_commands else None


def _scored(fitted: Fitted, held: HeldOut, seen: int) -> tuple[Score, list[Array]]:
    """A model's figures: numbers and runs of `fitted`, held-out errors of `held`.

    Fits have seen the first `seen` recordings.
    """
    simulated, whole_nrmse, diverged = wholes(fitted.model, fitted.x, held.cut)
    sd = base_sd(fitted, covariance(fitted))
    told = score(fitted.model, fitted.x, held, whole_nrmse, diverged, sd)
    return replace(told, free_runs=free_runs(fitted.model, fitted.x, held.cut.series, seen)), simulated


def _verdict(effects: Sequence[FoundEffect], rest: Unexplained) -> Verdict:
    if rest.fraction > 0.0:
        return "unexplained"
    return "effects" if effects else "clean"


def _saved_alone(findings: Findings) -> bool:
    """Whether nothing is named though one cause, no load and no wave, saved much where it was fitted.

    No noise does that, and a past that foretells all of it does not make it one. In a loop it does: there
    prediction errors were asked.
    """
    chosen = findings.chosen
    if findings.effects or chosen.in_loop or chosen.held.adequacy < HELD_OUT.adequate:
        return False
    return bool(findings.grown.saved_alone(ANSWER.saved_alone))


def _windows(findings: Findings, base: HeldOut, best: HeldOut) -> list[Window]:
    seen = windows(base, best, held_out=False)
    seen += windows(findings.held, findings.chosen.held, held_out=True)
    return sorted(seen, key=lambda window: (window.file, window.rows))


def _candidates(findings: Findings) -> tuple[Candidate, ...]:
    """Causes that were tried alone, by what they save of the mean log squared error."""
    reference, names = findings.grown.baseline.cost, {each.name for each in findings.effects}
    alone = findings.grown.alone().items()
    out = (Candidate(name, reference - one.cost, name in names) for name, one in alone)
    return tuple(sorted(out, key=lambda each: -each.gain))
