"""The sheet for programs, and in short for a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from seod.sheet.words import allowed, causes, drift_of, headline, interval_of, value_of, with_interval
from seod.terminal import console

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.calibrate.value import Value
    from seod.sheet.sheet import AxisSheet, Departure, Diagnosed, Sheet
    from seod.sheet.terms import Term
    from seod.sheet.trend import Trend


def as_json(sheet: Sheet) -> dict[str, Any]:
    """All figures; see docs/report.md. Undefined is None; times are UTC, ISO 8601."""
    return {
        "rig": sheet.rig,
        "archive": sheet.archive,
        "begin": sheet.begin.isoformat(),
        "end": sheet.end.isoformat(),
        "versions": list(sheet.versions),
        "recordings": sheet.recordings,
        "simulated": sheet.simulated,
        "problems": [{"file": file, "why": why} for file, why in sheet.problems],
        "rig_file": sheet.rig_source or None,
        "made": sheet.made,
        "axes": {axis.name: _axis(axis) for axis in sheet.axes},
    }


def _axis(axis: AxisSheet) -> dict[str, Any]:
    calibration = axis.calibration
    return {
        "units": {"measured": axis.unit, "K_L": axis.gain_unit, "command": axis.command_unit},
        "hours": axis.hours._asdict(),
        "trends": {name: _trend(each) for name, each in axis.trends.items()},
        "terms": [_term(each) for each in axis.terms],
        "calibration": None
        if calibration is None
        else {
            "date": calibration.day,
            **{name: _value(each) for name, each in calibration.values.items()},
            **{name: {"interval": list(each)} for name, each in calibration.edges.items()},
            "supply_pressure": calibration.supply_pressure,
        },
        "monitored": axis.monitored,
        "left": [_departure(each) for each in axis.left],
        "diagnoses": [_diagnosis(each) for each in axis.diagnosed],
        "faults": [each._asdict() for each in axis.faults],
    }


def _value(value: Value | None) -> dict[str, Any] | None:
    return None if value is None else {"value": value.value, "sd": value.sd, "interval": list(value.interval)}


def _trend(trend: Trend) -> dict[str, Any]:
    reference = trend.reference
    return {
        "unit": trend.unit or "1",
        "reference": None
        if reference is None
        else {
            "first": reference.first.isoformat(),
            "last": reference.last.isoformat(),
            "estimates": reference.estimates,
            **(_value(reference.mean) or {}),
        },
        "days": [
            {"day": each.day.isoformat(), "estimates": each.estimates, "alarm": each.alarm}
            | (_value(each.mean) or {})
            for each in trend.days
        ],
        "drift": _value(trend.drift),
        "limit": None
        if trend.limit is None
        else [None if math.isinf(end) else end for end in (trend.limit.low, trend.limit.high)],
        "alarm": trend.alarm or None,
    }


def _term(term: Term) -> dict[str, Any]:
    return {
        "term": term.term,
        "value": term.value,
        "at_most": term.at_most,
        "unit": term.unit,
        "interval": None if term.interval is None else list(term.interval),
        "how": term.how,
        "source": term.source,
    }


def _departure(each: Departure) -> dict[str, Any]:
    return {
        "since": each.since.isoformat(),
        "last": each.last.isoformat(),
        "back": None if each.back is None else each.back.isoformat(),
        "files": list(each.files),
        "diagnosis": None if each.diagnosis is None else _diagnosis(each.diagnosis),
    }


def _diagnosis(each: Diagnosed) -> dict[str, Any]:
    return {
        "file": each.file,
        "day": each.day.isoformat(),
        "verdict": each.verdict,
        "causes": [
            {
                "name": cause.name,
                "parameters": {
                    name: {"value": n.value, "unit": n.unit, "ci95": n.interval and list(n.interval)}
                    for name, n in cause.parameters.items()
                },
            }
            for cause in each.causes
        ],
    }


def as_text(sheet: Sheet) -> str:
    """In short: trends, terms, what left the model, faults."""
    lines = [f"{sheet.rig}, {sheet.begin.date()} to {sheet.end.date()}: {sheet.recordings} recordings"]
    if sheet.simulated:
        lines.append(f"SIMULATED: {sheet.simulated} of them are of a simulated rig")
    lines.append(headline(sheet))
    for axis in sheet.axes:
        lines += ["", *_axis_text(axis)]
    return "\n".join(lines)


def _axis_text(axis: AxisSheet) -> list[str]:
    hours = axis.hours
    told = [f"{axis.name}: excited {hours.excited:.3f} h, {hours.excited_ever:.3f} h in the whole archive"]
    rows = [
        [name, with_interval(each.days[-1].mean), each.unit, drift_of(each), allowed(each)]
        for name, each in axis.trends.items()
        if each.days
    ]
    told.append(_table(["", "newest day (95 %)", "unit", "change (95 %)", "allowed"], rows))
    rows = [
        [each.term, value_of(each), each.unit, interval_of(each.interval), each.how if each.value else ""]
        for each in axis.terms
    ]
    told.append(_table(["ISO 10770-1", "value", "unit", "95 %", ""], rows))
    for each in axis.left:
        back = "" if each.back is None else f", back at {each.back.isoformat()}"
        told.append(f"left its model {each.since.isoformat()}{back}")
        told += [f"  {line}" for line in causes(each.diagnosis.causes if each.diagnosis else (), axis)]
    return told + [f"fault {each.t} {each.code}: {each.why}" for each in axis.faults]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    table = Table(*head, box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*row)
    return console.as_text(table, width=110).strip("\n")
