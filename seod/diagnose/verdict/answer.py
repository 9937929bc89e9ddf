"""What was found, put together as the answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.account.account import accounted
from seod.diagnose.account.grade import graded
from seod.diagnose.account.halves import noise_is_larger, one_sided
from seod.diagnose.causes.table import OFFSET_DRIFT_PLACE
from seod.diagnose.fitting.free_run import free_runs
from seod.diagnose.fitting.held_out import nrmse, wholes
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.uncertainty import at_limits, base_sd, covariance
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.result import (
    RELEVANCE,
    SD_OF_MEDIAN,
    Candidate,
    Diagnosis,
    FoundEffect,
    Gain,
    Score,
    Unexplained,
)
from seod.diagnose.search.final_choice import above_noise
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.search import PRUNE
from seod.diagnose.tuning.verdict import ANSWER
from seod.diagnose.verdict.figures import drawn, score, windows
from seod.diagnose.verdict.next_experiment import beyond_a_relay, next_experiment
from seod.diagnose.verdict.unexplained import relevant, systematic_part, unexplained
from seod.terminal.text import number, with_sd
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.defects import Defect, Defects
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Account, Array, Mask, NextExperiment, Output, Parameter, Verdict, Window
    from seod.diagnose.search.beam import Grown
    from seod.diagnose.verdict.effects import Chosen

RARE: Final = (
    "what is left shows in windows that were fitted and in none that was held out: no cause of it can be "
    "tried out. A longer recording, in which it happens again, tells more"
)
UNFITTED: Final = (
    "what is left shows in windows that were held out and in none that was fitted: no cause of it can be "
    "fitted. A longer recording, in which it happens again, tells more"
)
LARGER: Final = (
    "windows that were held out are off by more than noise makes of those that were fitted: something acts "
    "there that no fit has seen. A longer recording, in which it happens again, tells more"
)
EXCHANGED: Final = (
    "something acts in every second window and not in the others: causes were searched in those, and "
    "errors held out are of the others"
)
SWEPT: Final = (
    "{name}: the command sweeps, its frequency or size goes one way with time. What depends on frequency or "
    "amplitude cannot be told from a drift then: a command that does not sweep tells"
)
DRIFTS: Final = (
    "the constant load grows by {rate} unit/s^3 from the start of a recording, as of a drive that warms up: "
    "one run leaves {with_it} % of thirds that no fit has seen, {without} % without the drift. Errors held "
    "out are without it. Whether another recording drifts alike, --holdout tells"
)
OTHER_ZERO: Final = (
    "held-out recording {k}: one run is off by {whole} % of y's deviation, mostly a constant of {offset} %: "
    "there the zero of sensor or loop is another one. But for that {rest} % is left"
)
STAYS_BEHIND: Final = (
    "{name} does not carry over: of the --holdout recordings {without} % is left without it and {with_it} % "
    "with it. It is of the recordings that were fitted, not of the rig"
)
OTHER_SIZE: Final = (
    "held-out recording {k}: {place} fitted to it is {there}, and was {here}: its size does not repeat"
)


@dataclass(frozen=True, slots=True)
class Searched:
    """Results of the search.

    Attributes:
        base: The baseline, fitted to all windows to fit.
        last_base: The same fitted to all rows: its numbers are told.
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
    searched: Searched,
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
    baseline, plain = _scored(searched.last_base, searched.held, seen)
    extended, whole = _scored(searched.chosen.last, searched.chosen.held, seen)
    base, best = Judged.of(searched.base, to_fit).held, searched.seen
    rest, rare = _remainder(searched, base)
    held = searched.chosen.held
    others = len(held_out.series) > seen
    behind = left_behind(searched.effects, searched.held) if others else ()
    chosen = searched.chosen
    account, yardstick = accounted(chosen.over_all, best, held, searched.held, noise_alone=chosen.noise_alone)
    if rare:
        rest = relevant(rest, max(held.nrmse, best.nrmse), relevance)
        rare = rare if rest.fraction > 0.0 else ()
    elif held.adequacy >= HELD_OUT.adequate:
        rest = systematic_part(rest, account, held.nrmse, relevance, named=bool(searched.effects))
    defects = _record_effects(checked, searched.chosen.held, best)
    for shown in _by_samples(checked):
        numbers = {of: each.value for of, each in shown.parameters.items()}
        extended = replace(extended, effects=extended.effects | {shown.name: numbers})
    every = (*searched.effects, *defects)
    verdict = _verdict(every, rest)
    before, after, clean = baseline.holdout_nrmse, extended.holdout_nrmse, verdict == "clean"
    return Diagnosis(
        verdict=verdict,
        baseline=baseline,
        effects=every,
        extended=extended,
        noise_floor_nrmse=_floor(searched.held, account, rest),
        unexplained=rest,
        next_experiment=_experiment(searched, held_out),
        output=output,
        noise_sd=tuple(recording.noise for recording in held_out.series),
        adequacy=searched.chosen.held.adequacy,
        windows=tuple(_windows(searched, base, best)),
        whole=drawn(held_out, plain, whole),
        candidates=_candidates(searched),
        remarks=(
            *dict.fromkeys(remark for each in checked for remark in each.remarks),
            *rare,
            *_limited(searched.chosen.last),
            *_drifts(searched.chosen),
            *other_zeros(held_out.series, whole, seen),
            *behind,
            *other_sizes(searched.effects),
            *(SWEPT.format(name=each.name) for each in searched.effects if _swept(each, held)),
        ),
        grade=graded(before, after, held.adequacy, account, clean=clean),
        account=account,
        yardstick=yardstick,
        relevance=relevance,
    )


