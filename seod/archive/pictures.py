"""Pictures of a trend and of two rigs side by side."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.archive.questions import UNITS
from seod.plots.style import ORDER, new_figure, style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

MOST: Final = 5
"""Axes in one picture: as many colours can be told apart."""


def draw(points: Sequence[Mapping[str, Any]], quantity: str) -> Figure:
    """Values over time with 95 % intervals, an axis a colour; of many axes the first `MOST`, which is said.

    Args:
        points: Rows of `seod.archive.questions.points`.
        quantity: Its name.
    """
    lines: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for row in points:
        lines[f"{row['rig']}, {row['axis']}"].append(row)
    with style():
        figure = new_figure(8.0, 3.6)
        axes = figure.add_subplot()
        for (name, rows), colour in zip(lines.items(), ORDER[:MOST], strict=False):
            times = [row["begin"] for row in rows]
            values = np.array([row["value"] for row in rows])
            spread = 1.96 * np.array([row["sd"] or 0.0 for row in rows])
            axes.errorbar(times, values, spread, fmt=".", color=colour, elinewidth=0.6, label=name)
        unit = f" [{UNITS[quantity]}]" if UNITS[quantity] else ""
        axes.set_ylabel(f"{quantity}{unit}")
        more = f"; {len(lines) - MOST} more are not shown" if len(lines) > MOST else ""
        axes.set_title(f"{quantity} over time, 95 % intervals{more}")
        if lines:
            axes.legend()
        figure.autofmt_xdate()
    return figure
