"""Questions to the catalogue: SQL that can do no harm, the ready ones, and the forms of answers."""

from __future__ import annotations

import csv
import json
from datetime import timedelta

import pytest
from archive_recordings import BEGAN, estimate, fault, fill, model_error, recording, report
from pyarrow import parquet
from test_cli import invoke

from seod.archive import questions
from seod.archive.build import build
from seod.archive.engines import ArchiveError
from seod.archive.sql import ask


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("archive")
    fill(folder, weeks=4)
    (folder / "rig1/1.diagnosis.json").write_text(report())
    for week, left in enumerate((False, True, False, True, False)):  # it came back each time
        notes = [estimate(0.5, zeta=0.3), model_error(0.5, left)]
        path = folder / f"back/{week}.mcap"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(recording("back", notes=notes, began=BEGAN + timedelta(weeks=week)))
    (folder / "torn.mcap").write_bytes(recording("torn", notes=[fault(0.5)], finished=False))
    build(folder)
    return folder


def test_a_question_in_sql_is_answered(folder):
    found = ask(
        folder, 'SELECT rig, count(*) AS n, max("end") AS last FROM segments GROUP BY rig ORDER BY rig'
    )
    assert found["rig"].to_pylist() == ["back", "rig0", "rig1", "rig2", "rig3", "torn"]
    assert found["n"].to_pylist()[1] == 12
    assert found["last"].to_pylist()[1] == BEGAN + timedelta(weeks=3, seconds=1)
    assert ask(folder, "SELECT $a AS b", {"a": "it's"})["b"].to_pylist() == ["it's"]


@pytest.mark.parametrize(
    "sql",
    [
        "COPY segments TO '{0}/x.csv'",
        "COPY (SELECT 1) TO '{0}/x.parquet'",
        "SELECT * FROM read_text('{0}/torn.mcap')",
        "SELECT * FROM '{0}/catalogue/**/*.parquet'",
        "SELECT * FROM glob('{0}/*')",
        "ATTACH '{0}/x.db'",
        "EXPORT DATABASE '{0}/x'",
        "INSTALL httpfs",
        "LOAD '{0}/x.duckdb_extension'",
        "SET enable_external_access = true",
        "SET allowed_directories = ['{0}']",
        "RESET enable_external_access",
    ],
)
def test_a_question_reads_and_writes_nothing_else(folder, sql):
    before = sorted(folder.rglob("*"))
    with pytest.raises(ArchiveError):
        ask(folder, sql.format(folder))
    assert sorted(folder.rglob("*")) == before


def test_what_a_question_makes_ends_with_it(folder):
    assert len(ask(folder, "CREATE TABLE mine AS SELECT 1 AS a; SELECT * FROM mine")) == 1
    with pytest.raises(ArchiveError, match="mine"):
        ask(folder, "SELECT * FROM mine")


def test_wrong_sql_is_told_with_its_place(folder):
    code, out, err = invoke("archive", "query", folder, "SELECT nope FROM segments")
    assert (code, out) == (1, "")
    assert "nope" in err
    assert "LINE 1: SELECT nope FROM segments" in err
    assert "^" in err


def test_rigs_that_left_their_model_and_no_other(folder):
    (row,) = questions.left_model(folder, None, None).to_pylist()
    assert (row["rig"], row["segments"]) == ("rig1", 3)
    assert row["since"] == BEGAN + timedelta(weeks=1, seconds=0.7)
    assert row["why"] == "coulomb_friction (level 520 N m)"
    assert row["model error [%]"] == pytest.approx(15.0)
    assert len(questions.left_model(folder, "back", None)) == 0
    assert len(questions.left_model(folder, None, BEGAN + timedelta(weeks=5))) == 0


def test_a_trend_is_a_line_with_its_sd(folder):
    found = {row["rig"]: row for row in questions.trend(folder, "omega_n", None, None).to_pylist()}
    assert found["rig0"]["change in 100 days [rad/s]"] == pytest.approx(-100.0 / 7.0)
    assert found["rig0"]["segments"] == 4
    assert found["rig0"]["significant"]
    assert found["back"]["change in 100 days [rad/s]"] == pytest.approx(0.0, abs=1e-9)
    only = questions.trend(folder, "zeta", "back", BEGAN + timedelta(weeks=1)).to_pylist()
    assert [(row["rig"], row["segments"], row["zeta"]) for row in only] == [("back", 4, pytest.approx(0.3))]


