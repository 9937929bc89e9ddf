"""What is in a recording, found in one pass: columns, ranges, rates, gaps, and the shape of each column."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.clock import Clock
from seod.data.columns import unit_in_name
from seod.data.problems import remarks
from seod.data.progress import shown
from seod.data.units import KNOWN

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.data.problems import Problem
    from seod.data.source import Block, Column, Floats, Group, Source, Values

_TIME = re.compile(r"(.*\.)?(t|t_tick|time|timestamps?|zeit|seconds)(_?(s|ms|us))?", re.IGNORECASE)
WORDS = 8
"""Different texts of a column that are told."""


class Envelope:
    """Smallest and largest value in each of at most `2 * bins` stretches of a column of unknown length.

    Attributes:
        rows: Rows to a stretch; doubled whenever there are too many.
        low, high: Of each stretch that is complete; nan where it has no value.
    """

    def __init__(self, bins: int) -> None:
        self._most = 2 * bins
        self.rows = 1
        self.low: Floats = np.array([])
        self.high: Floats = np.array([])
        self._rest: Floats = np.array([])

    def add(self, values: Floats) -> None:
        """Some more rows."""
        values = np.concatenate([self._rest, values])
        whole = len(values) // self.rows * self.rows
        self._rest = values[whole:]
        stretches = values[:whole].reshape(-1, self.rows)
        self.low = np.concatenate([self.low, np.fmin.reduce(stretches, axis=1)])
        self.high = np.concatenate([self.high, np.fmax.reduce(stretches, axis=1)])
        while len(self.low) > self._most:
            self._halve()

    def _halve(self) -> None:
        if len(self.low) % 2:  # the odd one is put back as two rows that are as wide
            last = np.full(self.rows, self.high[-1])
            last[0] = self.low[-1]
            self._rest = np.concatenate([last, self._rest])
        pairs = len(self.low) // 2 * 2
        self.low = np.fmin.reduce(self.low[:pairs].reshape(-1, 2), axis=1)
        self.high = np.fmax.reduce(self.high[:pairs].reshape(-1, 2), axis=1)
        self.rows *= 2


@dataclass
class ColumnSummary:
    """One column.

    Attributes:
        column: Which.
        count: Rows.
        missing: Rows without a value.
        low, high, mean: Of the finite values; nan if there are none.
        words: Different texts, at most `WORDS` + 1 of them.
        envelope: Its shape.
    """

    column: Column
    bins: int
    count: int = 0
    missing: int = 0
    low: float = math.nan
    high: float = math.nan
    words: dict[str, None] = field(default_factory=dict)
    _sum: float = 0.0
    _finite: int = 0

    def __post_init__(self) -> None:
        self.envelope = Envelope(self.bins)

    @property
    def mean(self) -> float:
        """Of the finite values."""
        return self._sum / self._finite if self._finite else math.nan

    def add(self, values: Values) -> None:
        """Some more rows."""
        self.count += len(values)
        if self.column.text:
            self.missing += int((values == "").sum())
            if len(self.words) <= WORDS:
                self.words |= dict.fromkeys(values.tolist())
            return
        finite = values[np.isfinite(values)]
        self.missing += int(np.isnan(values).sum())
        self.envelope.add(np.where(np.isfinite(values), values, np.nan))
        if len(finite):
            self._finite += len(finite)
            self._sum += float(finite.sum())
            self.low = float(np.fmin(self.low, finite.min()))
            self.high = float(np.fmax(self.high, finite.max()))


class GroupSummary:
    """One group.

    Attributes:
        group: Which.
        time: Name of the column that was taken for its time; None if there is none.
        clock: What its times are like, in s where their unit is known.
        columns: One for each column.
        count: Rows.
    """

    def __init__(self, path: Path, group: Group, time: str | None, bins: int) -> None:
        self.group = group
        self.time = time or group.time or _guess(group)
        column = group.column(self.time or "")
        unit = "s" if column is None else column.unit or unit_in_name(column.name)
        self._factor = KNOWN.get(unit, ("", 1.0))[1]
        self.clock = Clock(path, self.time or "", bool(unit))
        self.columns = [ColumnSummary(each, bins) for each in group.columns]
        self.count = 0

    def add(self, block: Block) -> None:
        """Some more rows."""
        self.count += len(block.rows)
        for each in self.columns:
            each.add(block.values[each.column.name])
        if self.time is not None:
            self.clock.add(block.values[self.time] * self._factor, block.rows)


@dataclass
class Summary:
    """What is in a file."""

    source_format: str
    path: Path
    notes: dict[str, str]
    groups: list[GroupSummary]
    problems: list[Problem]

    def as_json(self) -> dict[str, Any]:
        """For programs; undefined is null."""
        return {
            "file": str(self.path),
            "format": self.source_format,
            "bytes": self.path.stat().st_size,
            "notes": self.notes,
            "groups": [_group_json(each) for each in self.groups],
            "problems": [_problem_json(each) for each in self.problems],
        }


def summarize(source: Source, time: str | None = None, bins: int = 60) -> Summary:
    """Read through a file once.

    Args:
        source: The file.
        time: Column of the rows' times, where its name does not say so.
        bins: Half the number of stretches of each column's envelope.

    Raises:
        ReadError: It cannot be read.
    """
    own = {g.name: time if time and g.column(time) else None for g in source.groups}
    groups = {g.name: GroupSummary(source.path, g, own[g.name], bins) for g in source.groups}
    wanted = {group.name: [column.name for column in group.columns] for group in source.groups}
    for block in shown(source.blocks(wanted), source.path.name):
        groups[block.group.name].add(block)
    problems = remarks(source)
    for each in groups.values():
        problems += each.clock.problems() if each.group.main else ()
    return Summary(source.format, source.path, dict(source.notes), list(groups.values()), problems)


def _guess(group: Group) -> str | None:
    """The column whose name says that it is the time."""
    names: Sequence[str] = [column.name for column in group.columns if not column.text]
    exact = [name for name in names if name == "t"]
    return next(iter(exact or filter(_TIME.fullmatch, names)), None)


def _group_json(each: GroupSummary) -> dict[str, Any]:
    clock = each.clock
    time = {
        "column": each.time,
        "first": _finite(clock.first),
        "last": _finite(clock.last),
        "duration": _finite(clock.last - clock.first),
        "rate_hz": _finite(clock.rate_hz),
        "shortest_interval": _finite(clock.shortest),
        "longest_interval": _finite(clock.longest),
        "gaps": clock.gaps,
    }
    columns = [_column_json(column) for column in each.columns]
    return {
        "name": each.group.name,
        "rows": each.count,
        "time": None if each.time is None or not clock.count else time,
        "columns": columns,
    }


def _column_json(each: ColumnSummary) -> dict[str, Any]:
    column = each.column
    common = {"name": column.name, "unit": column.unit, "missing": each.missing}
    if column.text:
        return common | {"words": list(each.words)[:WORDS], "more": len(each.words) > WORDS}
    return common | {name: _finite(getattr(each, name)) for name in ("low", "high", "mean")}


def _problem_json(each: Problem) -> dict[str, Any]:
    return {
        "kind": each.kind,
        "column": each.column,
        "row": each.row,
        "count": len(each.rows),
        "message": each.message,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
