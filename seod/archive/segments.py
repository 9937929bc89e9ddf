"""Segments of one axis, as its rows and messages come: a long recording takes no more room than they."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from seod.archive.layout import LONGEST_S
from seod.processes.ring import FLAG_EXCITING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

GOOD: Final = "ok"
"""Quality of an estimate that goes before all others."""
_MEANS: Final = {"reference": "reference", "ps": "supply_pressure", "temperature": "temperature"}
"""Fields of a row whose mean is told, with the column's name."""
_TOLD: Final = ("zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd", "quality")
"""Fields of an estimate that become columns."""


class Mean:
    """Of the numbers added so far that are finite."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def add(self, values: NDArray[np.float64]) -> None:
        """Take values, shape (n,); nan and infinite ones are left out."""
        finite = values[np.isfinite(values)]
        self._sum += float(finite.sum())
        self._count += len(finite)

    @property
    def value(self) -> float | None:
        """None of nothing."""
        return self._sum / self._count if self._count else None


@dataclass(slots=True)
class Segment:
    """One segment; times are those of the loop's clock [s].

    Attributes:
        excited: Whether the relay is on.
        first: Time of its first row.
        last: Of its last row.
        tick: Number of the last row's tick.
        rows: How many.
        lost: Ticks without a row among them.
        estimate: The last estimate of quality `ok`; where there is none, the last one.
        errors: Of the model beside: error over the movement, of each window.
        left: When the model was first told to be left; None: it was not.
        faults: In their order.
    """

    excited: bool
    first: float
    last: float
    tick: int
    rows: int = 0
    lost: int = 0
    means: dict[str, Mean] = field(default_factory=lambda: {name: Mean() for name in (*_MEANS, "e_a")})
    estimate: dict[str, Any] | None = None
    errors: list[float] = field(default_factory=list)
    left: float | None = None
    faults: list[dict[str, Any]] = field(default_factory=list)

    def add(self, rows: NDArray[np.void]) -> None:
        """Take rows (dtype `seod.record.layout.ROW`) that belong to it."""
        steps = np.diff(rows["tick"], prepend=self.tick)
        self.lost += int(np.maximum(steps - 1, 0).sum())
        self.rows += len(rows)
        self.last, self.tick = float(rows["t_tick"][-1]), int(rows["tick"][-1])
        for name in _MEANS:
            self.means[name].add(rows[name])
        if self.excited:
            self.means["e_a"].add(rows["e_a"])

    def take(self, note: Note) -> None:
        """Take a message of a time within it."""
        if note.kind == "estimate":
            if self.estimate is None or note.content.get("quality") == GOOD or not self._has_good:
                self.estimate = note.content
        elif note.kind == "fault":
            self.faults.append(note.content)
        else:
            error = note.content.get("nrmse")
            if isinstance(error, float | int) and math.isfinite(error):
                self.errors.append(float(error))
            if note.content.get("left") and self.left is None:
                self.left = note.t

    @property
    def _has_good(self) -> bool:
        return self.estimate is not None and self.estimate.get("quality") == GOOD

    def as_row(self) -> dict[str, Any]:
        """Its columns, but for those of the file and for times, which need the file's clock."""
        estimate = self.estimate or {}
        seconds = self.last - self.first
        return {
            "seconds": seconds,
            "rows": self.rows,
            "lost": self.lost,
            **{column: self.means[name].value for name, column in _MEANS.items()},
            "e_a": self.means["e_a"].value,
            **{name: estimate.get(name) for name in _TOLD},
            "model_error": statistics.median(self.errors) if self.errors else None,
            "left_model": self.left is not None if self.errors else None,
            "exciting_s": seconds if self.excited else 0.0,
        }


class Note(NamedTuple):
    """A message about an axis: `estimate`, `model_error` or `fault`, its time [s], its content."""

    kind: str
    t: float
    content: dict[str, Any]


class Segments:
    """Cuts the rows of one axis, and brings each message to the segment of its time."""

    def __init__(self) -> None:
        self.all: list[Segment] = []
        self._waiting: list[Note] = []

    def add(self, rows: NDArray[np.void]) -> None:
        """Take the next rows (dtype `seod.record.layout.ROW`)."""
        for run in _runs(rows):
            self._add_run(run)
        if self.all:
            self._settle(self.all[-1].last)

    def _add_run(self, run: NDArray[np.void]) -> None:
        excited = bool(run["flags"][0] & FLAG_EXCITING)
        while len(run):
            if not self.all or self.all[-1].excited is not excited or _is_full(self.all[-1], run):
                first = float(run["t_tick"][0])
                self.all.append(Segment(excited, first, first, int(run["tick"][0]) - 1))
            room = int(np.searchsorted(run["t_tick"], self.all[-1].first + LONGEST_S))
            self.all[-1].add(run[: max(room, 1)])
            run = run[max(room, 1) :]

    def note(self, note: Note) -> None:
        """Take a message; it waits until rows of its time have come."""
        self._waiting.append(note)

    def finish(self) -> None:
        """No more rows come."""
        self._settle(math.inf)

    def _settle(self, until: float) -> None:
        late = [note for note in self._waiting if note.t > until]
        for note in self._waiting:
            if note.t <= until and self.all:
                self._at(note.t).take(note)
        self._waiting = late

    def _at(self, t: float) -> Segment:
        """The segment of a time; the first one for what was before it."""
        return next((each for each in reversed(self.all) if each.first <= t), self.all[0])


def _is_full(segment: Segment, run: NDArray[np.void]) -> bool:
    return bool(run["t_tick"][0] >= segment.first + LONGEST_S)


def _runs(rows: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Rows cut where excitation begins or ends."""
    if len(rows):
        excited = (rows["flags"] & FLAG_EXCITING) > 0
        yield from np.split(rows, np.flatnonzero(np.diff(excited)) + 1)
