"""Trends of an axis as a picture: days with intervals, the reference period, limits, what is beyond."""

from __future__ import annotations

import math
from datetime import UTC, datetime, time, timedelta
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.plots.style import AFTER, BEFORE, FLOOR, new_figure, style, svg
from seod.plots.thin import thinned
from seod.sheet.limits import DRIFT
from seod.sheet.trend import half

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from seod.sheet.trend import Day, Trend

WIDE, HIGH = 9.8, 1.65
"""Width of the picture, and height of each trend [inch]: of a page of 940 pixels, of A4 in print."""
WIDEST: Final = 3.0
"""Intervals that are shown whole, over the median one: those of two estimates that differ are far wider."""
_NOON: Final = time(12, tzinfo=UTC)
_LEAST_DAYS: Final = 1.0
"""Shown at least: one day alone is a point with room about it."""


def trends(told: Mapping[str, Trend]) -> str:
    """An `<svg>`, one trend below the other; "" where nothing was measured."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter  # noqa: PLC0415 - with the first picture

    shown = [each for each in told.values() if each.days]
    if not shown:
        return ""
    with style():
        figure = new_figure(WIDE, HIGH * len(shown) + 0.35)
        rows = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, each in zip(rows, shown, strict=True):
            _draw(axes, each)
        locator = AutoDateLocator(maxticks=9, tz=UTC)  # type: ignore[no-untyped-call] # matplotlib's
        rows[-1].xaxis.set_major_locator(locator)
        rows[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call] # likewise
        rows[-1].set_xlim(*_span(shown))
        handles, labels = rows[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=5, handlelength=1.6, columnspacing=1.2)
        return f'<div class="scroll wide">{svg(figure)}</div>'


def _span(shown: Sequence[Trend]) -> tuple[datetime, datetime]:
    days = [each.day for trend in shown for each in trend.days]
    begin, end = (datetime.combine(day, time(0, tzinfo=UTC)) for day in (min(days), max(days)))
    room = timedelta(days=max(0.02 * (end - begin).days, 0.0 if end > begin else 0.5 * (_LEAST_DAYS - 1.0)))
    return begin - room, end + timedelta(days=1) + room


def _draw(axes: Axes, trend: Trend) -> None:
    moments: Any = np.array([each.t.timestamp() for each in trend.estimates])
    at, values = thinned(moments, np.array([each.value for each in trend.estimates]))
    told: Any = [datetime.fromtimestamp(each, UTC) for each in at.tolist()]
    axes.plot(told, values, ".", markersize=2.5, color=FLOOR, label="estimates of segments")
    for label, colour, alarm in (("mean of the day, 95 %", AFTER, False), ("beyond its limit", BEFORE, True)):
        _days(axes, [each for each in trend.days if each.alarm is alarm], label, colour)
    if trend.reference is not None:
        low, high = trend.reference.mean.interval
        axes.axhspan(low, high, color=FLOOR, alpha=0.25, linewidth=0.0, label="reference period")
    for end, label in zip(_limits(trend), ("limit", "_"), strict=False):
        axes.axhline(end, color=BEFORE, linewidth=0.9, linestyle=(0.0, (4.0, 3.0)), label=label)
    axes.set_ylabel(f"{trend.name} [{trend.unit}]" if trend.unit else trend.name)
    _room(axes, trend)


def _days(axes: Axes, days: Sequence[Day], label: str, colour: str) -> None:
    at: Any = [datetime.combine(each.day, _NOON) for each in days]
    means, wide = [each.mean.value for each in days], [half(each.mean) for each in days]
    look: Any = {"fmt": "o", "markersize": 3.6, "capsize": 2.5, "elinewidth": 1.0, "color": colour}
    axes.errorbar(at, means, yerr=wide, label=label, **look)


def _limits(trend: Trend) -> list[float]:
    """Ends of what is allowed."""
    if trend.limit is not None:
        return [each for each in (trend.limit.low, trend.limit.high) if math.isfinite(each)]
    if trend.reference is None:
        return []
    return [trend.reference.mean.value * (1.0 + sign * DRIFT[trend.name]) for sign in (-1.0, 1.0)]


def _room(axes: Axes, trend: Trend) -> None:
    """So much height that means and limits fill it; an interval far wider than most is cut off."""
    most = WIDEST * float(np.median([half(each.mean) for each in trend.days]))
    ends = [each.mean.value + s * min(half(each.mean), most) for each in trend.days for s in (-1.0, 1.0)]
    ends += _limits(trend)
    low, high = min(ends), max(ends)
    axes.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
