"""The diagnosis for a terminal."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from seod.diagnose.report.words import consequences, headline, interval, of_record, percent
from seod.text import number, with_sd

if TYPE_CHECKING:
    from seod.diagnose.answer import Diagnosis, Score


def as_text(d: Diagnosis, unit: str) -> str:
    """Verdict, figures before and after, causes, and what else there is to say."""
    page = io.StringIO()
    console = Console(file=page, width=110)
    console.print(_figures(d))
    if d.effects:
        console.print(_effects(d, unit.removesuffix("/s")))
    lines = [line.rstrip() for line in page.getvalue().splitlines()]
    command = d.next_experiment.command if d.next_experiment is not None else ""
    said = [f"! {sentence}" for sentence in consequences(d)]
    return "\n".join([headline(d), *lines, *said, *([f"  {command}"] if command else [])]).rstrip()


def _figures(d: Diagnosis) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("", "held-out error [95 %]", "whole", "omega_n [rad/s]", "zeta", "K_L"):
        table.add_column(escape(title), justify="right" if title else "left", no_wrap=True)
    models = (("baseline", d.baseline), ("extended", d.extended))[: 2 if d.extends else 1]
    for title, score in models:
        table.add_row(title, *_score(score))
    table.add_row("noise", percent(d.noise_floor_nrmse))
    return table


def _score(score: Score) -> list[str]:
    whole = "leaves it" if score.diverged else percent(score.whole_nrmse)
    low, high = score.holdout_ci95
    wide = f" [{100.0 * low:.3g}, {100.0 * high:.3g}]" if math.isfinite(high) else ""
    values = [
        with_sd(getattr(score, name), 1.96 * score.sd.get(name, 0.0)) for name in ("omega_n", "zeta", "K_L")
    ]
    return [escape(f"{percent(score.holdout_nrmse)}{wide}"), whole, *values]


def _effects(d: Diagnosis, unit: str) -> Table:
    table = Table(box=box.SIMPLE, pad_edge=False)
    for title in ("cause", "parameter", "95 % interval", "error without it", "share", "p"):
        table.add_column(title)
    for effect in d.effects:
        told = [percent(effect.gain.nrmse_without), f"{100.0 * d.share(effect):.0f} %"]
        first = [effect.name, *(["in no figure", "-"] if of_record(effect) else told)]
        rest = [*first[1:], number(effect.p_value, 2)]
        for k, (name, parameter) in enumerate(effect.parameters.items()):
            row = [first[0] if k == 0 else "", name, interval(parameter, unit)]
            table.add_row(*row, *(rest if k == 0 else []))
    return table