def left_behind(effects: Sequence[FoundEffect], plain: HeldOut) -> tuple[str, ...]:
    """What is said of effects that save nothing of recordings that no fit has seen.

    Args:
        effects: What was found.
        plain: The baseline where no fit has seen.
    """
    least = PRUNE.least_share * above_noise(plain)
    said = []
    for each in effects:
        without, with_it = each.gain.nrmse_without, each.gain.nrmse_with
        if without**2 - with_it**2 < least:
            left, rest = number(100.0 * without), number(100.0 * with_it)
            said.append(STAYS_BEHIND.format(name=each.name, without=left, with_it=rest))
    return tuple(said)


def other_sizes(effects: Sequence[FoundEffect]) -> list[str]:
    """Of numbers whose interval, fitted to a held-out recording, does not meet the one that is told."""
    said = []
    for effect in effects:
        for k, again in enumerate(effect.holdout, 1):
            for name in effect.parameters.keys() & again.keys():
                here, there = effect.parameters[name], again[name]
                if here.ci95[1] < there.ci95[0] or there.ci95[1] < here.ci95[0]:
                    place = f"{effect.name}.{name}"
                    said.append(OTHER_SIZE.format(k=k, place=place, there=_size(there), here=_size(here)))
    return said


def _size(parameter: Parameter) -> str:
    low, high = parameter.ci95
    return f"{with_sd(parameter.value, 0.5 * (high - low))} {parameter.unit}".strip()


def _by_samples(checked: Sequence[Defects]) -> list[Defect]:
    """Causes that samples themselves show, which an extended rig has too: the first of each."""
    every = [each for defects in checked for each in (defects.coarse, defects.held) if each is not None]
    return list({each.name: each for each in reversed(every)}.values())


