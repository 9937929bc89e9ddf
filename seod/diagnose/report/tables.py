"""The report's tables as HTML."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING

from seod.diagnose.report.units import Units
from seod.diagnose.report.words import (
    free_run,
    free_run_names,
    interval,
    of_record,
    offset_and_delay,
    percent,
    percent_of,
    what_it_is,
)
from seod.diagnose.result import SD_OF_95
from seod.plots.page import table
from seod.terminal.text import figure, number, with_sd

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.diagnose.result import Common, Diagnosis, FoundEffect, Score


def figures(d: Diagnosis, unit: str) -> str:
    """Errors and the plant's numbers, before and, if anything was found, after."""
    models = d.models
    told: list[tuple[str, Callable[[Score], str]]] = [
        ("held-out error (NRMSE)", _held_out),
        ("whole recording in one simulation", _whole),
        ("noise floor", lambda _: percent(d.noise_floor_nrmse)),
        ("omega_n [rad/s]", lambda score: _value(score, "omega_n")),
        ("zeta", lambda score: _value(score, "zeta")),
        (f"K_L [{escape(Units.of(unit, d.output).gain)}]", lambda score: _value(score, "K_L")),
    ]
    head = ["", *(name for name, _ in models)]
    rows = [[title, *(of(score) for _, score in models)] for title, of in told]
    free_runs = [
        [escape(which), *(free_run(score, k) for _, score in models)]
        for k, which in free_run_names(d, unit).items()
    ]
    common = d.baseline.common
    if common is not None:
        own = ["baseline with offset and delay", *_common(d, common)]
        head, *rows = [_inserted(row, cell) for row, cell in zip([head, *rows], own, strict=True)]
        rows += [
            _inserted([f"{name} [{escape(of)}]", *("" for _ in models)], value)
            for name, value, of in offset_and_delay(d, common, unit)
        ]
        free_runs = [_inserted(row, "") for row in free_runs]
    return table(head, [*rows, *free_runs], "figures")


def _inserted(row: list[str], cell: str) -> list[str]:
    """A cell behind that of the baseline."""
    return [*row[:2], cell, *row[2:]]


def _common(d: Diagnosis, common: Common) -> list[str]:
    """Figures of the baseline with offset and delay, in the order of the table."""
    values = (figure(each, 5) for each in (common.omega_n, common.zeta, common.K_L))
    return [f"<b>{percent(common.holdout_nrmse)}</b>", "", percent(d.noise_floor_nrmse), *values]


def _held_out(score: Score) -> str:
    low, high = score.holdout_ci95
    wide = f" <small>{percent(low)} to {percent(high)}</small>" if math.isfinite(high) else ""
    return f"<b>{percent(score.holdout_nrmse)}</b>{wide}"


def _whole(score: Score) -> str:
    return "leaves the recording" if score.diverged else percent(score.whole_nrmse)


def _value(score: Score, name: str) -> str:
    value, sd = getattr(score, name), score.sd.get(name)
    return with_sd(value, SD_OF_95 * sd) if sd else figure(value, 5)


def effects(d: Diagnosis, unit: str) -> str:
    """What was found: parameters, gain, share and likelihood."""
    head = ["cause", "parameters, 95 % interval", "error without it → with it", "share", "p"]
    doubtful = any(effect.indistinguishable_from for effect in d.effects)
    again = any(effect.holdout for effect in d.effects)
    rows = [_effect(d, effect, unit) for effect in d.effects]
    if again:
        head.append("fitted to the held-out recording")
        for row, effect in zip(rows, d.effects, strict=True):
            row.append(_again(effect, Units.of(unit, d.output)))
    if doubtful:
        head.append("not told from")
        for row, effect in zip(rows, d.effects, strict=True):
            row.append(escape(", ".join(effect.indistinguishable_from)) or "-")
    return table(head, rows, "effects")


def _effect(d: Diagnosis, effect: FoundEffect, unit: str) -> list[str]:
    units = Units.of(unit, d.output)
    values = [f"{escape(name)} = {escape(interval(p, units))}" for name, p in effect.parameters.items()]
    gain = effect.gain
    told = [f"{percent(gain.nrmse_without)} → {percent(gain.nrmse_with)}", percent_of(d.share(effect))]
    return [
        f"<b>{escape(effect.name)}</b><br><small>{escape(what_it_is(effect))}</small>",
        "<br>".join(values),
        *(["in no figure", "-"] if of_record(effect) else told),
        "&lt; 0.0001" if effect.p_value < 1e-4 else number(effect.p_value, 2),
    ]


def _again(effect: FoundEffect, units: Units) -> str:
    """The same parameters by each recording of --holdout."""
    each = [
        "<br>".join(f"{escape(name)} = {escape(interval(p, units))}" for name, p in one.items()) or "-"
        for one in effect.holdout
    ]
    return "<br>".join(each) or "-"


def ranking(d: Diagnosis) -> str:
    """Every candidate, by what it gains alone."""
    most = max((each.gain for each in d.candidates), default=0.0)
    rows = [
        [
            f"<b>{escape(each.name)}</b>" if each.chosen else escape(each.name),
            _bar(each.gain / most if most > 0.0 else 0.0, each.chosen),
        ]
        for each in d.candidates
    ]
    return table(["cause, alone", "gain in the windows fitted"], rows, "ranking")


def _bar(part: float, chosen: bool) -> str:
    kind = "bar chosen" if chosen else "bar"
    return f'<div class="{kind}" style="width:{max(1.0, 220.0 * min(1.0, max(0.0, part))):.0f}px"></div>'
