"""The experiment that is proposed separates the causes: tried out with the rig's own simulation, apart."""

import numpy as np
import pytest

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import hidden_by_relay
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.result import FoundEffect, Gain
from seod.diagnose.tuning.verdict import NEXT_EXPERIMENT
from seod.diagnose.verdict.experiment_trial import Excitation, follow, perform, refitted, times
from seod.diagnose.verdict.next_experiment import beyond_a_relay, excitations, next_experiment

K_L, OMEGA_N, ZETA = 17.0, 117.0, 0.4
TICK, NOISE, VOLTS = 1e-3, 1e-3, 1.0
SCALES = Scales(VOLTS, 8.0, 900.0, 0.0, 0.2, 0.1, OMEGA_N, 20.0, TICK)


def model_with(name, sees_speed=False, **values):
    model = baseline_model(SCALES, 1.0, sees_speed, {}).with_effect(name)
    every = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA, **{f"{name}.{of}": x for of, x in values.items()}}
    return model, model.searched(every)


def propose(name, others, **values):
    model, x = model_with(name, **values)
    found = FoundEffect(name, {}, Gain(0.1, 0.01), 0.0, tuple(others))
    return next_experiment([found], model, x, NOISE, VOLTS, TICK)


def test_nothing_is_proposed_where_all_is_told_apart():
    assert propose("valve_deadband", (), half_width=0.1) is None


@pytest.mark.parametrize(
    ("name", "values", "rival"),
    [
        ("transport_delay", {"time": 2e-3}, "spool_inertia"),
        ("valve_lag", {"time": 2e-3}, "spool_inertia"),
        ("stribeck_friction", {"level": 200.0, "speed": 1.0}, "lugre_friction"),
    ],
)
def test_a_rival_that_does_nothing_without_another_cause_is_none(name, values, rival):
    """A delay was said to be a spool with inertia as well, whose lag is a cause of its own: a traceback."""
    assert propose(name, (rival,), **values) is None


def test_unequal_gain_and_load_bias_are_separated_by_several_amplitudes_of_the_relay():
    told = propose("asymmetric_gain", ["load_bias"], ratio=0.1)
    assert told.separates == ("asymmetric_gain", "load_bias")
    assert told.input.startswith("relay: 0.25, 0.5, 1 V one after the other")
    assert told.command.startswith("seod set e_a=0.25 two_phase=false && seod start && sleep ")
    assert told.command.count("seod stop") == 3


def test_overlap_and_play_need_more_than_a_relay():
    told = propose("valve_deadband", ["valve_hysteresis"], half_width=0.1)
    assert not told.input.startswith("relay")
    model, x = model_with("valve_deadband", half_width=0.1)
    rival, begin = model_with("valve_hysteresis", half_width=0.1)
    record, t = model.kernel_parameters(x), times(OMEGA_N, TICK)
    asked = {each.kind: each for each in excitations(OMEGA_N, VOLTS, TICK)}
    near = refitted(rival, [begin], perform(record, Excitation("relay", (VOLTS,), (1.0, 50.0)), t), NOISE)
    far = refitted(
        rival, [begin], perform(record, asked[told.input.split(",")[0].split(":")[0].split(" ")[0]], t), NOISE
    )
    assert near[1] < 0.1 * far[1]
    assert far[1] > NEXT_EXPERIMENT.misses_by


def test_lags_before_and_behind_a_linear_plant_need_another_sensor():
    told = propose("valve_lag", ["sensor_lag"], time=2e-3)
    assert "load force" in told.input
    assert told.command == ""
    assert told.separates == ("valve_lag", "sensor_lag")


def test_no_trial_asks_for_more_volts_than_the_recordings_had():
    for each in excitations(OMEGA_N, VOLTS, TICK):
        model, x = model_with("valve_lag", time=1e-3)
        run = perform(model.kernel_parameters(x), each, times(OMEGA_N, TICK))
        assert np.max(np.abs(run.u)) <= VOLTS * (1.0 + 1e-12)
        assert np.ptp(run.u) > 0.0


def test_a_rival_that_is_the_truth_itself_fits():
    model, x = model_with("coulomb_friction", level=200.0)
    t = times(OMEGA_N, TICK)
    run = perform(model.kernel_parameters(x), excitations(OMEGA_N, VOLTS, TICK)[-1], t)
    found, left = refitted(model, [x + 0.02], run, NOISE)
    assert left < 0.2
    np.testing.assert_allclose(model.kernel_parameters(found)["coulomb_friction_level"], 200.0, rtol=0.01)


def test_a_gain_that_is_known_is_not_searched():
    model = baseline_model(SCALES, 1.0, False, {}, K_L).with_effect("coulomb_friction")
    truth = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA, "coulomb_friction.level": 200.0}
    x, t = model.searched(truth), times(OMEGA_N, TICK)
    run = perform(model.kernel_parameters(x), excitations(OMEGA_N, VOLTS, TICK)[-1], t)
    found, left = refitted(model, [x + 0.02], run, NOISE)
    assert left < 0.2
    assert model.values(found)["K_L"] == pytest.approx(K_L)


@pytest.mark.parametrize("sees_speed", [False, True], ids=["position", "speed"])
def test_readings_and_pressure_are_those_of_the_plant(sees_speed):
    model, x = model_with("valve_lag", sees_speed, time=1e-3)
    t = np.arange(0.0, 1.0, TICK)
    y, pressure = follow(model.kernel_parameters(x), t, np.full(len(t), 0.5))
    speed = y[-1] if sees_speed else (y[-1] - y[-101]) / 0.1
    assert speed == pytest.approx(0.5 * K_L, rel=1e-3)
    assert abs(pressure[-1]) < 1e-3 * np.max(np.abs(pressure))


def test_what_two_commands_hide_has_its_experiment():
    model = baseline_model(SCALES, 1.0, False, {})
    x = model.searched({"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA})
    told = beyond_a_relay(model, x, NOISE, VOLTS, TICK)
    assert told.separates == tuple(hidden_by_relay())
    assert told.command.startswith("seod response --config RIG.yaml --amplitude 0.25 --band ")
    assert "vanish into the gain" in told.reason
    assert beyond_a_relay(model, x, 10.0, VOLTS, TICK) is None


@pytest.mark.parametrize("name", hidden_by_relay())
def test_a_relay_hides_it_indeed(name):
    hidden = baseline_model(SCALES, 1.0, False, {}).with_effect(name)
    truth = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA}
    record = hidden.kernel_parameters(hidden.searched(truth | hidden_by_relay()[name].shown(VOLTS)))
    run = perform(record, Excitation("relay", (VOLTS,), (1.0, 50.0)), times(OMEGA_N, TICK))
    plain = baseline_model(SCALES, 1.0, False, {})
    assert refitted(plain, [plain.searched(truth)], run, NOISE)[1] < NEXT_EXPERIMENT.misses_by
