"""Rows of an archive's catalogue as a sheet needs them: one for each segment of an axis of a recording."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from seod.config.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from datetime import date, datetime


class SheetError(Exception):
    """There is no sheet to be made; the message says why and what would be right."""


class Number(NamedTuple):
    """A parameter of a cause, with its unit and 95 % interval (None where it has none)."""

    value: float
    unit: str
    interval: tuple[float, float] | None


class Cause(NamedTuple):
    """What a diagnosis named."""

    name: str
    parameters: Mapping[str, Number]


class Fault(NamedTuple):
    """A fault of the guard: when (UTC), its code, the sentence."""

    t: str
    code: str
    why: str


@dataclass(frozen=True, slots=True)
class Segment:
    """One row; what is undefined is None. Units are SI, those of the axis by `unit`.

    Attributes:
        file: The recording, relative to the archive.
        axis: Its name.
        unit: Of what the axis measures.
        begin, end: UTC.
        seconds: From the first to the last row [s].
        exciting_s: Of excitation [s].
        lost: Rows that are missing.
        values: zeta, omega_n, K_L by name: value and standard deviation, where both are known.
        K_L: As used, measured or given [unit/s/V].
        quality: Of the estimate.
        e_a: Amplitude of the relay [V].
        left_model: Whether a model that ran beside was left; None where none ran.
        left_since: When that was first said.
        verdict: Of a diagnosis; None where there is none.
        causes: It named.
        faults: In this segment.
        version: Of the seod that recorded.
        simulated: The rig is a simulated one.
        problem: Why the file could not be read whole.
    """

    file: str
    axis: str
    unit: str
    begin: datetime
    end: datetime
    seconds: float
    exciting_s: float
    lost: int
    values: Mapping[str, tuple[float, float]]
    K_L: float | None
    quality: str | None
    e_a: float | None
    left_model: bool | None
    left_since: datetime | None
    verdict: str | None
    causes: tuple[Cause, ...]
    faults: tuple[Fault, ...]
    version: str
    simulated: bool
    problem: str | None


class Period(NamedTuple):
    """Days (UTC), both included; None: from the first, to the last recording."""

    first: date | None
    last: date | None

    def holds(self, at: date) -> bool:
        """Whether a day lies in it."""
        return (self.first is None or at >= self.first) and (self.last is None or at <= self.last)

    def __str__(self) -> str:
        if self.first is None and self.last is None:
            return "any time"
        return f"{self.first or 'the beginning'} to {self.last or 'now'}"


def read(archive: str, rig: str) -> list[Segment]:
    """All segments of a rig in an archive's catalogue, by axis and time.

    Raises:
        SheetError: There is no catalogue, or no such rig in it; says which there are.
    """
    from seod.archive.catalogue import rows  # noqa: PLC0415 - pyarrow
    from seod.archive.engines import ArchiveError  # noqa: PLC0415

    try:
        found = rows(archive, rig=rig).to_pylist()
        if not found:
            names = set(rows(archive).column("rig").to_pylist())
            raise SheetError(f"{archive}: no recording of rig {rig!r}: {suggest(rig, names, 'rigs')}")
    except ArchiveError as error:
        raise SheetError(str(error)) from error
    return segments(found)


def segments(rows: Iterable[Mapping[str, Any]]) -> list[Segment]:
    """Rows of the catalogue (dicts by column), by axis and time; such of unreadable files have no axis."""
    return sorted(
        (_segment(row) for row in rows if row["begin"] is not None),
        key=lambda each: (each.axis, each.begin, each.file),
    )


def _segment(row: Mapping[str, Any]) -> Segment:
    return Segment(
        file=row["file"],
        axis=row["axis"] or "",
        unit=row["unit"] or "unit",
        begin=row["begin"],
        end=row["end"] or row["begin"],
        seconds=row["seconds"] or 0.0,
        exciting_s=row["exciting_s"] or 0.0,
        lost=row["lost"] or 0,
        values=_values(row),
        K_L=row["K_L"],
        quality=row["quality"],
        e_a=row["e_a"],
        left_model=row["left_model"],
        left_since=row["left_since"],
        verdict=row["verdict"],
        causes=tuple(_cause(each) for each in json.loads(row["causes"] or "[]")),
        faults=tuple(
            Fault(str(f.get("t")), f.get("code") or "", f.get("why") or "")
            for f in json.loads(row["faults"] or "[]")
        ),
        version=row["version"] or "",
        simulated=bool(row["simulated"]),
        problem=row["problem"],
    )


def _values(row: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Those that were measured: a gain that was given has no standard deviation."""
    told = {name: (row[name], row[f"{name}_sd"]) for name in ("zeta", "omega_n", "K_L")}
    return {name: (value, sd) for name, (value, sd) in told.items() if value is not None and sd}


def _cause(told: Mapping[str, Any]) -> Cause:
    return Cause(told["name"], {name: _number(each) for name, each in told.get("parameters", {}).items()})


def _number(told: Any) -> Number:
    if not isinstance(told, dict):
        return Number(told, "", None)
    low, high = told.get("ci95") or (None, None)
    return Number(told["value"], told.get("unit", ""), None if low is None or high is None else (low, high))


def of_period(found: Sequence[Segment], period: Period) -> list[Segment]:
    """Segments that begin on a day of the period."""
    return [each for each in found if period.holds(each.begin.date())]
