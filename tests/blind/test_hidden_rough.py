"""Records of rough rigs: the numbers to be found are those of the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_cases import draw
from hidden_records import make_record
from hidden_rough import Rough, dimension, make_rough_record, rough
from kernel_cases import apart
from plant_truth import Plant
from truth_runs import follow

QUIET = Rough(0.0, 0.0, 0.0, 0.0, 50.0, 0, time=7.0, length=0.02, sign=1.0)


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("unit/s^2", (1, -2)),
        ("rad/unit", (-1, 0)),
        ("V/s", (0, -1)),
        ("1", (0, 0)),
        ("s", (0, 1)),
        ("1/s^2", (0, -2)),
    ],
)
def test_units_are_taken_apart(unit, powers):
    assert dimension(unit, sees_speed=False) == powers


def test_a_step_of_a_speed_is_one():
    assert dimension("unit (unit/s for a speed)", sees_speed=True) == (1, -1)
    assert dimension("unit (unit/s for a speed)", sees_speed=False) == (1, 0)


@pytest.mark.parametrize("sees_speed", [False, True])
@pytest.mark.parametrize(
    "cause", ["coulomb_friction", "asymmetric_gain", "load_bias", "valve_rate_limit", "backlash"]
)
def test_the_file_is_that_of_the_plant_with_converted_numbers(cause, sees_speed):
    case = replace(draw(32000, "one", (cause,), "steps", sees_speed, duration=6.0), noise=0.0)
    case = replace(case, duration=0.3)
    record = make_rough_record(case, QUIET)
    effects = {
        name: {of: QUIET.converted(f"{name}.{of}", x, sees_speed=sees_speed) for of, x in group.items()}
        for name, group in case.rig.effects.items()
    }
    rig = case.rig
    plant = Plant(QUIET.gain(rig.K_L), rig.omega_n / QUIET.time, rig.zeta, effects, sees_speed=sees_speed)
    t_u = record.t if record.t_u is None else record.t_u
    truth = follow(plant, t_u, record.u, record.t)
    assert apart(record.y, truth) < 3e-3


def test_a_turned_command_turns_the_gain_alone():
    case = replace(draw(32000, "one", ("asymmetric_gain",), "steps", False, duration=3.0), noise=0.0)
    turned = replace(QUIET, sign=-1.0)
    ours, other = make_rough_record(case, turned), make_rough_record(case, QUIET)
    np.testing.assert_array_equal(ours.u, -other.u)
    np.testing.assert_array_equal(ours.y, other.y)
    assert turned.gain(3.0) == -QUIET.gain(3.0)
    assert turned.converted("asymmetric_gain.ratio", 0.2, sees_speed=False) == -0.2
    assert turned.converted("load_bias.acceleration", 5.0, sees_speed=False) > 0.0


@pytest.mark.parametrize("number", range(40, 46))
def test_what_disturbs_is_as_large_as_the_white_noise_was(number):
    case = draw(number, "clean", (), "multisine", False, duration=12.0)
    how = replace(rough(case), bits=0, time=1.0, length=1.0, sign=1.0)
    disturbed = make_rough_record(case, how).y - make_record(replace(case, noise=0.0)).y
    assert 0.5 * case.noise < float(np.std(disturbed)) < 2.0 * case.noise


def test_scales_are_spread():
    every = [rough(draw(number, "clean", (), "multisine", duration=3.0)) for number in range(60)]
    assert {each.sign for each in every} == {-1.0, 1.0}
    assert {each.bits for each in every} == {0, 12, 16}
    assert np.ptp(np.log10([each.length for each in every])) > 4.0
    assert any(each.gusts for each in every)
    assert any(each.hum for each in every)
