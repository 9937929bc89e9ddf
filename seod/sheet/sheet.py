"""The sheet: what is known of a rig over a period, gathered from the archive, the rig file and responses."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, NamedTuple

from seod import __version__
from seod.diagnose.report.units import Units
from seod.sheet.limits import QUANTITIES
from seod.sheet.segments import Period, SheetError, of_period
from seod.sheet.terms import Known, terms
from seod.sheet.trend import trend

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.sheet.limits import Limit
    from seod.sheet.response import Measured
    from seod.sheet.rig import Calibration, RigFacts
    from seod.sheet.segments import Cause, Fault, Segment
    from seod.sheet.terms import Term
    from seod.sheet.trend import Trend


class Hours(NamedTuple):
    """Of an axis [h]: recorded and excited in the period, excited in the whole archive; rows lost."""

    recorded: float
    excited: float
    excited_ever: float
    lost: int


class Departure(NamedTuple):
    """A rig that left its model: since when, until when it was seen so, and the diagnosis that says why.

    `back` is when a later recording showed the model to hold again; None: none has.
    """

    since: datetime
    last: datetime
    back: datetime | None
    files: tuple[str, ...]
    diagnosis: Diagnosed | None


class Diagnosed(NamedTuple):
    """A recording's diagnosis."""

    file: str
    day: date
    verdict: str
    causes: tuple[Cause, ...]


