"""What was found, put together as the answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.answer import (
    Candidate,
    Diagnosis,
    FoundEffect,
    Gain,
    Parameter,
    Score,
    Unexplained,
)
from seod.diagnose.experiment import beyond_a_relay, next_experiment
from seod.diagnose.halves import fits_both, misfits, one_sided
from seod.diagnose.intervals import base_sd, covariance
from seod.diagnose.judge import Judged
from seod.diagnose.left import left_by_fits, unexplained
from seod.diagnose.score import drawn, nrmse, score, wholes, windows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Array, Mask, NextExperiment, Output, Verdict, Window
    from seod.diagnose.defects import Defects
    from seod.diagnose.fit import Fitted
    from seod.diagnose.name import Chosen
    from seod.diagnose.score import HeldOut
    from seod.diagnose.select import Grown
    from seod.diagnose.windows import Cut

FAR: Final = 4.0
MOST_FAR: Final = 0.03
"""Standard deviations of the noise beyond which a sample is an outlier, where there are any; their part."""
RARE: Final = (
    "what is left shows in windows that were fitted and in none that was held out: no cause of it can be "
    "tried out. A longer recording, in which it happens again, tells more"
)
UNFITTED: Final = (
    "what is left shows in windows that were held out and in none that was fitted: no cause of it can be "
    "fitted. A longer recording, in which it happens again, tells more"
)
UNSURE: Final = (
    "windows held out show a little more than noise and would not, had they been fitted, too: the others "
    "tell too little of how large the effects are. A longer recording tells more"
)


@dataclass(frozen=True, slots=True)
class Found:
    """Results of the search.

    Attributes:
        base: The baseline, fitted to all windows to fit.
        held: Its simulation of the windows held out.
        chosen: The best set of effects.
        seen: Its simulation of the windows to fit.
        effects: Of it, in order of gain.
        grown: What was tried.
        outlying: Rows far off were left out of what is scored, though not of the fits.
        remarks: What else the user has to know of it.
    """

    base: Fitted
    held: HeldOut
    chosen: Chosen
    seen: HeldOut
    effects: tuple[FoundEffect, ...]
    grown: Grown
    outlying: bool = False
    remarks: tuple[str, ...] = ()


def answered(found: Found, to_fit: Cut, aside: Cut, checked: Sequence[Defects], output: Output) -> Diagnosis:
    """The diagnosis; `checked` are the defects of each recording."""
    baseline, plain = _scored(found.base, found.held)
    extended, whole = _scored(found.chosen.found, found.chosen.held)
    base, best = Judged.of(found.base, to_fit).held, found.seen
    left, rare = _left_over(found, base)
    defects = _record_effects(checked, found.chosen.held, best)
    steps = [each.step for each in checked if each.step > 0.0]
    if steps:
        extended = replace(extended, effects=extended.effects | {"sensor_quantization": {"step": steps[0]}})
    every = (*found.effects, *defects)
    return Diagnosis(
        verdict=_verdict(every, left),
        baseline=baseline,
        effects=every,
        extended=extended,
        noise_floor_nrmse=found.held.floor,
        unexplained=left,
        next_experiment=_experiment(found, aside),
        output=output,
        noise_sd=tuple(one.noise for one in aside.series),
        adequacy=found.chosen.held.adequacy,
        windows=tuple(_windows(found, base, best)),
        whole=drawn(aside, plain, whole),
        candidates=_candidates(found),
        remarks=(
            *dict.fromkeys(remark for each in checked for remark in each.remarks),
            *rare,
            *found.remarks,
        ),
    )


def trimmed(found: Found) -> Found:
    """The same without rows whose error is none of the rest's, where the recordings have outliers.

    Those that differ little from their neighbours are told by a model only.
    """
    near, seen = _near(found.chosen.held), _near(found.seen)
    chosen = replace(found.chosen, held=replace(found.chosen.held, scored=near))
    return replace(
        found,
        chosen=chosen,
        held=replace(found.held, scored=near),
        seen=replace(found.seen, scored=seen),
        outlying=True,
    )


def _near(held: HeldOut) -> Mask:
    """Rows that count, but for those far off, if these are few."""
    noise = np.repeat(held.cut.floor, held.cut.sizes)
    near = held.scored & (np.abs(held.cut.gathered("y") - held.simulated) <= FAR * noise)
    return near if np.count_nonzero(near) >= (1.0 - MOST_FAR) * np.count_nonzero(held.scored) else held.scored


def _left_over(found: Found, base: HeldOut) -> tuple[Unexplained, tuple[str, ...]]:
    """What is left, and a remark where one half of the windows shows it alone; `base` is of those fitted."""
    left = unexplained(found.held, found.chosen.held)
    if left.fraction > 0.0:
        if fits_both(found.chosen.found, found.chosen.held):
            return Unexplained(0.0), (UNSURE,)
        return left, (UNFITTED,) if one_sided(found.seen, found.chosen.held) else ()
    if one_sided(found.seen, found.chosen.held):
        return unexplained(replace(base, scored=found.seen.scored), found.seen), (RARE,)
    if not found.outlying and misfits(found.chosen.found):
        left = left_by_fits(found.base, found.chosen.found, found.seen)
    return left, (RARE,) if left.fraction > 0.0 else ()


def _experiment(found: Found, aside: Cut) -> NextExperiment | None:
    best, one = found.chosen.found, aside.series[0]
    volts = float(np.max(np.abs(one.u)))
    asked = best.model, best.x, one.noise, volts, one.tick
    told = next_experiment(found.effects, *asked)
    return told or (beyond_a_relay(*asked) if all(one.relayed for one in aside.series) else None)


def _scored(fitted: Fitted, held: HeldOut) -> tuple[Score, list[Array]]:
    simulated, whole_nrmse, diverged = wholes(fitted.model, fitted.x, held.cut)
    sd = base_sd(fitted, covariance(fitted))
    return score(fitted.model, fitted.x, held, whole_nrmse, diverged, sd), simulated


def _verdict(effects: Sequence[FoundEffect], left: Unexplained) -> Verdict:
    if left.fraction > 0.0:
        return "unexplained"
    return "effects" if effects else "clean"


def _windows(found: Found, base: HeldOut, best: HeldOut) -> list[Window]:
    seen = windows(base, best, aside=False)
    seen += windows(found.held, found.chosen.held, aside=True)
    return sorted(seen, key=lambda window: (window.file, window.rows))


def _candidates(found: Found) -> tuple[Candidate, ...]:
    """Causes that were tried alone, by what they save of the mean log error."""
    reference = max(one.cost for one in found.grown.best)
    names = {each.name for each in found.effects}
    out = []
    for one in found.grown.tried.values():
        if len(one.model.names) == 1:
            gain = reference - one.cost
            nrmse_with = found.held.nrmse * math.exp(-0.5 * gain)
            name = one.model.names[0]
            out.append(Candidate(name, gain, nrmse_with, name in names))
    return tuple(sorted(out, key=lambda each: -each.gain))


def _record_effects(checked: Sequence[Defects], held: HeldOut, fitted: HeldOut) -> list[FoundEffect]:
    """Defects of the recordings, named as effects; rows that are none were left out of all figures.

    `held` and `fitted` are the model's simulations of the windows held out, and of the others.
    """
    out: dict[str, FoundEffect] = {}
    same = Gain(held.nrmse, held.nrmse)
    for k, defects in enumerate(checked):
        rows = defects.off.tolist()
        simulated = _by_row(held, k, rows) | _by_row(fitted, k, rows)
        for each in defects.confirmed(_left(held, k), simulated, held.cut.series[k].noise):
            out.setdefault(each.name, FoundEffect(each.name, each.parameters, same, each.p_value))
        if defects.step > 0.0 and "sensor_quantization" not in out:
            out["sensor_quantization"] = _coarse(defects, held)
    return list(out.values())


def _by_row(held: HeldOut, file: int, rows: Sequence[int]) -> dict[int, float]:
    """Simulated readings of some rows of a recording, as far as they are in its windows."""
    out: dict[int, float] = {}
    for (k, first, last), piece in zip(held.cut.windows, held.cut.slices, strict=True):
        out |= {row: held.simulated[piece][row - first] for row in rows if k == file and first <= row < last}
    return out


def _left(held: HeldOut, file: int) -> float:
    """Mean squared error of a recording's windows held out; infinite where it has none."""
    own = [square for square, (k, _, _) in zip(held.square, held.cut.windows, strict=True) if k == file]
    return float(np.mean(own)) if own else math.inf


def _coarse(defects: Defects, held: HeldOut) -> FoundEffect:
    """A sensor's step: its gain is that of rounding what was simulated."""
    step, wide = defects.step, 1.96 * defects.counts.sd
    y = held.cut.gathered("y")
    rounded = step * np.floor(held.simulated / step + 0.5)
    with_it = nrmse([(y[p], rounded[p], held.scored[p]) for p in held.cut.slices])
    told = {"step": Parameter(step, "unit (unit/s for a speed)", (step - wide, step + wide))}
    return FoundEffect("sensor_quantization", told, Gain(held.nrmse, with_it), 0.0)