def trimmed(searched: Searched) -> Searched:
    """The same without rows whose error is none of the rest's, where the recordings have outliers.

    Those that differ little from their neighbours are told by a model only.
    """
    near, seen = _without_outliers(searched.chosen.held), _without_outliers(searched.seen)
    chosen = replace(searched.chosen, held=replace(searched.chosen.held, scored=near))
    return replace(
        searched,
        chosen=chosen,
        held=replace(searched.held, scored=near),
        seen=replace(searched.seen, scored=seen),
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


def unseen_by_fits(searched: Searched) -> bool:
    """Whether windows held out show something of which there is nothing in those that were fitted."""
    halves = searched.seen, searched.chosen.held
    if unexplained(searched.held, halves[1]).fraction == 0.0:
        return False
    return noise_is_larger(*halves) or (one_sided(*halves) and halves[0].adequacy < halves[1].adequacy)


def most_left(searched: Searched) -> float:
    """Mean squared error over the noise's of that half of the windows where it is larger."""
    return max(searched.seen.adequacy, searched.chosen.held.adequacy)


def _remainder(searched: Searched, base: HeldOut) -> tuple[Unexplained, tuple[str, ...]]:
    """What is left, and a remark where one half of the windows shows it alone; `base` is of those fitted."""
    halves = searched.seen, searched.chosen.held
    rest = unexplained(searched.held, searched.chosen.held)
    if rest.fraction > 0.0 and not one_sided(*halves):
        return rest, (LARGER,) if noise_is_larger(*halves) else ()
    if rest.fraction > 0.0:
        return rest, (UNFITTED,)
    if one_sided(*halves):
        return unexplained(replace(base, scored=searched.seen.scored), searched.seen), (RARE,)
    return rest, ()


def _limited(fitted: Fitted) -> list[str]:
    """Numbers that the search would not let go further."""
    values = fitted.model.values(fitted.x)
    return [
        f"{place} is at its limit ({number(values[place])}): the recording does not tell how far it goes"
        for place in at_limits(fitted)
        if place in values
    ]


def _drifts(chosen: Chosen) -> list[str]:
    if chosen.drift is None:
        return []
    rate = chosen.last.model.values(chosen.last.x)[OFFSET_DRIFT_PLACE]
    without, with_it = (number(100.0 * each) for each in (chosen.drift.without, chosen.drift.with_it))
    return [DRIFTS.format(rate=number(rate), without=without, with_it=with_it)]


def other_zeros(series: Sequence[Series], simulated: Sequence[Array], seen: int) -> list[str]:
    """What is said of recordings that no fit has seen, where one run of a speed is off by a constant.

    Args:
        series: The recordings; fits have seen the first `seen`.
        simulated: One run of each.
        seen: How many.
    """
    out = []
    for k, (one, y) in enumerate(zip(series[seen:], simulated[seen:], strict=True), start=1):
        error = (one.y - y)[one.good] / np.std(one.y[one.good])
        offset, rest, whole = float(np.mean(error)), float(np.std(error)), float(np.sqrt(np.mean(error**2)))
        if one.sees_speed and np.isfinite(whole) and offset**2 > ANSWER.mostly_constant * whole**2:
            percents = {"whole": whole, "offset": abs(offset), "rest": rest}
            numbers = {name: f"{100.0 * each:.2g}" for name, each in percents.items()}
            out.append(OTHER_ZERO.format(k=k, **numbers))
    return out


def _swept(effect: FoundEffect, held: HeldOut) -> bool:
    of_plant = EFFECTS[effect.name].enters == "plant"
    return of_plant and any(sweeps(recording.t, recording.u) for recording in held.cut.series)


def _floor(held: HeldOut, account: Account | None, rest: Unexplained) -> float:
    """NRMSE of a perfect model: that of white noise, or of noise of any colour where nothing else is left."""
    if account is None or rest.fraction > 0.0:
        return held.floor
    return max(held.floor, math.sqrt(account.not_repeatable) * held.nrmse)


def _experiment(searched: Searched, held_out: Cut) -> NextExperiment | None:
    best, every = searched.chosen.last, held_out.series
    volts = max(float(np.max(np.abs(one.u))) for one in every)
    asked = best.model, best.x, max(one.noise for one in every), volts, max(one.tick for one in every)
    told = next_experiment(searched.effects, *asked)
    return told or (beyond_a_relay(*asked) if best.model.scales.two_commands else None)


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


def _windows(searched: Searched, base: HeldOut, best: HeldOut) -> list[Window]:
    seen = windows(base, best, held_out=False)
    seen += windows(searched.held, searched.chosen.held, held_out=True)
    return sorted(seen, key=lambda window: (window.file, window.rows))


def _candidates(searched: Searched) -> tuple[Candidate, ...]:
    """Causes that were tried alone, by what they save of the mean log squared error."""
    reference = searched.grown.best[-1].cost
    names = {each.name for each in searched.effects}
    alone = [(one.model.names[0], one) for one in searched.grown.tried.values() if len(one.model.names) == 1]
    out = (Candidate(name, reference - one.cost, name in names) for name, one in alone)
    return tuple(sorted(out, key=lambda each: -each.gain))


def _record_effects(checked: Sequence[Defects], held: HeldOut, fitted: HeldOut) -> list[FoundEffect]:
    """Defects of the recordings, named as effects; rows that are none were left out of all figures.

    `held` and `fitted` are the model's simulations of the windows held out, and of the others.
    """
    out: dict[str, FoundEffect] = {}
    same = Gain(held.nrmse, held.nrmse)
    for k, defects in enumerate(checked):
        one = held.cut.series[k]
        measured = np.where(one.good, one.y, np.nan)
        for each in defects.confirmed(one.t, measured, _by_row(k, held, fitted)):
            out.setdefault(each.name, FoundEffect(each.name, each.parameters, same, each.p_value))
        if defects.coarse is not None and defects.coarse.name not in out:
            out[defects.coarse.name] = _rounded(defects.coarse, defects.step, held)
    return list(out.values())


def _by_row(file: int, *parts: HeldOut) -> Array:
    """Simulated readings of a recording, NaN in rows of no window; shape (n,)."""
    out = np.full(len(parts[0].cut.series[file].t), np.nan)
    for one in parts:
        for (k, first, last), inside in zip(one.cut.windows, one.cut.slices, strict=True):
            if k == file:
                out[first:last] = one.simulated[inside]
    return out


def _rounded(coarse: Defect, step: float, held: HeldOut) -> FoundEffect:
    """A sensor's step: its gain is that of rounding what was simulated."""
    y = held.cut.y
    rounded = step * np.floor(held.simulated / step + 0.5)
    with_it = nrmse([(y[p], rounded[p], held.scored[p]) for p in held.cut.slices])
    return FoundEffect(coarse.name, coarse.parameters, Gain(held.nrmse, with_it), coarse.p_value)
