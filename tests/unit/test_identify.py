"""Identification from recordings: truth by scipy's state space, not by the closed form under test."""

import gzip
import io
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.signal import cont2discrete, lfilter, lsim, lti

from seod.cli import app
from seod.identify import IdentifyError, Record, UntoldError, identify
from seod.identify.fit import at
from tests.command_line import CliRunner

OMEGA_N, ZETA, K_L, DELAY = 60.0, 0.4, 12.0, 0.003
HOLDS = ("zero", "first")
CHIRP = Path(__file__).parents[2] / "../shared/data/servohydraulic_chirp.csv.gz"


def simulated(seed: int, noise: float, output: str = "position", n: int = 1500, fine: int = 4):
    """Random steps through a discretised state space whose ticks are a quarter of the samples'."""
    rng = np.random.default_rng(seed)
    tick = 0.002
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 10), 10)
    shift = round(DELAY / (tick / fine))
    driven = np.concatenate([np.zeros(shift), np.repeat(u, fine)])[: n * fine]
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N]])
    b = np.array([[0.0], [0.0], [K_L * OMEGA_N**2]])
    phi, gamma, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 1))), tick / fine)
    state, states = np.array([0.3, 0.0, 0.0]), []
    for each in driven:
        states.append(state)
        state = phi @ state + gamma[:, 0] * each
    y = np.array(states)[::fine, 1 if output == "velocity" else 0]
    y = y + noise * np.std(y) * rng.standard_normal(n)
    return np.arange(n) * tick, u, y


def record(*args, output="position", **kwargs):
    t, u, y = simulated(*args, output=output, **kwargs)
    return Record("made", t, u, y, output=output)


@pytest.mark.parametrize("output", ["position", "velocity"])
def test_all_four_are_found_without_noise(output):
    found = identify([record(1, 0.0, output=output)])
    assert found.fit.value == pytest.approx(
        {"omega_n": OMEGA_N, "zeta": ZETA, "delay": DELAY, "K_L": K_L}, rel=1e-4
    )
    assert found.quality == "ok"


@pytest.mark.slow
def test_the_intervals_hold_the_truth():
    truth = np.array([OMEGA_N, ZETA, DELAY, K_L])
    scores = []
    for seed in range(12):
        fit = identify([record(seed, 0.02, n=600)]).fit
        scores.append(
            (np.array([fit.value[k] for k in ("omega_n", "zeta", "delay", "K_L")]) - truth)
            / [fit.sd[k] for k in ("omega_n", "zeta", "delay", "K_L")]
        )
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


@pytest.mark.slow
def test_the_intervals_hold_the_truth_in_coloured_noise():
    scores = []
    for seed in range(10):
        t, u, y = simulated(seed, 0.0, n=600)
        noise = lfilter([1.0], [1.0, -0.8], np.random.default_rng(100 + seed).standard_normal(700))[100:]
        fit = identify([Record("made", t, u, y + 0.02 * np.std(y) * noise)]).fit
        truth = {"omega_n": OMEGA_N, "zeta": ZETA, "delay": DELAY, "K_L": K_L}
        scores += [(fit.value[name] - truth[name]) / fit.sd[name] for name in truth]
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.3


def test_several_recordings_count_by_their_own_noise():
    good, bad = record(1, 0.01, n=600), record(2, 0.3, n=600)
    both, alone = identify([good, bad]).fit, identify([good]).fit
    assert both.sd["zeta"] < alone.sd["zeta"] * 1.02
    assert both.noise[1] > 5.0 * both.noise[0]
    assert abs(both.value["zeta"] - ZETA) < 4.0 * both.sd["zeta"]


def test_recordings_of_two_plants_are_told(monkeypatch):
    first = record(1, 0.02, n=600)
    monkeypatch.setitem(globals(), "ZETA", 0.5)
    t, u, y = simulated(2, 0.02, n=600)
    found = identify([first, Record("other", t, u, y)])
    assert found.quality == "nonlinear"
    assert "in made but" in found.message
    assert "in other: the plant has changed, or depends on the amplitude" in found.message
    assert found.advice is None


