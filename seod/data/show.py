"""A summary for people: as text with a small picture of each column, and as a plot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import ReadError
from seod.data.summary import WORDS
from seod.terminal.text import number

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from seod.data.summary import ColumnSummary, Envelope, GroupSummary, Summary

_LEVELS = "▁▂▃▄▅▆▇█"
PICTURE = 40
"""Widest picture [characters]."""
_PLOTTED = 12
"""Most columns of a plot."""


def as_text(summary: Summary) -> str:
    """Everything."""
    size = summary.path.stat().st_size
    lines = [f"{summary.path}: {summary.source_format}, {_bytes(size)}"]
    lines += [f"  {key}: {value}" for key, value in summary.notes.items()]
    for group in summary.groups:
        lines += _group(group)
    lines += [f"! {problem}" for problem in summary.problems]
    return "\n".join(lines)


def _group(each: GroupSummary) -> list[str]:
    name = f"{each.group.name}: " if each.group.name else ""
    lines = [f"{name}{each.count} rows{_times(each)}"]
    if not each.count or not each.group.main:  # of notes it is enough to say that they are there
        return lines
    widest = max(len(_title(column)) for column in each.columns)
    return lines + [f"  {_title(column):<{widest}}  {_values(column)}" for column in each.columns]


def _times(each: GroupSummary) -> str:
    clock = each.clock
    if each.time is None or not clock.count:
        return ", no column is known as time"
    text = f", {each.time} from {clock.first:.10g} to {clock.last:.10g} s ({clock.last - clock.first:.6g} s)"
    if clock.count > 1:
        text += f", {number(clock.rate_hz)} Hz, intervals {clock.shortest:.3g} to {clock.longest:.3g} s"
        text += f", {clock.gaps} gaps" if clock.gaps else ""
    return text


def _title(each: ColumnSummary) -> str:
    return f"{each.column.name} [{each.column.unit}]" if each.column.unit else each.column.name


def _values(each: ColumnSummary) -> str:
    missing = f", {each.missing} missing" if each.missing else ""
    if each.column.text:
        words = [word if len(word) <= PICTURE else f"{word[:PICTURE]} ..." for word in each.words if word][
            :WORDS
        ]
        return ", ".join(words) + (", ..." if len(each.words) > WORDS else "") + missing
    if math.isnan(each.low):
        return "empty"
    ends = f"{number(each.low)} ... {number(each.high)}"
    return f"{picture(each.envelope)}  {ends}{missing}"


def picture(envelope: Envelope) -> str:
    """The largest value of each segment as a bar; a blank where there is no value."""
    fold = max(1, math.ceil(len(envelope.high) / PICTURE))
    high = np.array([np.fmax.reduce(envelope.high[k : k + fold]) for k in range(0, len(envelope.high), fold)])
    low = np.fmin.reduce(envelope.low, initial=np.inf)
    span = np.fmax.reduce(high, initial=-np.inf) - low
    scaled = (high - low) / span * (len(_LEVELS) - 1) if span > 0 else high * 0.0
    text = "".join(" " if math.isnan(value) else _LEVELS[round(value)] for value in scaled)
    return text.ljust(PICTURE)


def _bytes(count: int) -> str:
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.4g} {unit}"
        count /= 1000  # type: ignore[assignment] # a float from here on
    return f"{count:.4g} GB"


def plot(summary: Summary, to: Path) -> None:
    """Draw the columns of the main groups over their rows' time into a PNG, SVG or PDF file.

    Raises:
        ReadError: There is nothing to draw.
        ValueError: The file's ending is none of these.
        OSError: The file cannot be written.
    """
    from seod.plots.style import AFTER, new_figure, save, style  # noqa: PLC0415 - only where something is drawn

    drawn = [
        (group, column)
        for group in summary.groups
        if group.group.main
        for column in group.columns
        if column.column.name != group.time and column.low < column.high
    ]
    if not drawn:
        raise ReadError(f"{summary.path}: no column of numbers that vary: nothing to draw")
    if len(drawn) > _PLOTTED:
        names = ", ".join(column.column.name for _, column in drawn[_PLOTTED:])
        summary.notes["not drawn"] = names
        drawn = drawn[:_PLOTTED]
    with style():
        figure = new_figure(9.0, 1.0 + 1.4 * len(drawn))
        rows = figure.subplots(len(drawn), 1, squeeze=False)[:, 0]
        for axes, (group, column) in zip(rows, drawn, strict=True):
            x, label = _abscissa(group, column)
            span = column.envelope.low, column.envelope.high
            axes.fill_between(x, *span, step="mid", linewidth=0.8, color=AFTER)  # the edge shows what is flat
            axes.set(ylabel=_title(column), xlabel=label)
        figure.suptitle(summary.path.name)
    save(figure, to)


def _abscissa(group: GroupSummary, column: ColumnSummary) -> tuple[NDArray[Any], str]:
    """Time in the middle of each segment from the first one's, or the row where there is no time."""
    time = next((each for each in group.columns if each.column.name == group.time), None)
    if time is None or len(time.envelope.low) != len(column.envelope.low):
        return np.arange(len(column.envelope.low)) * column.envelope.rows, "row"
    middle = 0.5 * (time.envelope.low + time.envelope.high)
    return middle - middle[0], f"{_title(time)} from {middle[0]:.6g}"
