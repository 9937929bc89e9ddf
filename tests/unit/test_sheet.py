"""`seod report`: its figures against formulae and simulations written apart, its rules, its page."""

from __future__ import annotations

import json
import math
import re
import sys
from datetime import UTC, date, datetime, timedelta

import numpy as np
import pytest
from scipy import signal
from test_cli import invoke

from seod.calibrate.value import Value, measured
from seod.cli import app
from seod.sheet import second_order, trend
from seod.sheet.limits import DRIFT, Limit, parse_limit
from seod.sheet.page import page
from seod.sheet.response import read_response
from seod.sheet.rig import of_file
from seod.sheet.segments import Period, SheetError, segments
from seod.sheet.sheet import Asked, departures, made_of
from seod.sheet.show import as_json, as_text
from seod.sheet.words import rounded

NOON = datetime(2026, 11, 1, 12, tzinfo=UTC)
EVER = Period(None, None)


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


@pytest.mark.parametrize("zeta", [0.02, 0.21, 0.45, 0.70, 0.9999999, 1.0, 1.3, 5.0])
def test_frequencies_are_those_of_the_transfer_function(zeta):
    omega = np.geomspace(1e-3, 1e3, 2_000_001)
    _, G = signal.freqs([1.0], [1.0, 2.0 * zeta, 1.0], omega)
    gain, phase = 20.0 * np.log10(np.abs(G)), np.degrees(np.unwrap(np.angle(G)))
    assert second_order.bandwidth(zeta) == pytest.approx(omega[np.argmax(gain < -3.0)], rel=2e-5)
    assert second_order.phase_90(zeta) == pytest.approx(omega[np.argmax(phase < -90.0)], rel=2e-5)


@pytest.mark.parametrize("zeta", [0.05, 0.21, 0.45, 0.69, 0.9, 1.0, 1.3, 5.0])
def test_step_figures_are_those_of_a_simulated_step(zeta):
    t = np.linspace(0.0, 120.0, 600_001)
    _, y = signal.step(([1.0], [1.0, 2.0 * zeta, 1.0]), T=t)
    rise = t[np.argmax(y >= 0.9)] - t[np.argmax(y >= 0.1)]
    outside = np.flatnonzero(np.abs(y - 1.0) > 0.05)
    assert second_order.rise_time(zeta) == pytest.approx(rise, abs=1e-3)
    assert second_order.overshoot(zeta) == pytest.approx(max(0.0, y.max() - 1.0), abs=1e-6)
    assert second_order.settling_time(zeta) == pytest.approx(t[outside[-1]], abs=1e-3)


@pytest.mark.parametrize(
    ("of", "power"),
    [(second_order.bandwidth, 1), (second_order.rise_time, -1), (second_order.settling_time, -1)],
)
def test_intervals_are_those_of_a_monte_carlo(of, power):
    # at zeta 0.21 the settling time jumps between half cycles within the interval
    zeta, omega = measured(0.21, 0.008, math.inf), measured(117.0, 1.2, math.inf)
    found = second_order.propagated(of, zeta, omega, power)
    rng = np.random.default_rng(1)
    drawn = (
        np.array([of(z) for z in rng.normal(0.21, 0.008, 20_000)]) * rng.normal(117.0, 1.2, 20_000) ** power
    )
    low, high = np.quantile(drawn, (0.025, 0.975))
    assert found.value == pytest.approx(of(0.21) * 117.0**power)
    wide = high - low
    assert found.interval == (pytest.approx(low, abs=0.03 * wide), pytest.approx(high, abs=0.03 * wide))


# -- trends ----------------------------------------------------------------------------------------


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


def test_what_was_not_measured_says_which_command_does_it():
    sheet = sheet_of([row(quality="noisy")])
    commands = {each.name or each.callback.__name__.rstrip("_") for each in app.registered_commands}
    terms = sheet.axes[0].terms
    assert len({each.term for each in terms}) == 9
    for each in terms:
        assert each.value is None
        assert each.how == "not measured"
        assert re.search(r"seod (\w+)", each.source)[1] in commands


