"""`seod simulate`: the command as it is typed, for every shipped rig; units, truth, files and refusals."""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
import subprocess
import sys
from statistics import fmean

import numpy as np
import pytest
from relay_truth import settings

from seod.cli import app
from seod.config.load import load_rig, load_text
from seod.estimate import make_estimator
from seod.estimate.base import Row
from seod.files.shipped import configs_dir
from seod.simulate.options import EXCITATIONS
from seod.simulate.view import AxisView
from tests.command_line import CliRunner

LINEAR_RIGS = sorted(p for p in configs_dir().glob("*.yaml") if "hydraulic" not in p.stem)
"""Those whose limit cycle is that of small movements at any amplitude; test_hydraulics has the others."""
VIRTUAL = configs_dir() / "virtual.yaml"
COMPILING = "compiling the kernel (once)\n"
PROGRESS = re.compile(r"simulating, \d+ %\n")
"""Told where a run takes long, as on a machine that compiles for the first time."""


@pytest.fixture(scope="module", autouse=True)
def _compiled(tmp_path_factory):
    """Whatever is compiled for the first time is compiled here."""
    simulate(VIRTUAL, tmp_path_factory.mktemp("first") / "out.csv", "--duration", 0.01)


def simulate(config, out, *words):
    """The summary of a run in this process."""
    result = CliRunner().invoke(app, [str(word) for word in ("simulate", config, "--out", out, *words)])
    assert (result.exit_code, PROGRESS.sub("", result.stderr.replace(COMPILING, ""))) == (0, "")
    return json.loads(result.stdout)


def refusal(config, out, *words):
    result = CliRunner().invoke(app, [str(word) for word in ("simulate", config, "--out", out, *words)])
    assert result.exit_code == 1
    assert result.stdout == ""
    assert not out.exists()
    return result.stderr.replace(COMPILING, "")


def read(path):
    opened = gzip.open if path.name.endswith(".gz") else open
    with opened(path, "rt") as file:
        header, *rows = csv.reader(file)
    columns = zip(*[[float(cell) if cell else np.nan for cell in row] for row in rows], strict=True)
    names = [name.partition(" [")[0] for name in header]
    return dict(zip(names, map(np.asarray, columns), strict=True))


def edited(tmp_path, *changes, source=VIRTUAL):
    text = source.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / source.name
    path.write_text(text)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("path", LINEAR_RIGS, ids=lambda path: path.stem)
def test_each_shipped_rig_tells_its_truth(path, tmp_path):
    """Recordings of all axes, identified by the estimator."""
    config = load_rig(path)
    for name, axis in config.axes.items():
        out = tmp_path / f"{name}.csv"
        told = simulate(path, out, "--axis", name, "--duration", 2, "--noise", 0)
        data, truth = read(out), told["truth"]
        assert list(data)[:4] == ["t", "u", "y", "t_u"]
        assert told["rows"] == len(data["t"]) == 2 * config.loop.rate_hz
        assert told["output"] == axis.mode
        signal, bias = data["y"] - data["y"][0], axis.relay.bias
        if axis.mode == "velocity":  # the relay sees the integral of the error
            assert set(data["ps"]) == {8.0e6}
            error = data["y"] - axis.reference
            steps = 0.5 * (error[1:] + error[:-1]) * np.diff(data["t"])
            signal, bias = np.r_[0.0, np.cumsum(steps)], axis.reference / truth["K_L"]
        assert truth["small_signal"]["K_L"] == pytest.approx(truth["K_L"])
        known = {
            "K_L": truth["K_L"],
            "hysteresis": axis.relay.hysteresis,
            "period_s": 1.0 / config.loop.rate_hz,
        }
        estimator = make_estimator(settings(**known))
        rows = [
            Row(t, y, u, t_u, 0.0, axis.relay.e_a, bias, exciting=True, fresh=True)
            for t, y, u, t_u in zip(
                *(c.tolist() for c in (data["t"], signal, data["u"], data["t_u"])), strict=True
            )
            if t > 0.5
        ]
        good = [e for row in rows if (e := estimator.update(row)) and e.quality == "ok"]
        assert len(good) > 10
        assert fmean(e.omega_n for e in good) == pytest.approx(truth["omega_n"], rel=0.005)
        assert fmean(e.zeta for e in good) == pytest.approx(truth["zeta"], rel=0.02)


