"""The kernel's result and its substep: the order of the method, over events too, and the tolerance."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_cases import ALL_PAIRS, EFFECTS_ON, NONE, apart, follow, record, steps

from sim import runs
from sim.state import new_state

T = np.arange(0.02, 0.6, 0.02)  # far apart: the substep is the integrator's own
T_U, U = steps(0.6)
CONDITIONS = {"supply": 1.0 + 0.2 * np.sin(30.0 * T), "warmth": 10.0 * np.sin(12.0 * T)}
SETS = [(), *((name,) for name in [*EFFECTS_ON, "end_stops"]), *ALL_PAIRS]


def at(accuracy, names, sees_speed=False, plant=(17.0, 117.0, 0.21)):
    p = record(names, accuracy=accuracy, sees_speed=sees_speed, plant=plant)
    return follow(p, T_U, U, T, **CONDITIONS)[0]


@pytest.mark.parametrize(
    "names",
    [
        ("load_spring", "parameter_drift"),
        ("load_resonance", "parameter_drift"),
        ("valve_lag", "valve_deadband"),
        ("valve_lag", "asymmetric_gain"),
        ("spool_inertia", "valve_deadband"),
        ("spool_inertia", "asymmetric_gain"),
        ("valve_rate_limit", "valve_deadband"),
        ("valve_rate_limit", "valve_lag", "asymmetric_gain"),
        ("load_spring", "coulomb_friction"),
        ("stribeck_friction",),
        ("backlash", "sensor_lag"),
        ("load_spring", "end_stops"),
        ("load_spring", "end_stops", "coulomb_friction"),
    ],
    ids="+".join,
)
def test_the_order_is_four_through_all_events(names):
    exact = at(0.005, names)
    errors = [apart(at(accuracy, names), exact) for accuracy in (0.16, 0.08, 0.04)]
    assert errors[0] / errors[2] > 16.0**2 / 2.5, errors
    assert errors[2] < 1e-6


@pytest.mark.parametrize(
    "names",
    [
        (),
        ("valve_hysteresis", "valve_deadband"),
        ("asymmetric_gain", "null_shift"),
        ("coulomb_friction",),
        ("transport_delay", "null_shift", "backlash"),
        ("end_stops",),
        ("end_stops", "coulomb_friction", "valve_deadband"),
    ],
    ids="+".join,
)
@pytest.mark.parametrize("plant", [(17.0, 117.0, 0.21), (17.0, 60.0, 0.8), (80.0, 60.0, 3.0)], ids=str)
def test_a_linear_plants_steps_have_no_error(names, plant):
    assert record(names, plant=plant)[0]["linear"] == 1.0
    assert apart(at(0.2, names, plant=plant), at(0.005, names, plant=plant)) < 1e-9


@pytest.mark.parametrize(
    "names",
    [
        ("load_resonance",),
        ("load_spring", "valve_deadband"),
        ("sensor_lag", "valve_hysteresis"),
        ("load_resonance", "load_spring", "sensor_lag"),
    ],
    ids="+".join,
)
def test_nor_have_those_by_a_matrix(names):
    assert record(names)[0]["by_matrix"] != 0.0
    assert apart(at(0.2, names), at(0.005, names)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("plant", [(17.0, 117.0, 0.21), (17.0, 145.0, 0.45), (17.0, 60.0, 0.8)], ids=str)
def test_a_tenth_of_the_substep_changes_less_than_the_tolerance(plant):
    changes = {}
    for names in SETS:
        fine, coarse = at(0.01, names, plant=plant), at(0.1, names, plant=plant)
        if np.ptp(fine) > 1e-3:
            changes[names] = apart(coarse, fine)
    assert len(changes) > 0.9 * len(SETS)
    assert max(changes.values()) < 1e-5, max(changes, key=changes.__getitem__)


@pytest.mark.parametrize("name", [name for name in EFFECTS_ON if name != "parameter_drift"])
def test_a_reading_of_speed_converges_likewise(name):
    fine, coarse = at(0.01, (name,), sees_speed=True), at(0.1, (name,), sees_speed=True)
    assert apart(coarse, fine) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [(), ("valve_lag", "coulomb_friction"), ("square_root_flow", "backlash")], ids=str
)
def test_the_frequency_under_an_ideal_relay_converges_likewise(names):
    found = []
    for accuracy in (0.1, 0.01):
        p, r = record(names, accuracy=accuracy), np.zeros(1, runs.RELAY)
        r["e_a"], r["hysteresis"], switches = 0.5, 0.01, np.zeros(100)
        count = runs.ideal_relay(p[0], new_state(p)[0], r[0], np.array([1.0]), np.empty(1), switches)
        found.append(switches[:count])
    assert len(found[0]) == len(found[1]) > 20
    np.testing.assert_allclose(found[0], found[1], rtol=3e-6)


def test_the_times_of_reading_do_not_matter():
    for names in [(), ("coulomb_friction", "backlash"), ("square_root_flow", "valve_lag")]:
        often = np.sort(np.append(T, np.random.default_rng(4).uniform(0.0, T[-1], 500)))
        y = follow(record(names), T_U, U, often)[0][np.searchsorted(often, T)]
        assert apart(follow(record(names), T_U, U, T)[0], y) < 1e-5


def test_noise_and_conditions_may_be_absent():
    y = follow(record(), T_U, U, T, noise=NONE)[0]
    ones = follow(record(), T_U, U, T, supply=np.ones(len(T)), warmth=np.zeros(len(T)))[0]
    np.testing.assert_array_equal(y, ones)