def test_hysteresis_is_twice_the_half_width_of_the_newest_diagnosis_that_names_it():
    rows = [row(0, verdict="effects", causes=HYSTERESIS), row(1, verdict="clean", causes="[]")]
    (found,) = term(sheet_of(rows), "hysteresis")
    assert found.value == pytest.approx(0.04)
    assert found.interval == pytest.approx((0.038, 0.044))
    assert "day0-0.mcap (2026-11-01)" in found.source
    (none,) = term(sheet_of(rows[1:]), "hysteresis")
    assert none.value is None
    assert "no diagnosis names it, the newest of day1-0.mcap" in none.source


CALIBRATION = """
    calibration:
      date: 2026-10-30
      K_L: {value: 17.1, sd: 0.01, interval: [17.08, 17.12]}
      K_L_up: {value: 17.2, sd: 0.01, interval: [17.18, 17.22]}
      null: {value: 0.02, sd: 1.0e-5, interval: [0.01998, 0.02002]}
      deadband_up: {interval: [0.0202, 0.0205]}
      deadband_down: {interval: [0.0195, 0.0198]}
      delay: {value: 0.0, sd: 1.0e-5, interval: [-2.0e-5, 2.0e-5]}
"""


def calibrated(folder, name="seat"):
    """A rig file with a calibration."""
    from seod.files.shipped import configs_dir

    text = (configs_dir() / "virtual.yaml").read_text().replace("rig: virtual-motor", f"rig: {name}")
    assert "\nguard:\n" in text
    path = folder / "rig.yaml"
    path.write_text(text.replace("\nguard:\n", f"{CALIBRATION.rstrip()}\n\nguard:\n", 1))
    return path


def test_a_calibration_gives_flow_gain_null_bias_and_a_bound_of_the_threshold(tmp_path):
    rig = of_file(calibrated(tmp_path), "seat")
    sheet = sheet_of([row(axis="motor")], rig=rig)
    mean, up = term(sheet, "flow gain")
    assert (mean.value, mean.interval, mean.unit) == (17.1, (17.08, 17.12), "rad/s/V")
    assert up.value == 17.2
    (null,) = term(sheet, "null bias")
    assert null.value == 0.02
    assert "2026-10-30" in null.source
    (threshold,) = term(sheet, "threshold")
    assert threshold.at_most
    assert threshold.value == pytest.approx(0.0205 - 0.0195)
    assert threshold.interval == pytest.approx((0.0202 - 0.0198, 0.0205 - 0.0195))
    with pytest.raises(SheetError, match="of 'seat', not of 'other'"):
        of_file(tmp_path / "rig.yaml", "other")


def response_file(path, *, output="position", band=(0.5, 60.0), noise=0.0):
    """What `seod response --json` prints, of a plant of K_L 17, omega_n 117, zeta 0.21."""
    omega = math.tau * np.geomspace(*band, 160)
    G = 17.0 / (1.0 - (omega / 117.0) ** 2 + 0.42j * omega / 117.0)
    if output == "position":
        G = G / (1j * omega)
    sd = np.abs(G) * 0.01
    rng = np.random.default_rng(3)
    G = G + noise * sd * (rng.normal(size=len(G)) + 1j * rng.normal(size=len(G)))
    points = [
        {"omega": w, "real": g.real, "imag": g.imag, "sd": s}
        for w, g, s in zip(omega.tolist(), G.tolist(), sd.tolist(), strict=True)
    ]
    known = {"K_L": 17.0, "omega_n": 117.0, "zeta": 0.21, "delay": 0.0}
    fit = {name: {"value": value, "sd": 0.01 * value} for name, value in known.items()}
    path.write_text(json.dumps({"output": output, "quality": "ok", "points": points, "fit": fit}))
    return path