@pytest.mark.parametrize("kind", [kind for kind in EXCITATIONS if kind != "file"])
def test_each_excitation(kind, tmp_path):
    out = tmp_path / "out.csv.gz"
    told = simulate(VIRTUAL, out, "--excitation", kind, "--amplitude", 0.25, "--bias", 0.05, "--duration", 2)
    data = read(out)
    assert told["excitation"] == kind
    assert len(data["t"]) == told["rows"] == 4000
    assert 0.15 < np.abs(data["u"] - 0.05).max() <= 0.25 + 1e-12
    assert np.ptp(data["y"]) > 0.01


def test_the_same_seed_makes_the_same_bytes(tmp_path):
    def one(name, seed):
        out = tmp_path / name
        effects = (
            "--effect",
            "outliers.rate=0.01",
            "--effect",
            "outliers.size=0.1",
            "--effect",
            "missing_samples.rate=0.1",
            "--effect",
            "timing_jitter.deviation=1e-5",
        )
        words = ("--excitation", "multisine", "--duration", 1, "--seed", seed, *effects)
        return simulate(VIRTUAL, out, *words), out.read_bytes()

    told, packed = one("a.csv.gz", 7)
    assert one("b.csv.gz", 7)[1] == packed
    assert one("c.csv.gz", 8)[1] != packed
    assert packed[4:8] == bytes(4)  # the time in gzip's header
    assert gzip.decompress(packed) == one("d.csv", 7)[1]
    assert told["seed"] == 7
    assert told["missing"] == sum(
        not row["y [rad]"] for row in csv.DictReader(io.StringIO(gzip.decompress(packed).decode()))
    )
    assert told["missing"] > 100


def test_effects_from_the_command_line_join_those_of_the_file(tmp_path):
    told = simulate(
        VIRTUAL,
        tmp_path / "out.csv",
        "--duration",
        1,
        "--effect",
        "asymmetric_gain.ratio=0.2",
        "--effect",
        "transport_delay.time=0.003",
    )
    assert told["truth"]["effects"] == {
        "sensor_quantization": {"step": 1e-6},
        "asymmetric_gain": {"ratio": 0.2},
        "transport_delay": {"time": 0.003},
    }
    assert told["truth"]["K_L"] == 17.0
    assert told["truth"]["small_signal"]["K_L"] == pytest.approx(17.0 * 1.2)
    assert told["truth"]["small_signal"]["delay"] == 0.003


def test_what_has_no_small_signals_says_so(tmp_path):
    out = tmp_path / "out.csv"
    words = ("--duration", 1, "--effect", "valve_saturation.limit=1e-5", "--effect", "null_shift.voltage=1")
    small = simulate(VIRTUAL, out, *words)["truth"]["small_signal"]
    assert small["K_L"] in {0.0, None}


