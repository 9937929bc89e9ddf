"""The diagnosis for a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table

from seod.diagnose.report.units import Units
from seod.diagnose.report.words import (
    consequences,
    free_run,
    free_run_names,
    headline,
    interval,
    of_record,
    offset_and_delay,
    percent,
    percent_of,
)
from seod.diagnose.result import SD_OF_95
from seod.terminal import console
from seod.terminal.text import figure, number, with_sd

if TYPE_CHECKING:
    from seod.diagnose.result import Common, Diagnosis, Score


def as_text(d: Diagnosis, unit: str) -> str:
    """Verdict, figures before and after, causes, and what else there is to say."""
    effects = [_effects(d, Units.of(unit, d.output))] if d.effects else []
    tables = console.as_text(_figures(d, unit), _free_runs(d, unit), *effects, width=110)
    command = d.next_experiment.command if d.next_experiment is not None else ""
    said = [f"! {sentence}" for sentence in consequences(d, unit)]
    return "\n".join([headline(d), tables, *said, *([f"  {command}"] if command else [])]).rstrip()


def _figures(d: Diagnosis, unit: str) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    gain = f"K_L\n[{Units.of(unit, d.output).gain}]"
    for title in ("", "held-out error\n[95 %]", "whole", "omega_n\n[rad/s]", "zeta", gain):
        whole = title.startswith("held")
        table.add_column(title, justify="right" if title else "left", overflow="fold", no_wrap=whole)
    for title, score in d.models:
        table.add_row(title, *_score(score))
        if score.common is not None:
            table.add_row(*_common(d, score.common, unit))
    table.add_row("noise", percent(d.noise_floor_nrmse))
    return table


def _common(d: Diagnosis, common: Common, unit: str) -> list[str]:
    """Offset and delay stand below each other: the table is as wide as a terminal."""
    offset, *of_y, delay = (f"{value} {of}" for _, value, of in offset_and_delay(d, common, unit))
    title = ["with offset", offset, *(f"({each} of y)" for each in of_y), f"and delay {delay}"]
    values = (figure(each, 5) for each in (common.omega_n, common.zeta, common.K_L))
    return ["\n".join(title), percent(common.holdout_nrmse), "", *values]


def _free_runs(d: Diagnosis, unit: str) -> Table:
    """Errors of whole recordings, each in one simulation."""
    table = Table(box=box.SIMPLE, pad_edge=False)
    models = d.models
    for title in ("", *(name for name, _ in models)):
        table.add_column(title, justify="right" if title else "left", overflow="fold")
    for k, which in free_run_names(d, unit).items():
        table.add_row(which, *(free_run(score, k) for _, score in models))
    return table


def _score(score: Score) -> list[str]:
    whole = "leaves it" if score.diverged else percent(score.whole_nrmse)
    low, high = score.holdout_ci95
    wide = f" [{figure(100.0 * low, 3)}, {figure(100.0 * high, 3)}]" if math.isfinite(high) else ""
    values = [
        with_sd(getattr(score, name), SD_OF_95 * score.sd.get(name, 0.0))
        for name in ("omega_n", "zeta", "K_L")
    ]
    return [f"{percent(score.holdout_nrmse)}{wide}", whole, *values]


def _effects(d: Diagnosis, units: Units) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("cause", "parameter", "95 % interval", "error without it", "share", "p"):
        table.add_column(title, overflow="fold")
    for effect in d.effects:
        told = [percent(effect.gain.nrmse_without), percent_of(d.share(effect))]
        first = [effect.name, *(["in no figure", "-"] if of_record(effect) else told)]
        rest = [*first[1:], number(effect.p_value, 2)]
        for k, (name, parameter) in enumerate(effect.parameters.items()):
            row = [first[0] if k == 0 else "", name, interval(parameter, units)]
            table.add_row(*row, *(rest if k == 0 else []))
            for file, one in enumerate(effect.holdout, 1):
                table.add_row("", f"  held out {file}", interval(one[name], units) if name in one else "-")
    return table
