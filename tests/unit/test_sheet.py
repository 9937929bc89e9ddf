"""`seod report`: trends and their alarms, what left the model, hours and faults."""

from __future__ import annotations

import json
import math
import re
from datetime import date, timedelta

import numpy as np
import pytest
from sheet_rows import HYSTERESIS, NOON, row, sheet_of

from seod.calibrate.value import measured
from seod.sheet import trend
from seod.sheet.limits import DRIFT, Limit, parse_limit
from seod.sheet.segments import Period, SheetError, segments
from seod.sheet.sheet import departures


@pytest.mark.parametrize("between", [0.0, 0.01])
def test_the_mean_of_estimates_has_a_true_interval(between):
    rng = np.random.default_rng(2)
    within = 0
    for _ in range(2000):
        sds = rng.uniform(0.002, 0.006, 5)
        values = 0.21 + between * rng.normal(size=5) + sds * rng.normal(size=5)
        low, high = trend.pooled(values, sds).interval
        within += low <= 0.21 <= high
    assert 0.93 <= within / 2000 <= 0.98


def test_a_drift_alarms_when_its_whole_interval_is_beyond_what_is_tolerated():
    reference = trend.Reference(date(2026, 11, 1), date(2026, 11, 1), measured(100.0, 0.1, math.inf), 5)
    limit = DRIFT["omega_n"]

    def alarms(value, sd):
        return trend.beyond(measured(value, sd, math.inf), "omega_n", reference, None)

    edge = 100.0 * (1.0 - limit)
    assert not alarms(edge, 0.1)
    assert alarms(edge - 0.4, 0.1)
    assert not alarms(edge - 0.4, 0.5)  # the same value, known less well
    assert alarms(100.0 * (1.0 + limit) + 0.5, 0.1)


def test_a_limit_takes_the_place_of_the_drift():
    rows = [row(day, omega_n=117.0 * (0.9 if day else 1.0)) for day in range(3)]
    assert "moved by up to -10 %" in sheet_of(rows).axes[0].trends["omega_n"].alarm
    loose, tight = Limit("", "omega_n", 100.0, math.inf), Limit("roll", "omega_n", 110.0, math.inf)
    assert sheet_of(rows, limits=[loose]).axes[0].trends["omega_n"].alarm == ""
    alarm = sheet_of(rows, limits=[loose, tight]).axes[0].trends["omega_n"].alarm
    assert "outside 110 to inf" in alarm
    assert "2 of 3 days, first 2026-11-02, last 2026-11-03" in alarm


def test_only_good_estimates_of_the_period_count_and_the_reference_may_be_earlier():
    rows = [row(0), row(1, omega_n=150.0, quality="noisy"), row(2, omega_n=90.0), row(3, omega_n=90.0)]
    first, last = date(2026, 11, 3), date(2026, 11, 4)
    within = sheet_of(rows, period=Period(first, None)).axes[0].trends["omega_n"]
    assert [each.day for each in within.days] == [first, last]
    assert within.alarm == ""
    assert within.reference.first == first
    before = Period(date(2026, 11, 1), date(2026, 11, 2))
    told = sheet_of(rows, period=Period(first, None), reference=before).axes[0].trends["omega_n"]
    assert told.reference.mean.value == pytest.approx(117.0)
    assert told.drift.value == pytest.approx(90.0 / 117.0 - 1.0)
    assert told.alarm


def test_a_gain_that_was_given_is_no_measurement():
    assert not sheet_of([row()]).axes[0].trends["K_L"].days
    assert sheet_of([row(K_L_sd=0.1)]).axes[0].trends["K_L"].days


@pytest.mark.parametrize("text", ["zeta", "zeta=0.1", "zeta=3:1", "mass=1:2", "zeta=a:b", "=1:2"])
def test_a_limit_that_is_none_says_so(text):
    with pytest.raises(ValueError, match=re.escape(f"--limit {text}")):
        parse_limit(text)


def test_limits_have_open_ends_and_axes():
    assert parse_limit("zeta=0.1:0.3") == Limit("", "zeta", 0.1, 0.3)
    assert parse_limit("roll.K_L=:20") == Limit("roll", "K_L", -math.inf, 20.0)


# -- terms of the standard -------------------------------------------------------------------------


def test_departures_are_runs_of_recordings_that_left_the_model():
    left = {"left_model": True, "left_since": NOON + timedelta(days=1, minutes=3)}
    rows = [
        row(0, left_model=False),
        row(1, **left, verdict="effects", causes=HYSTERESIS),
        row(2),  # no model ran beside
        row(3, left_model=True),
        row(4, left_model=False),
        row(5, left_model=True),
    ]
    first, second = departures(segments(rows))
    assert first.since == left["left_since"]
    assert first.back == NOON + timedelta(days=4)
    assert first.files == ("day1-0.mcap", "day3-0.mcap")
    assert first.diagnosis.causes[0].name == "valve_hysteresis"
    assert (second.back, second.diagnosis) == (None, None)


def test_hours_faults_and_recordings_are_counted():
    fault = json.dumps([{"t": "2026-11-02T12:00:01+00:00", "code": "travel", "why": "too far"}])
    rows = [row(0), row(1, faults=fault), row(1, 1, axis="pitch"), row(1, part=2, lost=7, problem="torn")]
    sheet = sheet_of(rows, period=Period(date(2026, 11, 2), None))
    pitch, roll = sheet.axes
    assert sheet.recordings == 2
    assert roll.hours.excited == pytest.approx(2 * 540.0 / 3600.0)
    assert roll.hours.excited_ever == pytest.approx(3 * 540.0 / 3600.0)
    assert roll.hours.lost == 7
    assert [each.code for each in roll.faults] == ["travel"]
    assert not pitch.faults
    assert sheet.problems == (("day1-0.mcap", "torn"),)


def test_a_period_without_recordings_says_so():
    with pytest.raises(
        SheetError, match=r"no recordings from 2027-01-01 to now: .* from 2026-11-01 to 2026-11-01"
    ):
        sheet_of([row()], period=Period(date(2027, 1, 1), None))
    with pytest.raises(SheetError, match=r"--limit pitch.zeta: no such axis in the period; seat has roll"):
        sheet_of([row()], limits=[Limit("pitch", "zeta", 0.0, 1.0)])


# -- page ------------------------------------------------------------------------------------------
