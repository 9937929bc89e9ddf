"""What a user may tell of the baseline, and what it takes for itself: type, hold, gain, delay, offset."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_truth import linear, multisine
from diagnose_truth import recording as white
from scipy.signal import StateSpace, lsim

from seod.cli import app
from seod.data import Recording
from seod.diagnose import pipeline
from seod.diagnose.pipeline import Options, diagnose, told_gain
from seod.diagnose.search.budget import EFFORTS
from seod.diagnose.tuning.record import CLOSED_FORM
from tests.command_line import CliRunner

pytestmark = pytest.mark.slow

TICK, N, FINE = 0.01, 3000, 20
PLANT = (12.0, 40.0, 0.4)


def recorded(*, speed, hold="zero", tick=TICK, plant=PLANT, delay=0.0, offset=0.0, highest=0.25):
    """A smooth command, and the plant of Eq. 1 by scipy at a twentieth of the interval; 1 % of noise."""
    random, (K_L, omega, zeta) = np.random.default_rng(2), plant
    t, fine = np.arange(N) * tick, np.arange(N * FINE) * tick / FINE
    hertz = np.fft.rfftfreq(N, tick)
    lines = np.where((hertz > 5e-4 / tick) & (hertz < 0.5 * highest / tick), 1.0, 0.0)
    lines = lines * (random.normal(size=len(hertz)) + 1j * random.normal(size=len(hertz)))
    u = np.fft.irfft(lines, N)
    u /= np.std(u)
    past = fine - delay
    rows = np.clip(np.floor(past / tick + 1e-9).astype(int), 0, N - 1)
    given = np.interp(past, t, u) if hold == "first" else u[rows]
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(omega**2), -2.0 * zeta * omega]])
    B, C = np.array([[0.0], [0.0], [K_L * omega**2]]), np.array([[1.0, 0.0, 0.0]])
    if speed:
        A, B, C = A[1:, 1:], B[1:], C[:, :2]
    y = lsim(StateSpace(A, B, C, np.zeros((1, 1))), given, fine, interp=hold == "first")[1][::FINE]
    y = y + np.std(y) * (offset + 0.01 * random.normal(size=N))
    return Recording((Path("run.csv"),), t, u, y, None, None, None, np.arange(N), {}, {}, ())


def numbers(of):
    return of["K_L"], of["omega_n"], of["zeta"]


def test_a_command_that_runs_straight_on_is_simulated_so(monkeypatch):
    recording = recorded(speed=True, hold="first", plant=(12.0, 60.0, 0.4))
    told = diagnose([recording], (), Options("velocity", hold="first")).as_json()
    assert (told["verdict"], told["effects"]) == ("clean", [])
    assert numbers(told["baseline"]) == pytest.approx((12.0, 60.0, 0.4), rel=0.01)
    monkeypatch.setitem(EFFORTS, "quick", 0.02)  # of the other its baseline is asked alone
    held = diagnose([recording], (), Options("velocity", effort="quick", hold="zero")).as_json()
    assert held["baseline"]["holdout_nrmse"] > 4.0 * told["baseline"]["holdout_nrmse"]


def test_where_nobody_says_so_it_is_found_and_told():
    recording = recorded(speed=True, hold="first", plant=(12.0, 60.0, 0.4))
    told = diagnose([recording], (), Options("velocity", effort="quick")).as_json()
    assert (told["verdict"], told["effects"]) == ("clean", [])
    assert numbers(told["baseline"]) == pytest.approx((12.0, 60.0, 0.4), rel=0.01)
    assert any("straight on" in each for each in told["remarks"])


@pytest.mark.parametrize(("speed", "output", "kind"), [(True, "velocity", 0), (False, "position", 1)])
def test_the_type_is_found_where_nobody_tells_it(speed, output, kind):
    told = diagnose([recorded(speed=speed)], (), Options(output=None)).as_json()
    assert (told["output"], told["verdict"]) == (output, "clean")
    assert numbers(told["baseline"]) == pytest.approx(PLANT, rel=0.02)
    (sentence,) = [each for each in told["remarks"] if "type" in each]
    assert f"(type {kind}:" in sentence


def test_a_type_that_leaves_noise_alone_is_not_doubted(monkeypatch):
    """However large the noise: a search as the other type had taken ten times as long."""
    asked, searched_as = [], pipeline.search_once

    def searched(every, setup, *more):
        asked.append(setup.sees_speed)
        return searched_as(every, setup, *more)

    monkeypatch.setattr(pipeline, "search_once", searched)
    u = multisine(4000)
    told = diagnose([white(u, linear(u), noise=0.05)], (), Options(output=None, effort="quick"))
    assert told.extended.holdout_nrmse > 1.5 * CLOSED_FORM.good
    assert asked == [False]


def test_offset_and_delay_are_told_beside_the_plain_baseline():
    recording = recorded(speed=True, delay=0.03, offset=3.0)
    told = diagnose([recording], (), Options("velocity", effort="quick")).as_json()
    common = told["baseline"]["with_offset_and_delay"]
    assert told["baseline"]["holdout_nrmse"] > 1.0
    assert common["holdout_nrmse"] < 0.013
    assert numbers(common) == pytest.approx(PLANT, rel=0.02)
    assert common["delay"] == pytest.approx(0.03, abs=5e-4)
    assert {each["name"] for each in told["effects"]} == {"load_bias", "transport_delay"}


def test_a_delay_of_seconds_is_found_at_ten_hertz_and_a_negative_gain_is_told():
    slow = {"tick": 0.1, "plant": (-3.0, 0.6, 0.4), "delay": 3.0, "highest": 0.05}
    told = diagnose([recorded(speed=False, **slow)], (), Options("position")).as_json()
    (found,) = told["effects"]
    assert found["name"] == "transport_delay"
    assert found["parameters"]["time"]["value"] == pytest.approx(3.0, abs=0.02)
    assert numbers(told["extended"]) == pytest.approx((-3.0, 0.6, 0.4), rel=0.02)
    assert any("K_L is negative" in each for each in told["remarks"])


def test_behind_a_sensor_without_sign_a_negative_gain_is_not_told():
    """The plant turned round reads alike, so that nobody knows whether the command is."""
    u = multisine(3000)
    found = diagnose([white(-u, np.abs(linear(u)), noise=0.003)], (), Options(effort="quick"))
    assert [each.name for each in found.effects] == ["rectified_sensor"]
    assert found.extended.K_L < 0.0
    assert not any("turned round" in each for each in found.remarks)
    assert told_gain(found, {}) == -found.extended.K_L
    assert told_gain(replace(found, effects=()), {}) == found.extended.K_L
    assert told_gain(replace(found, effects=()), found.extended.effects) == -found.extended.K_L


def test_what_is_known_stays_as_it_is(tmp_path):
    recording = recorded(speed=True, delay=0.03)
    table = np.column_stack([recording.t, recording.u, recording.y])
    np.savetxt(tmp_path / "run.csv", table, header="t,u,y", comments="", delimiter=",")
    known = ["--gain", "12", "--delay", "0.03", "--output", "velocity"]
    asked = CliRunner().invoke(app, ["diagnose", str(tmp_path / "run.csv"), *known, "--json"])
    told = json.loads(asked.stdout)
    assert (told["verdict"], told["effects"]) == ("clean", [])
    assert told["baseline"]["K_L"] == pytest.approx(12.0, rel=1e-9)
    assert told["baseline"]["with_offset_and_delay"]["delay"] == 0.03
    assert numbers(told["baseline"]) == pytest.approx(PLANT, rel=0.01)