@pytest.mark.slow
def test_numbers_are_si_of_the_axis_whatever_the_channels_carry(tmp_path):
    """The same plant, with its channel in degrees and its amplifier in inverted millivolts."""
    scaled = edited(
        tmp_path,
        (
            "channel: encoder\n    unit: rad",
            "channel: encoder\n    unit: deg\n    scale: -0.1\n    offset: 2",
        ),
        (
            "channel: amplifier\n    unit: V",
            "channel: amplifier\n    unit: mV\n    scale: -2.0e-3\n    offset: 0.1",
        ),
        ("K_L: 17                   #", "K_L: 4870.141                   #"),
        ("noise: 1.0e-3", "noise: 0"),
        ("sensor_quantization: {step: 1.0e-6}", "null_shift: {voltage: 0.1}"),
        ("stops: [-1.5, 1.5]", "stops: [-1500, 1500]"),
    )
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    words = ("--excitation", "steps", "--duration", 1, "--noise", 0)
    simulate(VIRTUAL, plain, *words, "--effect", "sensor_quantization.step=0")
    told = simulate(scaled, other, *words)
    assert told["truth"]["K_L"] == pytest.approx(17.0, rel=1e-6)
    assert told["truth"]["small_signal"]["K_L"] == pytest.approx(17.0, rel=1e-6)
    one, two = read(plain), read(other)
    np.testing.assert_allclose(two["u"], one["u"], atol=1e-12)
    np.testing.assert_allclose(two["y"] - two["y"][0], one["y"] - one["y"][0], atol=2e-6)
    assert two["y"][0] == pytest.approx(np.deg2rad(2.0))
    relays = [
        read(path)
        for path, config in ((plain, VIRTUAL), (other, scaled))
        if simulate(config, path, "--duration", 2, "--noise", 0)
    ]
    for data in relays:
        assert np.abs(data["u"][-2000:]) == pytest.approx(0.5)
    periods = [np.diff(data["t"][np.flatnonzero(np.diff(data["u"]) > 0.9)])[4:].mean() for data in relays]
    assert periods[0] == pytest.approx(periods[1], rel=1e-3)


def test_no_count_of_an_encoder_is_lost_on_its_way():
    view = AxisView(load_rig(configs_dir() / "seat-virtual.yaml"), "roll")
    counts = np.arange(-20_000, 20_000)
    found = view.readings(counts / 63661.977)
    np.testing.assert_allclose(np.diff(found), 2.0 * np.pi / 400_000, rtol=1e-6)
    assert np.isnan(view.readings(np.array([0.0, np.nan, 0.001]))).tolist() == [False, True, False]


def test_a_relay_that_would_run_away_is_refused(tmp_path):
    turned = edited(
        tmp_path, ("channel: amplifier\n    unit: V", "channel: amplifier\n    unit: V\n    scale: -1")
    )
    told = refusal(turned, tmp_path / "out.csv")
    assert "turn the sign of the sensor's or the output's scale" in told
    simulate(turned, tmp_path / "out.csv", "--excitation", "sine", "--duration", 1)


def test_a_command_from_a_file_with_its_pressure(tmp_path):
    servo = edited(
        tmp_path,
        (
            "      noise: 0.2 ",
            "      supply_pressure: pressure\n      nominal_pressure: 8.0e6\n"
            "      effects: {square_root_flow: {supply: 1.0e9}}\n      noise: 0.2 ",
        ),
        source=configs_dir() / "servo-virtual.yaml",
    )
    given_, out = tmp_path / "in.csv", tmp_path / "out.csv"
    t = np.arange(3000) * 1e-3
    ps = np.where(t < 1.5, 8e6, 2e6)
    given_.write_text("t,u,ps\n" + "".join(f"{a},{1.0},{b}\n" for a, b in zip(t, ps, strict=True)))
    told = simulate(servo, out, "--excitation", "file", "--input", given_, "--noise", 0)
    data = read(out)
    np.testing.assert_array_equal(data["ps"], ps)
    assert told["duration"] == pytest.approx(2.999)
    assert data["y"][[1400, 2900]] == pytest.approx([17.434, 17.434 / 2.0], rel=1e-3)
    out.unlink()
    plain = configs_dir() / "servo-virtual.yaml"
    assert "the plant follows none" in refusal(plain, out, "--excitation", "file", "--input", given_)


