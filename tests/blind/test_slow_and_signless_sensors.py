"""Sensors that show no sign, or repeat their readings: found in records of the actuator in physical units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hidden_drives import make_drive
from hidden_rig import GIVEN, Drive, Rig, simulate

from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(1200)]

PLANT, TICK = (12.0, 60.0, 0.4), 1e-3
SECONDS, SHORT_S = 12.0, 6.0
"""Of records; of those that show as much in half the time, and take less to search."""
NOISE = 0.01


def told_of(effects, excitation, *, sees_speed, seconds=SECONDS):
    t = np.arange(0.0, seconds, TICK)
    rig, random = Rig(*PLANT, effects, sees_speed), np.random.default_rng(1)
    drive = make_drive(excitation, rig, t, 2.0, random, 0.0)
    size = NOISE * np.std(simulate(rig, t, drive)[0])
    y, u = simulate(rig, t, drive, random.normal(0.0, size, len(t)))
    rows = np.arange(len(t))
    recording = Recording((Path("run.csv"),), t, u, y, None, None, None, rows, {}, {}, ())
    return diagnose([recording], (), Options("velocity" if sees_speed else "position")).as_json()


def check(told, *names):
    assert (told["verdict"], {each["name"] for each in told["effects"]}) == ("effects", {*names}), told
    extended = told["extended"]
    # from rest a plant that is turned round reads alike behind a sensor without sign
    assert (abs(extended["K_L"]), extended["omega_n"], extended["zeta"]) == pytest.approx(PLANT, rel=0.02)
    assert extended["holdout_nrmse"] < 1.1 * told["noise_floor_nrmse"]


@pytest.mark.parametrize(("excitation", "sees_speed"), [("multisine", True), ("steps", False)])
def test_a_sensor_without_sign_is_named(excitation, sees_speed):
    told = told_of({"rectified_sensor": {"part": 1.0}}, excitation, sees_speed=sees_speed, seconds=SHORT_S)
    check(told, "rectified_sensor")
    assert told["baseline"]["holdout_nrmse"] > 0.9
    part = told["effects"][0]["parameters"]["part"]
    assert part["value"] == pytest.approx(1.0, abs=2e-3)
    assert part["ci95"][0] < 1.0 < part["ci95"][1]


@pytest.mark.parametrize(
    ("hold", "excitation", "sees_speed"),
    [
        (5e-3, "multisine", False),
        (3.7e-3, "multisine", True),
        (8.3e-3, "steps", False),
        (4e-3, "relay", False),
    ],
)
def test_readings_that_repeat_are_named_with_their_clock(hold, excitation, sees_speed):
    told = told_of({"held_readings": {"time": hold}}, excitation, sees_speed=sees_speed)
    check(told, "held_readings")
    assert told["effects"][0]["parameters"]["time"]["value"] == pytest.approx(hold, rel=1e-4)


def test_beside_them_friction_is_found_as_ever():
    effects = {"held_readings": {"time": 5e-3}, "coulomb_friction": {"level": 200.0}}
    told = told_of(effects, "multisine", sees_speed=False, seconds=SHORT_S)
    check(told, "held_readings", "coulomb_friction")


def test_a_coarse_sensor_that_repeats_its_readings_has_both():
    effects = {"held_readings": {"time": 5e-3}, "sensor_quantization": {"step": 2e-3}}
    check(told_of(effects, "multisine", sees_speed=False), "held_readings", "sensor_quantization")


def test_the_square_of_a_speed_is_named_with_its_power():
    told = told_of(
        {"rectified_sensor": {"part": 1.0, "power": 2.0, "range": 15.0}}, "multisine", sees_speed=True
    )
    assert (told["verdict"], [each["name"] for each in told["effects"]]) == ("effects", ["rectified_sensor"])
    power = told["effects"][0]["parameters"]["power"]
    assert power["value"] == pytest.approx(2.0, abs=0.02)
    assert power["ci95"][0] < 2.0 < power["ci95"][1]
    extended = told["extended"]
    assert (extended["omega_n"], extended["zeta"]) == pytest.approx(PLANT[1:], rel=0.02)
    assert extended["holdout_nrmse"] < 1.1 * told["noise_floor_nrmse"]


def test_a_few_hundred_rows_behind_such_a_sensor_name_lags_before_and_behind_it():
    """Of windows of 60 rows the first fifth tells no initial state: whole recordings are fitted."""
    effects = {
        "rectified_sensor": {"part": 1.0, "power": 2.0, "range": 2.0},
        "valve_lag": {"time": 0.2},
        "sensor_lag": {"time": 0.04},
    }
    t, recordings = np.arange(0.0, 5.0, 0.02), []
    for seed in (1, 2):
        rig, random = Rig(1.4, 24.0, 0.15, effects, sees_speed=True), np.random.default_rng(seed)
        u = np.repeat(random.uniform(-1.5, 2.5, 25), 10)
        y, u = simulate(rig, t, Drive(GIVEN, u), random.normal(0.0, 0.01, len(t)))
        rows = np.arange(len(t))
        recordings.append(Recording((Path(f"{seed}.csv"),), t, u, y, None, None, None, rows, {}, {}, ()))
    told = diagnose(recordings, (), Options("velocity")).as_json()
    assert {each["name"] for each in told["effects"]} == set(effects), told["effects"]
    sizes = {
        each["name"]: {of: p["value"] for of, p in each["parameters"].items()} for each in told["effects"]
    }
    assert sizes["valve_lag"]["time"] == pytest.approx(0.2, rel=0.1)
    assert sizes["rectified_sensor"]["power"] == pytest.approx(2.0, rel=0.05)
    assert told["extended"]["holdout_nrmse"] < 0.1 < told["baseline"]["holdout_nrmse"]
