"""The sheet as one page."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from seod.plots.page import facts, table, whole
from seod.sheet.limits import DIAGNOSES, DRIFT, FAULTS, QUANTITIES
from seod.sheet.pictures import trends
from seod.sheet.words import (
    SCOPE,
    allowed,
    causes,
    drift_of,
    headline,
    interval_of,
    is_fine,
    value_of,
    verdict,
    with_interval,
)
from seod.terminal.text import number

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime

    from seod.sheet.sheet import AxisSheet, Departure, Diagnosed, Sheet
    from seod.sheet.terms import Term

UNITS = {"K_L": "gain", "K_L_up": "gain", "K_L_down": "gain", "null": "command", "delay": "s"}
NAMES = {
    "K_L": "K_L",
    "K_L_up": "K_L towards larger readings",
    "K_L_down": "K_L towards smaller readings",
    "null": "null",
    "delay": "loop delay",
    "deadband_up": "edge towards larger readings",
    "deadband_down": "edge towards smaller readings",
}


def page(sheet: Sheet) -> str:
    """The page: HTML, one file, no scripts."""
    title = f"{sheet.rig}: sheet of {sheet.begin.date()} to {sheet.end.date()}"
    return whole(title, "".join(_sections(sheet)))


def _sections(sheet: Sheet) -> Iterator[str]:
    span = f"{sheet.begin.date()} to {sheet.end.date()}"
    yield f"<h1>Rig {escape(sheet.rig)}</h1><div class='sub'>State of the servo actuators, {span}</div>"
    if sheet.simulated:
        yield f'<div class="simulated">{escape(_simulated(sheet))}</div>'
    yield f'<div class="verdict {"clean" if is_fine(sheet) else "alarm"}">{escape(headline(sheet))}</div>'
    yield facts(list(_head(sheet)))
    for axis in sheet.axes:
        yield f"<h2>Axis {escape(axis.name)}</h2>"
        yield from _axis(axis)
    yield f"<h2>How to read this sheet</h2><p class='sub'>{escape(_rules())}</p>"


def _simulated(sheet: Sheet) -> str:
    which = "All" if sheet.simulated == sheet.recordings else f"{sheet.simulated} of {sheet.recordings}"
    return f"SIMULATED. {which} recordings are of a simulated rig: these figures are of no machine."


def _head(sheet: Sheet) -> Iterator[tuple[str, str]]:
    yield "rig", sheet.rig
    yield "axes", ", ".join(axis.name for axis in sheet.axes)
    yield "period asked for", str(sheet.period)
    yield "first, last row", f"{_moment(sheet.begin)}, {_moment(sheet.end)}"
    yield "recordings", f"{sheet.recordings} in {sheet.archive}"
    yield "recorded by", f"seod {', '.join(sheet.versions) or 'of unknown version'}"
    yield "rig file", sheet.rig_source or "none: give --config"
    yield "made", sheet.made
    for file, why in sheet.problems:
        yield "not read whole", f"{file}: {why}"


def _moment(t: datetime) -> str:
    return t.strftime("%Y-%m-%d %H:%M UTC")


def _axis(axis: AxisSheet) -> Iterator[str]:
    yield f"<h3>Trends</h3>{trends(axis.trends) or '<p>No estimate of quality ok in the period.</p>'}"
    yield _trends(axis)
    yield f"<h3>Quantities of ISO 10770-1</h3><p class='sub'>{escape(SCOPE)}</p>{_terms(axis)}"
    yield f"<h3>Operating hours</h3>{_hours(axis)}"
    yield f"<h3>Calibration</h3>{_calibration(axis)}"
    yield f"<h3>What left the model, since when, and why</h3>{_left(axis)}"
    yield f"<h3>Faults</h3>{_faults(axis)}"


def _trends(axis: AxisSheet) -> str:
    rows = []
    for name in QUANTITIES:
        each = axis.trends[name]
        if not each.days or each.reference is None:
            continue
        first, last = each.reference, each.days[-1]
        span = f"{first.first}" if first.first == first.last else f"{first.first} to {first.last}"
        title = f"{name} [{each.unit}]" if each.unit else name
        rows.append(
            [
                escape(title),
                f"{with_interval(first.mean)}<br><small>{span}, {first.estimates} estimates</small>",
                f"{with_interval(last.mean)}<br><small>{last.day}, {last.estimates} estimates</small>",
                drift_of(each),
                escape(allowed(each)),
                "<b>ALARM</b>" if last.alarm else "alarmed before" if each.alarm else "within",
            ]
        )
    if not rows:
        return ""
    alarms = "".join(f"<li><b>{escape(each)}.</b></li>" for each in axis.alarms)
    head = ["", "reference (95 %)", "newest day (95 %)", "change (95 %)", "allowed", ""]
    return table(head, rows, "trend") + (f"<ul>{alarms}</ul>" if alarms else "")


def _terms(axis: AxisSheet) -> str:
    rows = [_term(each) for each in axis.terms]
    return table(["quantity", "value", "95 %", "source"], rows, "terms")


def _term(each: Term) -> list[str]:
    value = (
        f'<span class="nowrap">{value_of(each)} {escape(each.unit if each.value is not None else "")}</span>'
    )
    how = f"<b>{each.how}</b>: " if each.value is not None else ""
    return [escape(each.term), value, interval_of(each.interval), f"{how}{escape(each.source)}"]


def _hours(axis: AxisSheet) -> str:
    hours = axis.hours
    return facts(
        [
            ("excited in the period", f"{hours.excited:.3f} h"),
            ("excited in the whole archive", f"{hours.excited_ever:.3f} h"),
            ("recorded in the period", f"{hours.recorded:.3f} h"),
            ("rows lost", str(hours.lost)),
            ("amplitudes e_a", ", ".join(f"{number(each)} {axis.command_unit}" for each in axis.e_a) or "-"),
        ]
    )


def _calibration(axis: AxisSheet) -> str:
    found = axis.calibration
    if found is None:
        return "<p>None in the rig file: <code>seod calibrate RIG.yaml</code> measures and writes one.</p>"
    units = {"gain": axis.gain_unit, "command": axis.command_unit}
    rows = []
    for name, value in found.values.items():
        unit = units.get(UNITS[name], UNITS[name])
        rows.append([NAMES[name], with_interval(value), escape(unit)])
    for name, (low, high) in found.edges.items():
        rows.append([NAMES[name], f"between {number(low)} and {number(high)}", escape(axis.command_unit)])
    if found.supply_pressure is not None:
        rows.append(["supply pressure", number(found.supply_pressure), "Pa"])
    return f"<p>Of {found.day}.</p>{table(['', 'value (95 %)', 'unit'], rows)}"


def _left(axis: AxisSheet) -> str:
    if not axis.monitored:
        why = "The daemon compares a rig with the plant in <code>simulation:</code> of its rig file."
        told = f"<p>No model ran beside. {why}</p>"
    elif not axis.left:
        told = "<p>The rig kept to its model in all recordings that a model ran beside.</p>"
    else:
        head = ["since", "until", "recordings", "why"]
        told = table(head, [_departure(each, axis) for each in reversed(axis.left)], "wrapped")
    if not axis.diagnosed:
        return told
    shown = axis.diagnosed[: -DIAGNOSES - 1 : -1]
    rows = [[str(each.day), escape(each.file), _found(each, axis)] for each in shown]
    return f"{told}<p class='lead'>{_most('Diagnoses', len(rows), len(axis.diagnosed))}</p>" + table(
        ["day", "recording", "what it found"], rows, "wrapped"
    )


def _departure(each: Departure, axis: AxisSheet) -> list[str]:
    until = f"{_moment(each.back)}, when it held again" if each.back else f"{_moment(each.last)}, still so"
    files = f"{escape(each.files[0])}" + (f" and {len(each.files) - 1} more" if len(each.files) > 1 else "")
    why = _why(each.diagnosis, axis) if each.diagnosis else escape(verdict(None, each.files[-1]))
    return [_moment(each.since), until, files, why]


def _why(each: Diagnosed, axis: AxisSheet) -> str:
    told = [verdict(each, each.file), *causes(each.causes, axis)]
    return "<br>".join(escape(line) for line in told)


def _found(each: Diagnosed, axis: AxisSheet) -> str:
    """Verdict and figures alone: what causes mean is said where the model was left."""
    told = [each.verdict, *causes(each.causes, axis, meanings=not axis.left)]
    return "<br>".join(escape(line) for line in told)


def _faults(axis: AxisSheet) -> str:
    if not axis.faults:
        return "<p>None.</p>"
    rows = [
        [f'<span class="nowrap">{escape(_seconds(each.t))}</span>', escape(each.code), escape(each.why)]
        for each in axis.faults[: -FAULTS - 1 : -1]
    ]
    head = ["when (UTC)", "code", "why"]
    return f"<p class='lead'>{_most('Faults', len(rows), len(axis.faults))}</p>{table(head, rows, 'wrapped')}"


def _seconds(t: str) -> str:
    """`2026-11-01 08:00:09` of a time in ISO 8601."""
    return t[:19].replace("T", " ")


def _most(what: str, shown: int, count: int) -> str:
    return f"{what}: {count}." if shown == count else f"{what}: {count}, of which the newest {shown}."


def _rules() -> str:
    drifts = ", ".join(f"{name} {100.0 * most:g} %" for name, most in DRIFT.items())
    return (
        "Only estimates of quality ok count. A day's mean allows for estimates that differ by more than "
        "their standard deviations tell. The reference is the first day with good estimates unless told "
        "otherwise. An alarm is a change whose whole 95 % interval lies beyond what is tolerated "
        f"({drifts}), or a value whose whole interval lies beyond a limit that was given. Nothing is taken "
        "from a data sheet: what was not measured says so, and what would measure it."
    )
