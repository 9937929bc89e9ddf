"""A valve that is closed at another voltage than 0: a load bias while its flow is straight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hidden_drives import make_drive
from hidden_rig import Drive, Rig, simulate

from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(400)]

PLANT, T, VOLTS, NOISE = (12.0, 60.0, 0.4), np.arange(0.0, 6.0, 1e-3), 2.0, 0.003


def told_of(effects):
    rig, random = Rig(*PLANT, effects, sees_speed=True), np.random.default_rng(3)
    drive: Drive = make_drive("steps", rig, T, VOLTS, random, 0.0)
    size = NOISE * np.std(simulate(rig, T, drive)[0])
    y, u = simulate(rig, T, drive, random.normal(0.0, size, len(T)))
    rows = np.arange(len(T))
    recording = Recording((Path("run.csv"),), T, u, y, None, None, None, rows, {}, {}, ())
    return diagnose([recording], (), Options("velocity")).as_json()


def test_behind_orifices_it_counts_as_a_load_bias_and_has_its_voltage():
    """The flow bends where the valve is closed: a load bias would leave a bend at 0 V."""
    supply = 3.0 * PLANT[0] * PLANT[1] * VOLTS
    told = told_of({"square_root_flow": {"supply": supply}, "null_shift": {"voltage": 0.4}})
    names = {each["name"]: each["parameters"] for each in told["effects"]}
    assert names.keys() == {"square_root_flow", "load_bias"}, told
    low, high = names["load_bias"]["voltage"]["ci95"]
    assert low < 0.4 < high
    assert names["load_bias"]["voltage"]["value"] == pytest.approx(0.4, rel=0.02)
    equal = 0.4 * PLANT[0] * PLANT[1] / (2.0 * PLANT[2])
    low, high = names["load_bias"]["acceleration"]["ci95"]
    assert low < names["load_bias"]["acceleration"]["value"] < high
    assert names["load_bias"]["acceleration"]["value"] == pytest.approx(equal, rel=0.05)
    assert told["extended"]["holdout_nrmse"] < 1.1 * told["noise_floor_nrmse"]


def test_a_load_behind_orifices_is_no_null_shift():
    supply = 3.0 * PLANT[0] * PLANT[1] * VOLTS
    effects = {"square_root_flow": {"supply": supply}, "load_bias": {"acceleration": 0.15 * supply}}
    told = told_of(effects)
    names = {each["name"]: each["parameters"] for each in told["effects"]}
    assert names.keys() == effects.keys(), told
    assert names["load_bias"].keys() == {"acceleration"}


def test_of_a_straight_valve_it_is_a_load_bias():
    told = told_of({"null_shift": {"voltage": 0.4}})
    assert [each["name"] for each in told["effects"]] == ["load_bias"], told