def test_causes_are_counted_by_rig(folder):
    (row,) = questions.causes(folder, None, None).to_pylist()
    assert (row["cause"], row["rigs"], row["recordings"]) == ("coulomb_friction", 1, 1)
    assert (row["last rig"], row["its parameters"]) == ("rig1", "level 520 N m")


def test_two_rigs_side_by_side(folder):
    found = {row["quantity"]: row for row in questions.compare(folder, "rig0", "back", None).to_pylist()}
    assert list(found)[:3] == ["zeta", "omega_n [rad/s]", "K_L [SI/V]"]
    assert found["zeta"]["difference"] == pytest.approx(0.1)
    assert found["omega_n [rad/s]"]["rig0"] == pytest.approx(98.5)
    assert found["omega_n [rad/s]"]["in its sd"] == pytest.approx(1.5 / (1.2909944 / 2.0))
    with pytest.raises(ArchiveError, match="no recording of rig 'nobody'"):
        questions.compare(folder, "rig0", "nobody", None)
    same = questions.compare(folder, "rig0", "rig0", None)
    assert same.num_columns == 10


def test_answers_in_other_forms_hold_the_same(folder, tmp_path):
    sql = 'SELECT rig, omega_n, left_model, "begin", problem FROM segments ORDER BY rig, "begin"'
    table = ask(folder, sql)
    for form in ("csv", "json", "html", "parquet"):
        code, out, _ = invoke("archive", "query", folder, sql, "--out", tmp_path / f"a.{form}")
        assert (code, out) == (0, f"{tmp_path / f'a.{form}'}: {len(table)} rows\n")
    rows = json.loads((tmp_path / "a.json").read_text())
    assert [row["omega_n"] for row in rows] == table["omega_n"].to_pylist()
    assert rows[0]["begin"] == "2026-03-01T12:00:00+00:00"
    with (tmp_path / "a.csv").open(newline="") as file:
        assert [row["rig"] for row in csv.DictReader(file)] == table["rig"].to_pylist()
    assert parquet.read_table(tmp_path / "a.parquet").equals(table)
    page = (tmp_path / "a.html").read_text()
    assert page.count("<tr>") == len(table) + 1
    assert "<script" not in page
    assert list(tmp_path.glob("*.unfinished")) == []


def test_a_page_shows_names_and_no_markup_of_theirs(tmp_path):
    (tmp_path / "a.mcap").write_bytes(recording("<b>x</b>"))
    build(tmp_path)
    code, out, _ = invoke("archive", "query", tmp_path, "SELECT rig FROM segments", "--to", "html")
    assert code == 0
    assert "&lt;b&gt;x" in out
    assert "<b>" not in out


@pytest.mark.slow
def test_the_commands_answer(folder, tmp_path):
    code, out, err = invoke("archive", folder)
    assert (code, out, err) == (0, f"{folder}: 22 recordings, 0 read now\n", "")
    code, out, _ = invoke("archive", "left-model", folder)
    assert code == 0
    assert "rig1" in out
    assert out.endswith("1 row\n")
    for command in (["trend", folder], ["compare", folder, "rig0", "back"]):
        for ending in ("svg", "png"):
            plot = tmp_path / f"{command[0]}.{ending}"
            assert invoke("archive", *command, "--plot", plot)[0] == 0
            assert plot.stat().st_size > 1000
    assert "coulomb_friction" in invoke("archive", "causes", folder, "--to", "csv")[1]


def test_a_torn_recording_is_told_at_the_end_with_status_3(folder, tmp_path):
    (tmp_path / "torn.mcap").write_bytes((folder / "torn.mcap").read_bytes())
    code, out, err = invoke("archive", "build", tmp_path)
    assert (code, out) == (3, f"{tmp_path}: 1 recordings, 1 read now\n")
    assert err.startswith("! torn.mcap: the file was not closed")


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["build", "/nowhere/at/all"], "there is no such folder"),
        (["query", "FOLDER", "SELECT 1", "--to", "parquet"], "--to parquet needs --out"),
        (["query", "FOLDER", "SELECT 1", "--out", "a.txt"], "say by --to in which form"),
        (["trend", "FOLDER", "--since", "yesterday"], "is no time such as"),
        (["trend", "FOLDER", "--plot", "a.bmp"], "ends in"),
    ],
)
def test_what_cannot_be_is_told(folder, command, told):
    code, _, err = invoke("archive", *[folder if word == "FOLDER" else word for word in command])
    assert code == 1
    assert told in err