def test_a_recording_that_was_there_is_kept(tmp_path):
    out = tmp_path / "out.csv"
    out.write_text("precious")
    simulate(VIRTUAL, out, "--duration", 0.1)
    assert (tmp_path / "out.csv~").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "out.csv~"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ("--effect", "valve_lagg.time=1"),
            "no effect 'valve_lagg'; there are transport_delay, valve_saturation,",
        ),
        (("--effect", "valve_lag.tim=1"), "valve_lag has no parameter 'tim'; it has valve_lag.time"),
        (("--effect", "valve_lag.time"), "valve_lag.time: give a number, such as valve_lag.time=1"),
        (("--effect", "valve_lag.time=500"), "must be within [0, 100] s"),
        (("--effect", "lugre_friction.stiffness=1e5"), "lugre_friction needs coulomb_friction.level > 0"),
        (("--excitation", "noise"), "--excitation noise: there are relay, two-phase, sine"),
        (
            ("--excitation", "sine", "--band", "1:2"),
            "--band belongs to --excitation sweep or linear-sweep or",
        ),
        (("--excitation", "file"), "needs --input FILE, a CSV file with columns t and u"),
        (
            ("--excitation", "file", "--input", "/nowhere/in.csv"),
            "/nowhere/in.csv: No such file or directory",
        ),
        (
            ("--excitation", "sweep", "--band", "2"),
            "--band 2: give two rising numbers above 0, such as 0.5:60",
        ),
        (
            ("--excitation", "sine", "--frequency", "1000"),
            "1000 Hz must lie below half the loop's rate, 1000 Hz",
        ),
        (("--duration", "0"), "0 ticks at 2000 Hz"),
        (("--axis", "rudder"), "no axis 'rudder'; there are motor"),
    ],
)
def test_refusals_are_sentences_that_say_what_would_be_right(words, says, tmp_path):
    assert says in refusal(VIRTUAL, tmp_path / "out.csv", *words)


def test_where_the_recording_goes_is_checked_first(tmp_path):
    assert "must end in .csv or .csv.gz" in refusal(VIRTUAL, tmp_path / "out.txt")
    assert "there is no directory" in refusal(VIRTUAL, tmp_path / "no" / "out.csv")
    seat = configs_dir() / "seat-virtual.yaml"
    assert "has the axes pitch, roll: choose one by --axis" in refusal(seat, tmp_path / "out.csv")


@pytest.mark.slow
def test_it_runs_as_a_process_of_its_own(tmp_path):
    out = tmp_path / "out.csv"
    words = [
        sys.executable,
        "-m",
        "seod.cli",
        "simulate",
        str(VIRTUAL),
        "--out",
        str(out),
        "--duration",
        "0.5",
    ]
    ran = subprocess.run(words, capture_output=True, text=True, check=True)
    assert PROGRESS.sub("", ran.stderr.replace(COMPILING, "")) == ""
    assert json.loads(ran.stdout)["rows"] == 1000
    assert out.read_text().startswith("t,u,y [rad],t_u\n0.0,")


def test_compilation_is_told_where_the_cache_is_cold(tmp_path, monkeypatch):
    from sim import cache

    assert cache.are_compiled("runs.sampled_relay")  # this module's fixture has seen to it
    folder = tmp_path / "cold"
    folder.mkdir()
    monkeypatch.setattr(cache, "cache_folder", lambda: folder)
    assert not cache.are_compiled("runs.sampled_relay")
    words = ["simulate", str(VIRTUAL), "--out", str(tmp_path / "out.csv"), "--duration", "0.1"]
    assert CliRunner().invoke(app, words).stderr == COMPILING


def test_a_real_rig_has_nothing_to_simulate(tmp_path):
    real = tmp_path / "real.yaml"
    can = (configs_dir() / "can.yaml").read_text().partition("\n# What `seod rig` simulates")[0]
    real.write_text(can)
    (tmp_path / "motor.dbc").write_text((configs_dir() / "motor.dbc").read_text())
    assert load_text(can, "real.yaml", tmp_path).simulation is None
    assert "has no `simulation:` section" in refusal(real, tmp_path / "out.csv")