@pytest.mark.parametrize("output", ["position", "velocity"])
def test_a_measured_response_gives_minus_3_db_and_minus_90_deg(output, tmp_path):
    found = read_response(response_file(tmp_path / "bode.json", output=output))
    assert found.minus_90_deg().value == pytest.approx(117.0 / math.tau, rel=1e-3)
    omega = np.geomspace(100.0, 300.0, 1_000_001)  # by search, against the gain at low frequency
    gain = np.abs(1.0 / (1.0 - (omega / 117.0) ** 2 + 0.42j * omega / 117.0))
    by_search = omega[np.argmax(20.0 * np.log10(gain) < -3.0)] / math.tau
    assert found.minus_3_db().value == pytest.approx(by_search, rel=3e-3)
    assert found.gain.value == pytest.approx(17.0, rel=5e-3)


def test_intervals_of_a_noisy_response_hold_the_truth(tmp_path, monkeypatch):
    hits = 0
    for seed in range(100):
        monkeypatch.setattr(
            np.random, "default_rng", lambda _, s=seed: np.random.Generator(np.random.PCG64(s))
        )
        low, high = read_response(response_file(tmp_path / "b.json", noise=1.0)).minus_90_deg().interval
        hits += low <= 117.0 / math.tau <= high
    assert hits >= 85  # where points fall through -90 deg twice, the first counts