def test_outliers_are_left_out():
    t, u, y = simulated(3, 0.01, n=600)
    y[100:600:100] += 5.0 * np.std(y)
    found = identify([Record("spikes", t, u, y)])
    assert 5 <= found.fit.rejected <= 7
    assert abs(found.fit.value["zeta"] - ZETA) < 4.0 * found.fit.sd["zeta"]


def test_a_given_gain_stays_and_has_no_deviation():
    found = identify([record(4, 0.02, n=600)], K_L=K_L)
    assert found.fit.value["K_L"] == K_L
    assert found.fit.sd["K_L"] == 0.0
    assert not any("K_L" in pair for pair in found.as_json()["correlation"])


@pytest.mark.parametrize(
    ("change", "word", "says"),
    [
        (lambda t, u, y: (t, u * 0.0, y), "no_oscillation", "command u never changes"),
        (lambda t, u, y: (t, u, y * 0.0), "no_oscillation", "signal y never changes"),
        (lambda t, u, y: (t, u, y * np.nan), "stale", "no sample of y"),
        (lambda t, u, y: (t[:3], u[:3], y[:3]), "settling", "has 3 samples"),
    ],
)
def test_a_recording_that_tells_nothing_gets_a_word_and_a_reason(change, word, says):
    with pytest.raises(UntoldError, match=f"^x.csv: .*{says}") as told:
        Record("x.csv", *change(*simulated(1, 0.0, n=300)))
    assert told.value.quality == word


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t, u, y: (t, u * np.nan, y), "has no command u"),
        (lambda t, u, y: (t[::-1], u, y), "times t.* do not rise"),
        (lambda t, u, y: (np.repeat(t[::2], 2), u, y), "times t.* do not rise"),
    ],
)
def test_a_recording_that_cannot_be_used_is_refused_by_name(change, says):
    with pytest.raises(IdentifyError, match=f"^x.csv: .*{says}"):
        Record("x.csv", *change(*simulated(1, 0.0, n=300)))


def test_an_offset_of_the_speed_is_taken_out_or_counts_as_error():
    t, u, y = simulated(6, 0.01, "velocity", n=600)
    shifted = y + 0.5 * np.std(y)
    free = identify([Record("x", t, u, shifted, output="velocity")])
    assert free.fit.nrmse == pytest.approx(0.01, rel=0.15)
    held = identify([Record("x", t, u, shifted, output="velocity", offset=False)])
    assert held.fit.nrmse > 0.3  # the mean of the error counts as well


def test_a_wrong_sign_is_told_by_a_negative_gain():
    t, u, y = simulated(7, 0.01, n=600)
    found = identify([Record("x", t, -u, y)])
    assert found.fit.value["K_L"] == pytest.approx(-K_L, rel=0.02)
    assert found.fit.value["zeta"] == pytest.approx(ZETA, abs=4.0 * found.fit.sd["zeta"])


def test_a_clipped_sensor_is_called_saturated():
    t, u, y = simulated(8, 0.0, "velocity", n=600)
    top = 0.6 * np.max(np.abs(y))
    found = identify([Record("x", t, u, np.clip(y, -top, top), output="velocity")])
    assert found.quality == "saturated"
    assert found.advice is None


@pytest.mark.slow
def test_a_voltage_that_runs_on_between_samples_needs_the_hold_of_first_order():
    n, tick = 3000, 0.004
    t = np.arange(n) * tick
    u = sum(np.sin(2.0 * np.pi * f * t + f * f) for f in (0.7, 1.9, 4.3, 9.1, 15.7))
    system = lti([K_L * OMEGA_N**2], [1.0, 2.0 * ZETA * OMEGA_N, OMEGA_N**2])
    y = lsim(system, u, t, interp=True)[1]
    found = {
        hold: identify([Record("x", t, u, y, output="velocity", hold=hold)], delay=0.0) for hold in HOLDS
    }
    assert found["first"].fit.value["omega_n"] == pytest.approx(OMEGA_N, rel=1e-6)
    assert found["first"].fit.value["zeta"] == pytest.approx(ZETA, rel=1e-6)
    # held, the voltage comes half a tick late
    late = identify([Record("x", t, u, y, output="velocity")])
    assert late.quality == "nonlinear"
    assert "--hold first" in late.message
    assert late.fit.value["delay"] == pytest.approx(-0.5 * tick, rel=0.02)
    assert abs(found["zero"].fit.value["zeta"] / ZETA - 1.0) > 0.02