@dataclass(frozen=True, slots=True)
class AxisSheet:
    """All of one axis; `monitored` tells whether a model ran beside in any recording."""

    name: str
    unit: str
    gain_unit: str
    command_unit: str
    e_a: tuple[float, ...]
    hours: Hours
    trends: Mapping[str, Trend]
    calibration: Calibration | None
    monitored: bool
    left: tuple[Departure, ...]
    diagnosed: tuple[Diagnosed, ...]
    faults: tuple[Fault, ...]
    terms: tuple[Term, ...]

    @property
    def alarms(self) -> list[str]:
        """Sentences on quantities that are beyond their limits."""
        return [each.alarm for each in self.trends.values() if each.alarm]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A rig over a period.

    Attributes:
        rig: Its name.
        archive: Where the recordings are.
        period: As asked.
        begin, end: Of the first and the last recording in it (UTC).
        versions: Of the seod that recorded.
        recordings: How many.
        simulated: How many of them are of a simulated rig.
        problems: Of files that could not be read whole: name and why.
        rig_source: Where the rig file was found; "" if nowhere.
        axes: By name.
        made: The day, and by what.
    """

    rig: str
    archive: str
    period: Period
    begin: datetime
    end: datetime
    versions: tuple[str, ...]
    recordings: int
    simulated: int
    problems: tuple[tuple[str, str], ...]
    rig_source: str
    axes: tuple[AxisSheet, ...]
    made: str


class Asked(NamedTuple):
    """What a sheet is asked for; `reference` None: the first day with good estimates."""

    rig: str
    archive: str
    period: Period
    reference: Period | None
    limits: Sequence[Limit]


def made_of(
    asked: Asked, found: Sequence[Segment], rig: RigFacts | None, responses: Mapping[str, Sequence[Measured]]
) -> Sheet:
    """The sheet.

    Args:
        asked: Rig, period, limits.
        found: All segments of the rig, of any time.
        rig: What its rig file tells; None: there is none.
        responses: Frequency responses by axis.

    Raises:
        SheetError: Nothing was recorded in the period, or an option is of an axis that is not there.
    """
    within = of_period(found, asked.period)
    if not within:
        first, last = min(each.begin for each in found), max(each.begin for each in found)
        span = f"the archive has some from {first.date()} to {last.date()}"
        raise SheetError(f"{asked.rig}: no recordings from {asked.period}: {span}")
    names = sorted({each.axis for each in within})
    _check_axes(asked, names, responses)
    files = {each.file: each for each in within}
    return Sheet(
        rig=asked.rig,
        archive=asked.archive,
        period=asked.period,
        begin=min(each.begin for each in within),
        end=max(each.end for each in within),
        versions=tuple(sorted({each.version for each in within if each.version})),
        recordings=len(files),
        simulated=sum(each.simulated for each in files.values()),
        problems=tuple(sorted({(each.file, each.problem) for each in within if each.problem})),
        rig_source=rig.source if rig else "",
        axes=tuple(_axis(name, asked, found, rig, responses.get(name, ())) for name in names),
        made=f"{_today()} by seod {__version__}",
    )


def _today() -> date:
    """Today (UTC), or the day that reproducible builds give by SOURCE_DATE_EPOCH."""
    told = os.environ.get("SOURCE_DATE_EPOCH")
    return (datetime.fromtimestamp(int(told), UTC) if told and told.isdigit() else datetime.now(UTC)).date()


def _check_axes(asked: Asked, names: Sequence[str], responses: Mapping[str, Sequence[Measured]]) -> None:
    there = f"{asked.rig} has {', '.join(names)}"
    for limit in asked.limits:
        if limit.axis and limit.axis not in names:
            raise SheetError(f"--limit {limit.axis}.{limit.name}: no such axis in the period; {there}")
    for axis in responses:
        if axis not in names:
            raise SheetError(f"--response {axis}=...: no such axis in the period; {there}")


def _axis(
    name: str, asked: Asked, found: Sequence[Segment], rig: RigFacts | None, responses: Sequence[Measured]
) -> AxisSheet:
    known = [each for each in found if each.axis == name]
    within = of_period(known, asked.period)
    unit = within[-1].unit
    command = rig.commands.get(name, "V") if rig else "V"
    gain = f"{Units.of(unit, 'velocity' if unit.endswith('/s') else 'position').speed}/{command}"
    units = {"zeta": "", "omega_n": "rad/s", "K_L": gain}
    trends = {
        each: trend(each, units[each], known, asked.period, asked.reference, _limit(asked, name, each))
        for each in QUANTITIES
    }
    calibration = rig.calibrations.get(name) if rig else None
    diagnosed = [each for each in within if each.verdict]
    return AxisSheet(
        name=name,
        unit=unit,
        gain_unit=gain,
        command_unit=command,
        e_a=tuple(sorted({round(each.e_a, 6) for each in within if each.e_a})),
        hours=_hours(within, known),
        trends=trends,
        calibration=calibration,
        monitored=any(each.left_model is not None for each in within),
        left=tuple(departures(within)),
        diagnosed=tuple(_diagnoses(diagnosed)),
        faults=tuple(sorted({fault for each in within for fault in each.faults})),
        terms=tuple(
            terms(Known(gain, command, rig.source if rig else "", calibration, responses, trends, diagnosed))
        ),
    )


def _limit(asked: Asked, axis: str, name: str) -> Limit | None:
    """The last one that was given for this axis, or for all."""
    fit = [each for each in asked.limits if each.name == name and each.axis in ("", axis)]
    return fit[-1] if fit else None


def _hours(within: Sequence[Segment], known: Sequence[Segment]) -> Hours:
    return Hours(
        sum(each.seconds for each in within) / 3600.0,
        sum(each.exciting_s for each in within) / 3600.0,
        sum(each.exciting_s for each in known) / 3600.0,
        sum(each.lost for each in within),
    )


def departures(within: Sequence[Segment]) -> list[Departure]:
    """Runs of segments in which the model was left; such without a model beside them change nothing."""
    judged = [each for each in within if each.left_model is not None]
    found: list[Departure] = []
    run: list[Segment] = []
    for each in judged:
        if each.left_model:
            run.append(each)
        elif run:
            found.append(_departure(run, each.begin))
            run = []
    return [*found, _departure(run, None)] if run else found


def _departure(run: Sequence[Segment], back: datetime | None) -> Departure:
    diagnosed = _diagnoses([each for each in run if each.verdict])
    since = run[0].left_since or run[0].begin
    files = tuple(dict.fromkeys(each.file for each in run))
    return Departure(since, run[-1].end, back, files, diagnosed[-1] if diagnosed else None)


def _diagnoses(diagnosed: Sequence[Segment]) -> list[Diagnosed]:
    """One for each recording, oldest first."""
    by_file = {
        each.file: Diagnosed(each.file, each.begin.date(), each.verdict, each.causes)
        for each in diagnosed
        if each.verdict
    }
    return list(by_file.values())
