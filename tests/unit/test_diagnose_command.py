"""`seod diagnose` as it is typed: what is printed, written and refused. The search is stood in for."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis_example import K_L, LEVEL, command, example, simulate
from hypothesis import given
from hypothesis import strategies as st

import seod.diagnose.command as command_module
from seod.api.data import pair as rising
from seod.cli import app
from seod.config.load import load_rig
from seod.data import read
from seod.diagnose.command import Options, command_line, output_of, unit_of
from seod.diagnose.result import DiagnoseError
from seod.diagnose.verdict.bootstrap import with_intervals
from seod.files.shipped import configs_dir
from tests.command_line import CliRunner

VIRTUAL = configs_dir() / "virtual.yaml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "run.csv"
    u = command(600)
    t, y, _, _ = simulate(u, {})
    np.savetxt(path, np.c_[t, u, y], delimiter=",", header="t,u,y [rad]", comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def answer():
    return example()


@pytest.fixture
def asked(monkeypatch, answer):
    """What the search was asked for."""
    calls = []

    def diagnose(recordings, holdout, options, progress):
        progress("looking", 0.5)
        calls.append((recordings, holdout, options))
        return answer

    monkeypatch.setattr(command_module, "diagnose", diagnose)
    return calls


def typed(*words):
    return CliRunner().invoke(app, ["diagnose", *(str(word) for word in words)])


def test_a_table_and_sentences(asked, recording):
    result = typed(recording)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("The baseline misses coulomb_friction")
    assert "level" in result.stdout
    ((recordings, holdout, options),) = asked
    assert (len(recordings), len(holdout), options.output, options.usual) == (1, 0, None, "position")


def test_times_without_a_unit_are_doubted_where_the_plant_is_slow(monkeypatch, recording, answer):
    slow = replace(answer, extended=replace(answer.extended, omega_n=0.06))
    monkeypatch.setattr(command_module, "diagnose", lambda *_: slow)
    assert "60 rad/s: `--units t=ms` says so" in " ".join(typed(recording).stdout.split())
    assert "t=ms" not in typed(recording, "--units", "t=s").stdout


@pytest.mark.slow
def test_json_is_the_contract_and_nothing_else(asked, recording, tmp_path, answer):
    out = tmp_path / "found"
    result = typed(recording, "--json", "--out", out, "--holdout", recording)
    told = json.loads(result.stdout)
    assert told == with_intervals(answer).as_json() | {
        "units": {"y": "rad", "K_L": "rad/s/V", "omega_n": "rad/s", "zeta": "1"}
    }
    assert json.loads((out / "diagnosis.json").read_text()) == told
    low, high = told["baseline"]["holdout_ci95"]
    assert 0.0 < low < told["baseline"]["holdout_nrmse"] < high
    assert told["effects"][0]["share"] == pytest.approx(1.0, abs=0.01)
    assert len(asked[0][1]) == 1


@pytest.mark.slow
def test_the_folder_holds_report_and_a_rig_that_loads(asked, recording, tmp_path):
    out = tmp_path / "deep" / "found"
    result = typed(recording, "--out", out)
    assert f"{out / 'extended.yaml'}: the extended rig, for `seod run` (port 7610)" in result.stdout
    assert sorted(path.name for path in out.iterdir()) == [
        "diagnosis.json",
        "extended-can.yaml",
        "extended.dbc",
        "extended.yaml",
        "report.html",
    ]
    for name in ("extended.yaml", "extended-can.yaml"):
        plant = load_rig(out / name).simulation.plants["plant"]
        assert plant.K_L == K_L
        assert plant.effects["coulomb_friction"] == {"level": LEVEL}


@pytest.mark.slow
def test_with_a_rig_file_its_own_text_is_extended(asked, recording, tmp_path):
    typed(recording, "--out", tmp_path, "--config", VIRTUAL)
    text = (tmp_path / "extended.yaml").read_text()
    assert "# The truth of the simulated rig" in text
    assert load_rig(tmp_path / "extended.yaml").simulation.plants["motor"].omega_n == 60.0
    assert asked[0][2].config.rig == "virtual-motor"
    assert not (tmp_path / "extended-can.yaml").exists()


@pytest.mark.slow
def test_a_rig_on_a_bus_gets_its_dbc_beside_it(asked, recording, tmp_path):
    result = typed(recording, "--out", tmp_path, "--config", configs_dir() / "can.yaml")
    assert (result.exit_code, "no extended rig" in result.stdout) == (0, False)
    config = load_rig(tmp_path / "extended.yaml")
    assert config.driver["dbc"] == str(tmp_path / "motor.dbc")
    assert config.simulation.plants["motor"].effects["coulomb_friction"] == {"level": LEVEL}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{data}", "--config", VIRTUAL, "--axis", "roll"], "no axis 'roll'"),
        (["{data}", "--config", configs_dir() / "seat-virtual.yaml"], "pitch, roll: choose one by --axis"),
        (["{data}.gone"], "run.csv.gone"),
        (["{data}", "--out", "{data}"], "File exists"),
    ],
)
def test_refusals_name_the_place(asked, recording, words, said):
    result = typed(*(str(word).replace("{data}", str(recording)) for word in words))
    assert result.exit_code == 1
    assert said in result.stderr
    assert result.stdout == ""
    assert asked == []


@pytest.mark.parametrize("text", ["", "3", "2:1", "1:1", "a:b", "1:2:3", "nan:4", "0:nan"])
def test_a_part_that_is_none_is_refused(asked, recording, text):
    result = typed(recording, "--between", text)
    assert (result.exit_code, asked) == (1, [])
    assert f"--between {text}: give two rising numbers" in result.stderr


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_any_two_rising_numbers_are_a_part(low, width):
    assert rising(f"{low!r}:{low + width!r}", "--between") == (low, low + width)


def test_only_the_part_that_is_asked_for(asked, recording):
    typed(recording, "--between", "0.1:0.3")
    t = asked[0][0][0].t
    assert 0.1 <= t[0] < t[-1] <= 0.3
    result = typed(recording, "--between", "90:99")
    assert result.exit_code == 1
    assert "run.csv" in result.stderr


def test_a_recording_that_tells_nothing_is_no_traceback(monkeypatch, recording):
    def diagnose(*_):
        raise DiagnoseError("run.csv: the command u never changes")

    monkeypatch.setattr(command_module, "diagnose", diagnose)
    result = typed(recording)
    assert (result.exit_code, result.stderr) == (1, "seod: run.csv: the command u never changes\n")


def test_the_unit_is_the_files_then_that_of_the_rigs_sensor(recording):
    bare = replace(read(recording), units={"y": ""})
    for name, axis, unit in (
        ("virtual", None, "rad"),
        ("servo-virtual", None, "rad/s"),
        ("seat-virtual", "pitch", "rad"),  # a scale in m, which a linkage makes an angle of
    ):
        config = load_rig(configs_dir() / f"{name}.yaml")
        own = config.axes[axis or next(iter(config.axes))]
        assert unit_of(bare, own.mode, config, axis) == unit
    assert unit_of(bare, "velocity", None, None) == "unit/s"
    assert unit_of(read(recording), "position", None, None) == "rad"


def test_what_the_reader_left_out_is_told(asked, monkeypatch, recording, tmp_path):
    lines = recording.read_text().splitlines()
    twice = tmp_path / "twice.csv"
    twice.write_text("\n".join([*lines[:300], lines[250], *lines[300:]]))
    assert "row 301: column 't': goes back in time" in typed(twice).stdout
    backwards = tmp_path / "backwards.csv"
    backwards.write_text("\n".join([lines[0], *reversed(lines[1:])]))

    def diagnose(recordings, *_):
        raise DiagnoseError(f"has {len(recordings[0].t)} samples")

    monkeypatch.setattr(command_module, "diagnose", diagnose)
    said = typed(backwards).stderr
    assert "has 1 samples; " in said
    assert "goes back in time" in said


def test_what_y_is_comes_from_its_unit_then_from_the_rig(recording):
    servo = load_rig(configs_dir() / "servo-virtual.yaml")
    assert output_of(read(recording), servo, None) == "position"
    assert output_of(read(recording, units="y=rpm"), None, None) == "velocity"
    bare = replace(read(recording), units={"y": ""})
    assert output_of(bare, None, None) == "position"
    assert output_of(bare, servo, "motor") == "velocity"


def test_the_command_is_told_as_it_can_be_typed_again():
    told = command_line([Path("a b.csv"), Path("c.csv")], Options())
    assert told == "seod diagnose 'a b.csv' c.csv"
    asked = Options(
        holdout=[Path("later.csv")],
        out=Path("found"),
        output="velocity",
        units="y=mm",
        between=(2.0, math.inf),
        effort="quick",
        gain=0.05,
        relevance=0.03,
    )
    assert command_line([Path("c.csv")], asked) == (
        "seod diagnose c.csv --holdout later.csv --out found --output velocity --gain 0.05 --units y=mm "
        "--between 2: --effort quick --relevance 3"
    )
