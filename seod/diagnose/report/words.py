"""A diagnosis in sentences: the same for the terminal and for the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.account.grade import would_have_shown
from seod.diagnose.causes.table import CAUSES, TWINS, sentence
from seod.diagnose.report.units import Units
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.terminal.text import figure, number, with_sd
from sim.effects import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.diagnose.result import (
        Common,
        Diagnosis,
        Effects,
        Evidence,
        FoundEffect,
        Grade,
        OnLoad,
        Parameter,
        Score,
    )

_LEAST: Final = 0.1
"""Change of zeta, omega_n or K_L that is one, part of a command that is an offset, and of the damping [%]."""
GRADES: Final[dict[Grade, str]] = {
    "useless": "the model foretells held-out windows no better than their mean, or than Eq. 1 alone",
    "partly": "the model foretells a part of the movement",
    "good_for_design": "held out it errs by 5 % at most, systematically by 2 % at most",
    "down_to_noise": "nothing systematic is seen in what is left",
}
SHOWN_BY: Final[dict[Evidence, str]] = {
    "nothing": "nothing",
    "repetition": "what repeats with the command",
    "black box": "a black box that foretells windows it has not seen",
    "movement": "errors that are larger where the load moves more",
    "yardstick": "ARX or NARX, which come nearer",
}
OF_POSITION: Final = "(unit of position)"
"""What stands for a position's unit in a cause's sentence."""
_WIDE: Final = 0.5
"""Interval of a share from which on it is not told."""
_VAGUE: Final = 0.5
"""Standard deviation of zeta or omega_n, over its value, from which on neither is told."""


def headline(d: Diagnosis) -> str:
    """The diagnosis in one sentence."""
    missed, has = _listed(d, defects=False), _listed(d, defects=True)
    recording = f"; the recording has {has}" if has else ""
    if d.verdict == "clean":
        return f"Clean: the baseline explains {_all_of(d, 'the recording')}."
    if not missed and d.verdict == "effects":
        return f"The recording has {has}; but for that the baseline explains {_all_of(d, 'it')}."
    if not missed:
        what = "the baseline misses something that none of the known causes explains"
        return f"Unexplained: {what}{recording}."
    before, after = percent(d.baseline.holdout_nrmse), percent(d.extended.holdout_nrmse)
    numbers = f"held-out error {before} before, {after} after, noise {percent(d.noise_floor_nrmse)}"
    rest = "" if d.verdict == "effects" else ", but that is not all"
    return f"The baseline misses {missed}{rest}: {numbers}{recording}."


def _all_of(d: Diagnosis, what: str) -> str:
    """How far nothing relevant is left of it."""
    account = d.account
    if account is None or d.adequacy < HELD_OUT.adequate:
        return f"{what} down to its noise"
    if account.systematic > 0.0:
        return f"{what} but for {percent(account.systematic_nrmse)}, which is less than what counts"
    return f"what repeats of {what}; {percent(d.extended.holdout_nrmse)} of the movement does not repeat"


def of_record(effect: FoundEffect) -> bool:
    """Whether it is a defect of the record: samples that were left out of all figures."""
    return EFFECTS[effect.name].enters == "record"


def _listed(d: Diagnosis, *, defects: bool) -> str:
    """Names of the effects that are defects of the record, or of those that are none."""
    return ", ".join(each.name for each in d.effects if of_record(each) is defects)


def consequences(d: Diagnosis, unit: str = "unit") -> Iterator[str]:
    """What the effects did to zeta and omega_n, what cannot be told apart, and what is left (`unit` of y)."""
    units = Units.of(unit, d.output)
    yield from _accounted(d)
    if d.effects:
        yield from _plant(d)
    yield from (each.replace(OF_POSITION, units.position) for each in _meant(d))
    for effect in d.effects:
        if effect.indistinguishable_from:
            others = ", ".join(effect.indistinguishable_from)
            yield f"{effect.name} cannot be told from {others} by this recording: each may be the cause."
    if d.unexplained.fraction > 0.0:
        yield _left(d)
    if d.extended.diverged:
        yield "In one simulation of the whole recording the position drifts away from it: nothing holds it."
    if d.next_experiment is not None:
        plan = d.next_experiment
        separates = ", ".join(plan.separates)
        yield f"Next experiment, to separate {separates}: {_closed(plan.input)} {_closed(plan.reason)}"
    yield from map(units.told, d.remarks)


def _accounted(d: Diagnosis) -> Iterator[str]:
    """The grade, the three parts of the squared error, and what models without physics reach."""
    account = d.account
    yield f"Grade: {d.grade.replace('_', ' ')}: {GRADES[d.grade]}."
    if account is None:
        return
    if d.yardstick is not None:
        reached = f"ARX {percent(d.yardstick.arx)}, NARX {percent(d.yardstick.narx)}"
        state = d.yardstick.changes_with
        weights = "" if state is None else f" (with weights that change with the {state})"
        yield f"Without physics, over the same windows: {reached}{weights}."
    parts = account.explained, account.systematic, account.not_repeatable
    explained, systematic, rest = (f"{_rounded(100.0 * part)} %" for part in parts)
    if not account.asked:
        yield (
            f"Of the baseline's squared error {explained} is explained. Of the rest nobody can tell what is "
            "systematic: the command sweeps and no two windows are alike, or the plant that was found rings "
            "or is at a limit of its range."
        )
        return
    least = "at least " if account.systematic > 0.0 else ""
    by = f" (shown by {SHOWN_BY[account.shown_by]})" if account.systematic > 0.0 else ""
    yield (
        f"Of the baseline's squared error {explained} is explained, {least}{systematic} systematic and "
        f"unnamed{by}, {rest} not repeatable."
    )
    if account.systematic == 0.0 and not would_have_shown(account, d.extended.holdout_nrmse):
        unseen = min(account.detectable_nrmse, d.extended.holdout_nrmse)
        yield (
            f"So few rows cannot tell whether that is noise: a systematic part of {percent(unseen)} of the "
            "movement might go unseen. A longer recording tells more."
        )
    if account.noise_order and math.isfinite(account.noise_correlation_s):
        memory = f"an autoregression of order {account.noise_order}"
        yield f"What does not repeat is {memory}, alike over {number(account.noise_correlation_s)} s."
        yield from _acts_on(account.on_load)


def _acts_on(part: OnLoad | None) -> Iterator[str]:
    """Where noise with a memory enters: at the load or at the sensor."""
    if part is None:
        return
    if part.most - part.least > _WIDE:
        yield "Its spectrum does not tell whether it acts on the load or on the sensor."
        return
    share, least, most = (_rounded(100.0 * each) for each in part)
    yield (
        f"By its spectrum {share} % [{least}, {most}] of that acts on the load, as gusts or a pump do, and "
        "the rest on the sensor."
    )


def _closed(sentence: str) -> str:
    return sentence if not sentence or sentence.endswith(".") else f"{sentence}."


def _plant(d: Diagnosis) -> Iterator[str]:
    """What Eq. 1 was taken for without the effects: how far off its numbers were."""
    vague = [which for which, score in (("baseline", d.baseline), ("extended", d.extended)) if _vague(score)]
    before, after = _numbers(d.baseline, bool(vague)), _numbers(d.extended, bool(vague))
    told = {name: _off(name, before[name], after[name]) for name in after}
    if any(told.values()):
        changed = [each or f"{name} right" for name, each in told.items()]
        yield f"Without them Eq. 1 comes out with {', '.join(changed)}."
    if vague:
        models = " and the ".join(vague)
        yield f"Of the {models} model only omega_n / (2 zeta) is told: as good as a first-order lag."


def _meant(d: Diagnosis) -> Iterator[str]:
    """What each cause means, and what acts beside one."""
    effects = {name: values for name, values in d.extended.effects.items() if any(values.values())}
    for effect in d.effects:
        if effect.name in CAUSES:
            yield f"{effect.name}: {sentence(effect.name, effects)}"
    for name in effects:
        if (
            name in CAUSES
            and (CAUSES[name].needs or CAUSES[name].shown_by)
            and not _hardly_acts(name, effects)
        ):
            yield f"{name}: {sentence(name, effects)}"


def _hardly_acts(name: str, effects: Effects) -> bool:
    """Whether a cause that could be all of a part of the plant (`TWINS`) is next to nothing of it."""
    whole = {place.split(".")[1]: size for place, size in TWINS.get(name, {}).items()}
    return bool(whole) and all(100.0 * effects[name][of] < _LEAST * size for of, size in whole.items())


def _vague(score: Score) -> bool:
    """Whether the plant is so damped that its two poles cannot be told apart."""
    return score.zeta > 1.0 and any(
        score.sd.get(name, 0.0) > _VAGUE * getattr(score, name) for name in ("zeta", "omega_n")
    )


def _numbers(score: Score, vague: bool) -> dict[str, float]:
    """Those of Eq. 1 that the recording tells."""
    if vague:
        return {"omega_n / (2 zeta)": 0.5 * score.omega_n / score.zeta, "K_L": score.K_L}
    return {"zeta": score.zeta, "omega_n": score.omega_n, "K_L": score.K_L}


def _off(name: str, before: float, after: float) -> str:
    """`zeta 50 % too high (0.6 instead of 0.4)`; "" where it is not off."""
    off = 100.0 * (before / after - 1.0)
    if abs(off) < _LEAST:
        return ""
    way = "high" if off > 0.0 else "low"
    return f"{name} {_rounded(abs(off))} % too {way} ({number(before)} instead of {number(after)})"


def _rounded(percentage: float) -> str:
    return f"{percentage:.0f}" if percentage >= 10.0 else f"{percentage:.2g}"


def _left(d: Diagnosis) -> str:
    share = f"{_rounded(100.0 * d.unexplained.fraction)} % of the baseline's squared error above the noise"
    shares = d.unexplained.shares
    on = [
        f"{_signal(d, name)} ({_rounded(100.0 * shares[name])} % of the rest)"
        if name in shares
        else _signal(d, name)
        for name in d.unexplained.correlates_with
    ]
    return f"Unexplained: {share}{'; it goes with ' if on else ''}{', '.join(on)}."


def _signal(d: Diagnosis, name: str) -> str:
    """What a residual goes with, in words."""
    words = {
        "input": "the command",
        "pressure": f"the {drives_load(d)}",
        "velocity": "the velocity",
        "position": "the position",
        "time": "the time",
        "supply_pressure": "the supply pressure",
        "measured_channel": "the measured disturbance",
    }
    return words.get(name, name)


def drives_load(d: Diagnosis) -> str:
    """What drives the load: a pressure where a supply pressure was recorded, else nobody knows what."""
    return "load pressure" if any(w.ps is not None for w in d.windows) else "load force"


def what_it_is(effect: FoundEffect) -> str:
    """Physics of an effect, from the table."""
    return EFFECTS[effect.name].physics


def interval(parameter: Parameter, units: Units) -> str:
    """`812 ± 9 rad/s^2`, or the ends where they are not symmetric."""
    value, (low, high) = parameter.value, parameter.ci95
    named = units.named(parameter.unit)
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"{figure(value)} {named}".strip()
    half = 0.5 * (high - low)
    if half > 0.0 and abs(high + low - 2.0 * value) < 0.2 * half:
        return f"{with_sd(value, half)} {named}".strip()
    return f"{figure(value)} [{figure(low)}, {figure(high)}] {named}".strip()


def percent(nrmse: float) -> str:
    """An NRMSE for people."""
    if not math.isfinite(nrmse):
        return "-"
    return f"{figure(100.0 * nrmse, 3)} %"


def percent_of(part: float) -> str:
    """A share for people: what is there is never 0 %."""
    return f"{number(100.0 * part, 1)} %" if 0.0 < part < 0.01 else f"{100.0 * part:.0f} %"


def offset_and_delay(d: Diagnosis, common: Common, unit: str) -> list[tuple[str, str, str]]:
    """What a baseline with both has of them: name, value and unit (`unit` of y).

    An offset of u is one of y where that is a speed. Next to nothing of a command, or of a row's time, is 0.
    """
    volts = max((float(np.max(np.abs(w.u))) for w in d.windows), default=0.0)
    tick = max((float(np.max(np.diff(w.t))) for w in d.windows), default=0.0)
    offset, delay = _or_nothing(common.offset, volts), _or_nothing(common.delay, tick)
    told = [("offset of u", offset, "V")]
    if d.output == "velocity":
        told.append(("offset of y", common.K_L * offset + 0.0, unit))  # not -0
    told.append(("delay", 1e3 * delay, "ms"))
    return [(name, number(value, 3) if math.isfinite(value) else "-", of) for name, value, of in told]


def _or_nothing(value: float, whole: float) -> float:
    return 0.0 if abs(value) < 0.01 * _LEAST * whole else value


MOST_RUNS: Final = 4
"""Recordings whose whole runs are told, at most."""


def told_runs(d: Diagnosis) -> list[int]:
    """Recordings whose whole runs are told, in their order: those held out go before the others."""
    unseen = [run.unseen for run in d.extended.free_runs] or [False] * len(d.whole)
    unseen_first = sorted(range(len(unseen)), key=lambda k: not unseen[k])
    return sorted(unseen_first[:MOST_RUNS])


def free_run_names(d: Diagnosis, unit: str) -> dict[int, str]:
    """What `free_run` tells, by the recording that it is of."""
    runs, names = d.extended.free_runs, {}
    for k in told_runs(d) if runs else ():
        which = f" {k + 1}" if len(runs) > 1 else ""
        kind = ", held out" if runs[k].unseen else ""
        names[k] = f"whole run{which}{kind} [{unit}], from a fitted start (measured start)"
    return names


def free_run(score: Score, k: int) -> str:
    """Root mean squares of the error of one simulation of a whole recording."""
    run = score.free_runs[k]
    fitted, measured = (
        figure(each, 3) if math.isfinite(each) else "leaves it"
        for each in (run.from_fitted, run.from_measured)
    )
    return f"{fitted} ({measured})" + (f", {percent(run.nrmse)}" if math.isfinite(run.nrmse) else "")
