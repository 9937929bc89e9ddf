"""The daemon's estimators on recordings, whose relay runs on an ODE's or a matrix exponential's plant."""

import json

import numpy as np
import pytest
from relay_truth import E_A, K_L, Loop, amplitude_of, rows

from seod.cli import app
from tests.command_line import CliRunner

LOOP = Loop(zeta=0.45, omega_n=145.0, noise=0.005, load=0.02)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A logger's file: times, voltage, position, and when the voltage left."""
    path = tmp_path_factory.mktemp("relay") / "relay.csv"
    run = rows(LOOP, 1.5)
    table = np.array([(row.t, row.u, row.y, row.t_u) for row in run])
    np.savetxt(path, table, delimiter=",", header="t,u,y,t_u", comments="")
    return path


def answer(*arguments):
    done = CliRunner().invoke(app, ["identify", *map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "within"), [("wave", 0.003), ("exact", 0.01), ("peaks", 0.06)])
def test_each_method_finds_the_plant_in_a_logger_s_file(file, method, within):
    found = answer(file, "--method", method, "--gain", K_L, "--delay", 0)
    assert found["quality"] == "ok"
    assert found["method"] == method
    assert found["omega_n"]["value"] == pytest.approx(LOOP.omega_n, rel=within)
    assert found["zeta"]["value"] == pytest.approx(LOOP.zeta, rel=within)
    assert found["K_L"] == {"value": K_L, "sd": 0.0, "unit": "unit/s/V"}
    assert found["answers"]["ok"] > 10


@pytest.mark.slow
def test_wave_s_deviations_are_those_of_windows_that_share_no_sample(file):
    found = answer(file, "--method", "wave", "--gain", K_L, "--delay", 0)
    whole = answer(file, "--gain", K_L, "--delay", 0)
    assert 0.8 < found["zeta"]["sd"] / whole["zeta"]["sd"] < 2.0
    assert abs(found["zeta"]["value"] - LOOP.zeta) < 4.0 * found["zeta"]["sd"]


def test_a_method_that_needs_the_gain_asks_for_it(file):
    done = CliRunner().invoke(app, ["identify", str(file), "--method", "exact"])
    assert done.exit_code == 1
    assert "exact needs K_L: give it by --gain or by a rig file" in done.output


def test_a_voltage_that_is_no_relay_s_is_refused(tmp_path):
    t = np.arange(400) * 1e-3
    table = np.stack([t, np.sin(90.0 * t), np.cos(90.0 * t)], axis=1)
    np.savetxt(tmp_path / "sine.csv", table, delimiter=",", header="t,u,y", comments="")
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "sine.csv"), "--method", "wave"])
    assert done.exit_code == 1
    assert "u is no relay's" in done.output


def test_the_daemon_s_own_columns_part_a_recording_by_amplitude(tmp_path):
    """What comes before the relay is left out; each amplitude is a limit cycle of its own."""
    run = rows(Loop(zeta=0.8, omega_n=60.0), 1.0)
    amplitude = amplitude_of(0.8, 60.0)
    lines = ["t,y,u,t_u,reference,e_a,bias,K_L,flags"]
    lines += [
        f"{49.5 + 5e-4 * k!r},{-0.1 * amplitude!r},0.0,{49.5005 + 5e-4 * k!r},0,0,0,17,2" for k in range(999)
    ]
    lines += [f"{r.t!r},{r.y!r},{r.u!r},{r.t_u!r},0,{E_A},0,17,3" for r in run]
    path = tmp_path / "daemon.csv"
    path.write_text("\n".join(lines) + "\n")
    found = answer(path, "--method", "wave", "--delay", 0, "--gain", K_L)
    assert found["quality"] == "ok"
    assert found["zeta"]["value"] == pytest.approx(0.8, rel=0.002)


def test_a_relay_that_never_switches_gets_a_word(tmp_path):
    t = np.arange(3000) * 1e-3
    u = np.where(t < 0.5, 0.5, -0.5)
    table = np.stack([t, u, np.cumsum(u)], axis=1)
    np.savetxt(tmp_path / "x.csv", table, delimiter=",", header="t,u,y", comments="")
    found = answer(tmp_path / "x.csv", "--method", "wave", "--gain", 1)
    assert found["quality"] == "no_oscillation"
    assert found["zeta"] == {"value": None, "sd": None, "unit": "1"}
    assert "no answer to be believed" in found["message"]


def test_an_empty_recording_gets_a_word_not_a_number(tmp_path):
    (tmp_path / "x.csv").write_text("t,u,y\n" + "".join(f"{k},1,\n" for k in range(50)))
    found = answer(tmp_path / "x.csv")
    assert found["quality"] == "stale"
    assert found["omega_n"] == {"value": None, "sd": None, "unit": "rad/s"}
    assert "x.csv: has no sample of y" in found["message"]
