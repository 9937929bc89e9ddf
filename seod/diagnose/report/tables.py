"""The report's tables as HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from seod.diagnose.report.words import interval, percent, what_it_is
from seod.text import number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.answer import Diagnosis, FoundEffect, Score

Interval = tuple[float, float]


def table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """HTML of cells that are escaped already."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<table class="{kind}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'


def figures(d: Diagnosis, unit: str, intervals: tuple[Interval, Interval]) -> str:
    """Errors and the plant's numbers, before and after."""
    base = unit.removesuffix("/s")
    before, after = d.baseline, d.extended
    rows = [
        ["held-out error (NRMSE)", _with_interval(before, intervals[0]), _with_interval(after, intervals[1])],
        ["whole recording in one simulation", _whole(before), _whole(after)],
        ["noise floor", percent(d.noise_floor_nrmse), percent(d.noise_floor_nrmse)],
        ["omega_n [rad/s]", _value(before, "omega_n"), _value(after, "omega_n")],
        ["zeta", _value(before, "zeta"), _value(after, "zeta")],
        [f"K_L [{escape(base)}/s/V]", _value(before, "K_L"), _value(after, "K_L")],
    ]
    return table(["", "baseline", "extended"], rows, "figures")


def _with_interval(score: Score, ends: Interval) -> str:
    return f"<b>{percent(score.holdout_nrmse)}</b> <small>{percent(ends[0])} to {percent(ends[1])}</small>"


def _whole(score: Score) -> str:
    return "leaves the recording" if score.diverged else percent(score.whole_nrmse)


def _value(score: Score, name: str) -> str:
    value, sd = getattr(score, name), score.sd.get(name)
    wide = f" <small>± {number(1.96 * sd, 2)}</small>" if sd else ""
    return f"{number(value, 5)}{wide}"


def effects(d: Diagnosis, unit: str) -> str:
    """What was found: parameters, gain, share and likelihood."""
    head = ["cause", "parameters, 95 % interval", "error without it → with it", "share", "p", "not told from"]
    return table(head, [_effect(d, effect, unit) for effect in d.effects], "effects")


def _effect(d: Diagnosis, effect: FoundEffect, unit: str) -> list[str]:
    base = unit.removesuffix("/s")
    values = [f"{escape(name)} = {escape(interval(p, base))}" for name, p in effect.parameters.items()]
    gain = effect.gain
    p = "&lt; 0.0001" if effect.p_value < 1e-4 else number(effect.p_value, 2)
    return [
        f"<b>{escape(effect.name)}</b><br><small>{escape(what_it_is(effect))}</small>",
        "<br>".join(values),
        f"{percent(gain.nrmse_without)} → {percent(gain.nrmse_with)}",
        f"{100.0 * share(d, effect):.0f} %",
        p,
        escape(", ".join(effect.indistinguishable_from)),
    ]


def share(d: Diagnosis, effect: FoundEffect) -> float:
    """Part of the baseline's held-out squared error above the noise that this effect alone takes away."""
    above = d.baseline.holdout_nrmse**2 - d.noise_floor_nrmse**2
    gained = effect.gain.nrmse_without**2 - effect.gain.nrmse_with**2
    return min(1.0, max(0.0, gained / above)) if above > 0.0 else 0.0


def ranking(d: Diagnosis) -> str:
    """Every candidate, by what it gains alone."""
    most = max((each.gain for each in d.candidates), default=0.0)
    rows = [
        [
            f"<b>{escape(each.name)}</b>" if each.chosen else escape(each.name),
            _bar(each.gain / most if most > 0.0 else 0.0, each.chosen),
            percent(each.nrmse_with),
        ]
        for each in d.candidates
    ]
    return table(["cause, alone", "gain", "held-out error with it"], rows, "ranking")


def _bar(part: float, chosen: bool) -> str:
    kind = "bar chosen" if chosen else "bar"
    return f'<div class="{kind}" style="width:{max(1.0, 220.0 * min(1.0, max(0.0, part))):.0f}px"></div>'
