"""What one page's scope shows, and what of it goes there next."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import Field

from seod.gateway.params import Params
from seod.panel.wire import ANSWER, LIVE, SWEEP, block

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.panel.history import AxisHistory

SWEEPS_S: Final = 0.08
"""Least time between two sweeps of a trigger."""
BEFORE: Final = 0.2
"""Part of a sweep that lies before the switch."""
HOLDS: Final = 2.5
"""A row stands for so many ticks where no other comes."""
MOST_COLUMNS: Final = 4096
MOST_LIVE_S: Final = 60.0


class ViewParams(Params):
    """What the scope shows: which axes, how long a screen is, how many columns, what starts a sweep."""

    axes: Annotated[list[str], Field(max_length=16)]
    span: Annotated[float, Field(gt=0.001, le=MOST_LIVE_S)] = 2.0
    """[s]"""
    columns: Annotated[int, Field(ge=16, le=MOST_COLUMNS)] = 800
    mode: Literal["free", "trigger", "single", "off"] = "free"


class HistoryParams(Params):
    """A part of the past, between two times of ticks."""

    axis: str
    start: Annotated[float, Field(allow_inf_nan=False)]
    """[s]"""
    end: Annotated[float, Field(allow_inf_nan=False)]
    """[s]"""
    columns: Annotated[int, Field(ge=1, le=MOST_COLUMNS)] = 800
    number: Annotated[int, Field(ge=0, le=2**31)]
    """The answer carries it."""


class View:
    """Follows the history for one page.

    Args:
        histories: Of all axes, in their order.
        period: Of the loop [s].
    """

    def __init__(self, histories: Mapping[str, AxisHistory], period: float) -> None:
        self._histories = histories
        self._period = period
        self._numbers = {name: number for number, name in enumerate(histories)}
        self._next: dict[str, int] = {}
        self._swept: dict[str, float] = {}
        self._done: set[str] = set()
        self._number = 0
        self.shown = ViewParams(axes=[], mode="off")
        self.step = period

    def show(self, params: ViewParams) -> int:
        """Show something else from now on; returns the number that its messages carry."""
        self.shown = params
        self.step = max(self._period, params.span / params.columns)
        self._number += 1
        self._done.clear()
        for name in params.axes:
            time = self._histories[name].time
            newest = float(time[-1]) if len(time) else 0.0
            self._next[name] = max(0, math.floor((newest - params.span) / self.step))
            self._swept[name] = newest
        return self._number

    def message(self) -> bytes:
        """What has come since the last call; empty for nothing."""
        if self.shown.mode == "off":
            return b""
        make = self._live if self.shown.mode == "free" else self._sweep
        return b"".join(make(name) for name in self.shown.axes)

    def _live(self, name: str) -> bytes:
        history, first = self._histories[name], self._next[name]
        if len(history.time) == 0:
            return b""
        last = math.floor(float(history.time[-1]) / self.step)  # the interval that may still get rows
        if last < first - 1:
            first = self._next[name] = last  # time has jumped back
        first = max(first, last - self.shown.columns)
        if last <= first:
            return b""
        self._next[name] = last
        table = history.intervals(first, last, self.step, holds=HOLDS * self._period)
        return block(LIVE, self._numbers[name], self._number, float(first), self.step, table)

    def _sweep(self, name: str) -> bytes:
        history, span = self._histories[name], self.shown.span
        if name in self._done or len(history.time) == 0:
            return b""
        after = 1.0 - BEFORE
        newest = float(history.time[-1])
        earliest = min(self._swept[name], newest)
        switches = history.switches(earliest, newest - after * span)
        if len(switches) == 0:
            return b""
        at = float(switches[-1])
        self._swept[name] = at + SWEEPS_S
        if self.shown.mode == "single":
            self._done.add(name)
        return self._cut(SWEEP, name, self._number, at - BEFORE * span, span, self.shown.columns)

    def answer(self, params: HistoryParams) -> bytes:
        """A part of the past."""
        span = min(MOST_LIVE_S, max(params.end - params.start, self._period))
        return self._cut(ANSWER, params.axis, params.number, params.start, span, params.columns)

    def _cut(self, kind: int, name: str, number: int, start: float, span: float, columns: int) -> bytes:
        step = max(self._period, span / columns)
        first = math.floor(start / step)
        table = self._histories[name].intervals(
            first, first + math.ceil(span / step), step, holds=HOLDS * self._period
        )
        return block(kind, self._numbers[name], number, first * step, step, table)