def test_noise_alone_gets_a_word_and_no_advice():
    t, u, _ = simulated(1, 0.0, n=600)
    found = identify([Record("noise", t, u, np.random.default_rng(0).standard_normal(600))])
    assert found.quality != "ok"
    assert found.advice is None


@pytest.fixture(scope="module")
def fonts():
    """matplotlib opens its fonts once and keeps them."""
    figure = Figure()
    figure.subplots().set_title("x")
    figure.savefig(io.BytesIO(), format="png")


@pytest.mark.slow
def test_the_command_prints_json_of_the_contract(tmp_path, fonts):
    t, u, y = simulated(5, 0.01, n=600)
    file = tmp_path / "a.csv"
    np.savetxt(file, np.stack([t, u, y], axis=1), delimiter=",", header="time,cmd,pos", comments="")
    options = ["--columns", "t=time,u=cmd,y=pos", "--plot", str(tmp_path / "a.png")]
    done = CliRunner().invoke(app, ["identify", str(file), *options, "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert set(answer) >= {"K_L", "omega_n", "zeta", "delay", "quality", "method", "nrmse"}
    assert answer["zeta"]["value"] == pytest.approx(ZETA, abs=4.0 * answer["zeta"]["sd"])
    assert (tmp_path / "a.png").stat().st_size > 1000
    text = CliRunner().invoke(app, ["identify", str(file), *options[:2]]).output
    assert "omega_n" in text
    assert "worst corner" in text


@pytest.mark.parametrize("wrong", [["--gain", "0"], ["--gain", "nan"], ["--delay", "-1"], ["--delay", "inf"]])
def test_values_that_cannot_be_are_refused(tmp_path, wrong):
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "a.csv"), *wrong])
    assert done.exit_code == 2
    assert wrong[0] in done.output


def test_of_a_rig_with_several_axes_one_has_to_be_chosen(tmp_path):
    seat = str(Path(__file__).parents[2] / "configs" / "seat-virtual.yaml")
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "a.csv"), "--config", seat])
    assert done.exit_code == 1
    assert "has the axes pitch, roll: choose one by --axis" in done.output
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "a.csv"), "--config", seat, "--axis", "yaw"])
    assert "no axis 'yaw'" in done.output


def test_a_missing_file_is_told(tmp_path):
    done = CliRunner().invoke(app, ["identify", str(tmp_path / "none.csv")])
    assert done.exit_code == 1
    assert "none.csv" in done.output


@pytest.fixture(scope="module")
def chirp():
    """Times, command, and every fifth sample: enough, and quicker."""
    if not CHIRP.exists():
        pytest.skip("the measured chirp is not there")
    with gzip.open(CHIRP, "rt") as file:
        t, u, y = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1, 2)).T
    y[np.arange(len(y)) % 5 > 0] = np.nan
    return t, u, y


@pytest.mark.slow
def test_the_measured_chirp_says_what_it_cannot_tell(chirp):
    half = (column[:30_000] for column in chirp)
    found = identify([Record("chirp", *half, output="velocity")])
    assert found.quality == "noisy"
    assert {each.what for each in found.alternatives} == {"with delay", "as a first-order lag"}
    assert found.assumed == ("delay",)
    assert found.fit.value["zeta"] < 2.0 < found.alternatives[0].fit.value["zeta"]
    assert found.advice is None
    assert found.as_json()["delay"] == {"value": 0.0, "sd": None}


@pytest.mark.slow
def test_the_measured_chirp_without_delay_gives_the_published_plant(chirp):
    """omega_n 94.50 rad/s, zeta 1.230, gain 1.013, error 5.0 %: u runs straight on between samples."""
    record = Record("chirp", *chirp, output="velocity", hold="first")
    found = identify([record], delay=0.0).fit
    assert found.value["omega_n"] == pytest.approx(94.5, rel=0.03)
    assert found.value["zeta"] == pytest.approx(1.23, rel=0.01)
    assert found.nrmse == pytest.approx(0.0476, abs=3e-4)
    published = {"omega_n": 94.5, "zeta": 1.23, "delay": 0.0, "K_L": 1.013}
    assert at([record], published, np.zeros((4, 4))).nrmse == pytest.approx(0.0500, abs=3e-4)