def test_beyond_the_band_it_is_not_measured_but_calculated(tmp_path):
    narrow = read_response(response_file(tmp_path / "bode.json", band=(0.5, 10.0)))
    sheet = sheet_of([row()], responses={"roll": [narrow]})
    none, calculated = term(sheet, "frequency response, -3 dB")
    assert none.how == "not measured"
    assert "not reached between 0.5 and 10 Hz" in none.source
    assert calculated.how == "calculated"
    assert calculated.value == pytest.approx(second_order.bandwidth(0.21) * 117.0 / math.tau)
    assert "zeta and omega_n of 2026-11-01" in calculated.source


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"output": "position", "points": [], "fit": {}}', "\xff"])
def test_a_file_that_is_no_response_says_so(text, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(SheetError, match=r"x.json: is no answer of `seod response --json`"):
        read_response(path)
    with pytest.raises(SheetError, match="is a folder"):
        read_response(tmp_path)


# -- findings --------------------------------------------------------------------------------------


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


def rich():
    """A sheet in which all is wrong."""
    fault = json.dumps([{"t": "2026-11-02T12:00:01+00:00", "code": "travel", "why": "<b>1 > 0</b> & so"}])
    rows = [row(day, omega_n=117.0 - 4.0 * day, simulated=True) for day in range(4)]
    since = NOON + timedelta(days=4)
    worst = {"left_model": True, "left_since": since, "verdict": "effects", "causes": HYSTERESIS}
    return sheet_of([*rows, row(4, **worst, faults=fault, K_L_sd=0.1, file="a<b>.mcap", simulated=True)])


def test_the_page_is_one_file_without_scripts_and_says_what_is_simulated():
    told = page(rich())
    assert "SIMULATED. All recordings are of a simulated rig" in told
    assert "alarmed before" in told
    assert "&lt;b&gt;1 &gt; 0&lt;/b&gt; &amp; so" in told
    assert "<b>.mcap" not in told
    assert "spool lags behind where the command turns" in told
    assert not re.search(r"<script|<link|<img|javascript:|url\((?!#)|\bsrc=|href=\"(?!#)", told)
    assert not re.findall(r"(?:href|src)=\"https?:", told)
    assert "prefers-color-scheme: dark" in told
    assert "@media print" in told
    assert "SIMULATED" not in page(sheet_of([row()]))


def test_the_same_inputs_give_the_same_bytes(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1800000000")
    first = page(rich())
    assert "2027-01-15 by seod" in first
    assert page(rich()) == first


@pytest.mark.slow
def test_a_pdf_has_the_same_bytes_and_the_text_of_the_page(monkeypatch):
    pytest.importorskip("weasyprint")
    from seod.sheet.files import pdf

    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1800000000")
    made = pdf(page(rich()))
    assert made.startswith(b"%PDF-")
    assert pdf(page(rich())) == made


def test_without_weasyprint_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    code, _, err = invoke("report", "seat", "--archive", tmp_path, "--out", tmp_path / "s.pdf")
    assert code == 1
    assert "pip install 'seod[pdf]'" in err
    assert "--out FILE.html" in err


def test_json_has_every_figure_and_nothing_that_is_none():
    told = json.loads(json.dumps(as_json(rich()), allow_nan=False))
    axis = told["axes"]["roll"]
    assert axis["trends"]["omega_n"]["days"][-1]["value"] == pytest.approx(117.0)
    assert axis["trends"]["omega_n"]["alarm"]
    assert axis["left"][0]["diagnosis"]["causes"][0]["parameters"]["half_width"]["ci95"] == [0.019, 0.022]
    assert {each["how"] for each in axis["terms"]} == {"measured", "calculated", "not measured"}
    assert "SIMULATED: 5 of them" in as_text(rich())


def test_numbers_have_the_digits_that_their_interval_leaves():
    assert rounded(11.3456, 0.12) == "11.35"
    assert rounded(1234.5, 30.0) == "1234"
    assert rounded(0.0, 0.0) == "0"
    assert Value(1.0, 0.1, (0.8, 1.2)).interval == (0.8, 1.2)


# -- the command -----------------------------------------------------------------------------------


@pytest.fixture
def archive(tmp_path):
    """A catalogue of two rigs, written apart."""
    pq = pytest.importorskip("pyarrow.parquet")
    from seod.archive.layout import table_of

    folder = tmp_path / "archive" / "catalogue" / "day=2026-11-01"
    folder.mkdir(parents=True)
    table = table_of([row(), row(0, 1, rig="tail", axis="rudder")])
    pq.write_table(table.drop_columns(["day"]), folder / "a.parquet")
    return tmp_path / "archive"


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("saet",), "no recording of rig 'saet': did you mean 'seat'? known rigs: seat, tail"),
        (("seat", "--since", "2027-01-01"), "no recordings from 2027-01-01 to now"),
        (("seat", "--since", "yesterday"), "--since yesterday: is no day; one is written as 2026-11-01"),
        (("seat", "--since", "2026-11-02", "--until", "2026-11-01"), "is before --since"),
        (("seat", "--out", "s.txt"), "must end in .html or .pdf"),
        (("seat", "--out", "nowhere/s.html"), "there is no folder nowhere"),
        (("seat", "--limit", "mass=1:2"), "'mass' is none of zeta, omega_n, K_L"),
        (("seat", "--response", "none.json"), "none.json: No such file"),
        (("seat", "--response", "pitch=none.json"), "none.json: No such file"),
        (("seat", "--reference", "2026-11-02:2026-11-01"), "its last day is before its first"),
    ],
)
def test_what_cannot_be_done_says_why(words, why, archive):
    code, out, err = invoke("report", *words, "--archive", archive)
    assert (code, out) == (1, "")
    assert why in err


def test_a_page_is_written_all_at_once_and_an_old_one_stays_if_nothing_comes(archive, tmp_path):
    out = tmp_path / "s.html"
    code, told, _ = invoke("report", "seat", "--archive", archive, "--out", out)
    assert (code, told) == (0, f"{out}: 1 recordings of seat\n")
    first = out.read_text()
    assert first.startswith("<!doctype html>")
    assert invoke("report", "seat", "--archive", archive, "--since", "2027-01-01", "--out", out)[0] == 1
    assert out.read_text() == first
    assert [each.name for each in tmp_path.iterdir() if each.name.startswith(".")] == []
