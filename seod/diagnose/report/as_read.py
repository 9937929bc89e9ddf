"""A diagnosis in the unit in which y was read, such as mm: the answer itself is in SI base units."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from seod.config.units import KNOWN, ZEROS
from seod.diagnose.report.units import NOBODYS
from seod.terminal.text import number, with_sd
from sim.effects import parameter, power_of_y

if TYPE_CHECKING:
    import re

    from seod.data import Recording
    from seod.diagnose.result import (
        Common,
        Diagnosis,
        Effects,
        FoundEffect,
        FreeRun,
        Parameter,
        Score,
        Whole,
        Window,
    )


def as_read(d: Diagnosis, recording: Recording, unit: str) -> tuple[Diagnosis, str]:
    """What is told to people: the diagnosis in the unit in which y was read, and that unit.

    Args:
        d: In the unit of `recording.y`.
        recording: The first that it is of.
        unit: Of `recording.y`.
    """
    own = recording.read_in.get("y", "")
    factor = KNOWN[own][1] if own in KNOWN and own not in ZEROS else 1.0
    return (d, unit) if factor == 1.0 else (scaled(d, 1.0 / factor), own)


def scaled(d: Diagnosis, factor: float) -> Diagnosis:
    """The same with `factor` units of y in the place of one; times, volts and shares stay."""
    return replace(
        d,
        baseline=_score(d.baseline, factor),
        extended=_score(d.extended, factor),
        effects=tuple(_effect(each, factor) for each in d.effects),
        noise_sd=tuple(factor * each for each in d.noise_sd),
        windows=tuple(_window(each, factor) for each in d.windows),
        whole=tuple(_whole(each, factor) for each in d.whole),
        remarks=tuple(_sentence(each, factor) for each in d.remarks),
    )


def _score(score: Score, factor: float) -> Score:
    sd = {name: each * factor if name == "K_L" else each for name, each in score.sd.items()}
    return replace(
        score,
        K_L=factor * score.K_L,
        effects=_values(score.effects, factor),
        sd=sd,
        common=None if score.common is None else _common(score.common, factor),
        free_runs=tuple(_run(each, factor) for each in score.free_runs),
    )


def _common(common: Common, factor: float) -> Common:
    return replace(common, K_L=factor * common.K_L)


def _run(run: FreeRun, factor: float) -> FreeRun:
    return replace(run, from_measured=factor * run.from_measured, from_fitted=factor * run.from_fitted)


def _values(effects: Effects, factor: float) -> Effects:
    return {
        name: {of: x * factor ** power_of_y(parameter(f"{name}.{of}")[1].unit) for of, x in values.items()}
        for name, values in effects.items()
    }


def _effect(effect: FoundEffect, factor: float) -> FoundEffect:
    return replace(
        effect,
        parameters={name: _parameter(each, factor) for name, each in effect.parameters.items()},
        holdout=tuple(
            {name: _parameter(each, factor) for name, each in one.items()} for one in effect.holdout
        ),
    )


def _parameter(told: Parameter, factor: float) -> Parameter:
    by = factor ** power_of_y(told.unit)
    low, high = told.ci95
    return replace(told, value=by * told.value, ci95=(by * low, by * high))


def _window(window: Window, factor: float) -> Window:
    names = ("y", "y_baseline", "y_extended", "velocity", "position", "pressure")
    return replace(window, **{name: factor * getattr(window, name) for name in names})


def _whole(whole: Whole, factor: float) -> Whole:
    names = ("y", "y_baseline", "y_extended")
    return replace(whole, **{name: factor * getattr(whole, name) for name in names})


def _sentence(sentence: str, factor: float) -> str:
    return NOBODYS.sub(lambda found: _scaled(found, factor ** power_of_y(found["unit"])), sentence)


def _scaled(found: re.Match[str], by: float) -> str:
    value, second = by * float(found["value"]), by * float(found["second"] or 0.0)
    if found["joined"] == "±":
        told = with_sd(value, second)
    else:
        told = number(value) + (f" and {number(second)}" if found["joined"] else "")
    return f"{told} {found['unit']}"
