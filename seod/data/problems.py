"""What is wrong with a recording: gaps, times that do not increase, values that are missing or clipped."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.data.source import place

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from seod.data.source import Floats, Rows, Source

_TOLD = ("truncated", "damaged", "unread", "unit")
"""Kinds that are told beside any answer."""
_CLIPPED_RUN = 4
"""Samples in a row at the largest or smallest value that look clipped ..."""
_CLIPPED_STEP = 3.0
"""... where they are reached by a step of so many times the smallest step of all: no smooth peak is."""


@dataclass(frozen=True)
class Problem:
    """One kind of defect in one column.

    Attributes:
        kind: `gap, uneven, unit, duplicate, decreasing, missing, infinite, clipped, several_commands`, or a
            remark of the format's reader: `truncated, damaged, unread`.
        file: Where.
        column: Name in the file; "" where it concerns the whole file.
        rows: Where it begins each time: lines of a text file, else numbers from 1; empty if it is no row.
        message: For people.
    """

    kind: str
    file: Path
    column: str
    rows: Rows
    message: str

    @property
    def row(self) -> int | None:
        """The first of its rows."""
        return int(self.rows[0]) if len(self.rows) else None

    def __str__(self) -> str:
        return f"{place(self.file, self.row, self.column)}: {self.message}"


def remarks(source: Source) -> list[Problem]:
    """What the format's reader noticed."""
    nowhere = np.array([], np.int64)
    return [Problem(r.kind, source.path, "", nowhere, r.message) for r in dict.fromkeys(source.remarks)]


def tell(problems: Iterable[Problem]) -> None:
    """Say on stderr what a user must know of a file before its answer is believed."""
    for problem in problems:
        if problem.kind in _TOLD:
            print(f"seod: {problem}", file=sys.stderr)  # noqa: T201


def value_problems(file: Path, column: str, values: Floats, rows: Rows) -> Iterator[Problem]:
    """Values that are none."""
    for kind, bad, word in (
        ("missing", np.isnan(values), "is missing"),
        ("infinite", np.isinf(values), "is infinite"),
    ):
        if bad.any():
            count = int(bad.sum())
            yield Problem(kind, file, column, rows[bad], f"{word} in {count} of {len(values)} rows")


def clipped(file: Path, column: str, values: Floats, rows: Rows) -> Iterator[Problem]:
    """Samples that stand still at the end of their range although they came there fast."""
    finite = np.isfinite(values)
    if finite.sum() < 2 * _CLIPPED_RUN:
        return
    y, at = values[finite], rows[finite]
    with np.errstate(over="ignore"):  # steps of numbers near the largest there is
        steps = np.abs(np.diff(y))
    if not steps.any():
        return
    least = _CLIPPED_STEP * float(steps[steps > 0.0].min())
    for extreme, word in ((y.max(), "largest"), (y.min(), "smallest")):
        starts, ends = _runs(y == extreme)
        fast = np.array(
            [_fast(steps, start, end, least) for start, end in zip(starts, ends, strict=True)], bool
        )
        starts, ends = starts[fast], ends[fast]
        if len(starts):
            count = int((ends - starts).sum())
            message = (
                f"stands at its {word} value {extreme:g} for {count} rows in {len(starts)} places: clipped?"
            )
            yield Problem("clipped", file, column, at[starts], message)


def _runs(mask: Rows) -> tuple[Rows, Rows]:
    """First index and end of each run of true elements that is long enough."""
    edges = np.diff(np.concatenate(([0], mask.astype(np.int8), [0])))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long = ends - starts >= _CLIPPED_RUN
    return starts[long], ends[long]


def _fast(steps: Floats, start: int, end: int, least: float) -> bool:
    """Whether the two steps before a run and those behind it reach `least`; rest at an end does not count."""
    before, behind = steps[max(0, start - 2) : start], steps[end - 1 : end + 1]
    return bool(len(before) and len(behind) and min(before.max(), behind.max()) >= least)
