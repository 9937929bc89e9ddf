"""A recording in words, in figures and as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from seod.estimate.base import finite_or_none
from seod.terminal.text import number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from seod.data.problems import Problem
    from seod.data.source import Floats


class Rows(Protocol):
    """What is described: a `Recording`."""

    @property
    def paths(self) -> Sequence[Path]:
        """Files."""

    @property
    def t(self) -> Floats:
        """Times [s]."""

    @property
    def units(self) -> Mapping[str, str]:
        """By role."""

    @property
    def problems(self) -> Sequence[Problem]:
        """What is wrong."""

    @property
    def rate_hz(self) -> float:
        """By the median interval."""


def columns(of: Rows) -> dict[str, Floats]:
    """All that the recording has, by role."""
    every = {name: getattr(of, name) for name in ("t", "u", "y", "t_u", "ps", "temperature", "f")}
    return {name: column for name, column in every.items() if column is not None}


def title(role: str, unit: str) -> str:
    """`y [rad]`."""
    return f"{role} [{unit}]" if unit else role


def as_dict(of: Rows) -> dict[str, Any]:
    """What it holds; JSON-able."""
    return {
        "files": [str(path) for path in of.paths],
        "rows": len(of.t),
        "rate_hz": finite_or_none(of.rate_hz) if len(of.t) > 1 else None,
        "columns": {name: _range(column, of.units.get(name, "")) for name, column in columns(of).items()},
        "problems": [str(each) for each in of.problems],
    }


def _range(column: Floats, unit: str) -> dict[str, Any]:
    told = column[np.isfinite(column)]
    low, high = (float(told.min()), float(told.max())) if len(told) else (None, None)
    return {"unit": unit, "low": low, "high": high, "missing": len(column) - len(told)}


def as_text(of: Rows) -> str:
    """Length, rate, ranges, and what is wrong with it."""
    told = as_dict(of)
    rate = f", {number(told['rate_hz'])} Hz" if told["rate_hz"] is not None else ""
    span = f", {number(float(of.t[-1] - of.t[0]))} s"
    lines = [f"{', '.join(path.name for path in of.paths)}: {len(of.t)} rows{span}{rate}"]
    for role, column in told["columns"].items():
        missing = f", {column['missing']} missing" if column["missing"] else ""
        ends = f"{number(column['low'])} to {number(column['high'])}"
        lines.append(f"  {title(role, column['unit']):<16} {ends}{missing}")
    return "\n".join([*lines, *(f"! {each}" for each in told["problems"])])


def draw(of: Rows) -> Figure:
    """Command, reading and conditions over time."""
    from seod.plots.style import new_figure, style  # noqa: PLC0415 - matplotlib
    from seod.plots.thin import thinned  # noqa: PLC0415

    shown = {name: column for name, column in columns(of).items() if name not in ("t", "t_u")}
    with style():
        figure = new_figure(8.0, 0.7 + 1.5 * len(shown))
        every = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (role, column) in zip(every, shown.items(), strict=True):
            steps = "steps-post" if role == "u" else "default"
            axes.plot(*thinned(of.t, column), drawstyle=steps, linewidth=0.9)
            axes.set_ylabel(title(role, of.units.get(role, "")))
        every[-1].set_xlabel("t [s]")
        figure.suptitle(", ".join(path.name for path in of.paths))
    return figure
