"""`seod report` as a page and as a command."""

from __future__ import annotations

import json
import re
import sys
from datetime import timedelta

import pytest
from sheet_rows import HYSTERESIS, NOON, row, sheet_of
from test_cli import invoke

from seod.calibrate.value import Value
from seod.sheet.page import page
from seod.sheet.show import as_json, as_text
from seod.sheet.words import rounded


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
