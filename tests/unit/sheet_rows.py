"""Rows of a catalogue, and the sheet that is made of them."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta

from seod.sheet.segments import Period, segments
from seod.sheet.sheet import Asked, made_of

NOON = datetime(2026, 11, 1, 12, tzinfo=UTC)
EVER = Period(None, None)
HYSTERESIS = json.dumps(
    [
        {
            "name": "valve_hysteresis",
            "parameters": {"half_width": {"value": 0.02, "unit": "V", "ci95": [0.019, 0.022]}},
        }
    ]
)


def row(day=0, hour=0, **changes):
    """A row of the catalogue."""
    begin = NOON + timedelta(days=day, hours=hour)
    told = {
        "file": f"day{day}-{hour}.mcap",
        "part": 1,
        "rig": "seat",
        "axis": "roll",
        "day": begin.date(),
        "begin": begin,
        "end": begin + timedelta(minutes=10),
        "seconds": 600.0,
        "rows": 600_000,
        "lost": 0,
        "reference": None,
        "supply_pressure": None,
        "temperature": None,
        "e_a": 0.5,
        "unit": "rad",
        "zeta": 0.21,
        "zeta_sd": 0.002,
        "omega_n": 117.0,
        "omega_n_sd": 0.5,
        "K_L": 17.0,
        "K_L_sd": None,
        "quality": "ok",
        "model_error": None,
        "left_model": None,
        "left_since": None,
        "verdict": None,
        "causes": None,
        "faults": None,
        "exciting_s": 540.0,
        "version": "0.2.0",
        "simulated": False,
        "problem": None,
    }
    assert changes.keys() <= told.keys()
    return told | changes


HYSTERESIS = json.dumps(
    [
        {
            "name": "valve_hysteresis",
            "parameters": {"half_width": {"value": 0.02, "unit": "V", "ci95": [0.019, 0.022]}},
        }
    ]
)


def sheet_of(rows, *, rig=None, responses=None, **asked):
    wanted = {"period": EVER, "reference": None, "limits": []} | asked
    return made_of(Asked("seat", "archive", **wanted), segments(rows), rig, responses or {})


def term(sheet, name, axis=0):
    found = [each for each in sheet.axes[axis].terms if each.term.startswith(name)]
    assert found, name
    return found


# -- frequency and step response -------------------------------------------------------------------
