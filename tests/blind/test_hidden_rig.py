"""The generator of hidden effects, held against the plant of `plant_truth` and closed forms."""

import json
from dataclasses import replace

import hidden_rig
import numpy as np
import pytest
from hidden_baseline import best_baseline
from hidden_cases import LISTED_SINCE, MOST_JITTER, SLEW, Invisible, draw, known, run, seen_at
from hidden_drives import EXCITATIONS
from hidden_fair import chatters, left_beside, left_by_list, moves
from hidden_records import make_record, write
from hidden_rig import GIVEN, RELAY, Drive, Rig, simulate
from hidden_strength import ALONE, DEFECTS, ELSEWHERE, LISTED, UNLISTED
from kernel_cases import EFFECTS_ON, K_L, OMEGA_N, ZETA, apart, chosen
from plant_truth import Plant
from truth_runs import follow

from seod.data import read
from sim.effects import EFFECTS

T = np.arange(0.0, 0.12, 1e-3)
U = np.repeat([1.0, -1.0, 0.6, 0.3, -0.5, 1.0], 20)
SUPPLY = 1.0 + 0.3 * np.sin(40.0 * T)
MOVED_BY_SUPPLY = {"square_root_flow", "pressure_dependent_stiffness"}


def at_constant_temperature(effects):
    """Without the thermal drift, which hidden rigs do not have."""
    return {
        name: {of: value for of, value in values.items() if "thermal" not in of}
        for name, values in effects.items()
    }


@pytest.mark.parametrize("name", EFFECTS_ON)
def test_each_effect_is_that_of_the_plant_written_apart(name):
    effects = at_constant_temperature(chosen(name))
    sees_speed = name in {"valve_hysteresis", "load_resonance", "sensor_lag", "rectified_sensor"}
    supply = SUPPLY if name in MOVED_BY_SUPPLY else None
    rubs = effects.get("viscous_friction", {}).get("share", 0.0)
    rig = Rig(K_L, OMEGA_N, ZETA, effects, sees_speed, rubs=rubs)
    ours, _ = simulate(rig, T, Drive(GIVEN, U), supply=supply)
    apart_from = follow(Plant(K_L, OMEGA_N, ZETA, effects, sees_speed=sees_speed), T, U, T, supply)
    without, _ = simulate(Rig(K_L, OMEGA_N, ZETA, {}, sees_speed), T, Drive(GIVEN, U), supply=supply)
    assert apart(ours, apart_from) < 1e-3
    assert apart(ours, without) > 2e-3, "the effect does nothing here"


@pytest.mark.parametrize("gusts", [{}, {"gusts": {"strength": 150.0}}], ids=["alone", "beside gusts"])
def test_a_measured_disturbance_pushes_the_plant_written_apart_alike(gusts):
    effects = {"measured_disturbance": {"gain": -3.0}}
    f = 90.0 * np.sin(70.0 * T)
    rig = Rig(K_L, OMEGA_N, ZETA, effects | gusts)
    given = -3.0 * f + (150.0 * np.cos(50.0 * T) if gusts else 0.0)
    ours, _ = simulate(rig, T, Drive(GIVEN, U), gusts=given)
    truth = follow(Plant(K_L, OMEGA_N, ZETA, effects), T, U, T, force=-given / 3.0)
    assert apart(ours, truth) < 1e-3
    assert apart(ours, follow(Plant(K_L, OMEGA_N, ZETA, {}), T, U, T)) > 0.02


@pytest.mark.parametrize(
    "effects",
    [("valve_lag", "coulomb_friction"), ("backlash", "sensor_lag"), ("square_root_flow", "load_bias")],
    ids="+".join,
)
def test_effects_combine(effects):
    effects = chosen(*effects)
    ours, _ = simulate(Rig(K_L, OMEGA_N, ZETA, effects), T, Drive(GIVEN, U))
    assert apart(ours, follow(Plant(K_L, OMEGA_N, ZETA, effects), T, U, T)) < 1e-3


def test_the_hardware_behind_the_numbers_does_not_matter():
    effects = chosen("square_root_flow", "coulomb_friction", "load_resonance")
    one, other = (
        simulate(Rig(K_L, OMEGA_N, ZETA, effects, False, d, j), T, Drive(GIVEN, U))[0]
        for d, j in ((1e-5, 0.01), (3e-4, 2.0))
    )
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sees_speed", [False, True], ids=["position", "speed"])
def test_the_best_baseline_finds_the_linear_plant_and_leaves_the_noise(sees_speed):
    t, random = np.arange(0.0, 10.0, 1e-3), np.random.default_rng(4)
    u = np.repeat(random.choice([-1.0, 1.0], 200), 50)
    noise = random.normal(0.0, 0.01, len(t))
    y, _ = simulate(Rig(17.0, 60.0, 0.5, {}, sees_speed), t, Drive(GIVEN, u), noise)
    found = best_baseline(y, u, 1e-3, (17.0, 80.0, 0.3), sees_speed=sees_speed)
    assert (found.K_L, found.omega_n, found.zeta) == pytest.approx((17.0, 60.0, 0.5), rel=0.01)
    assert found.rms == pytest.approx(0.01, rel=0.05)


def test_the_lists_name_all_causes_and_nothing_else():
    assert {*LISTED, *DEFECTS, *ALONE, *ELSEWHERE} == {
        name for name, effect in EFFECTS.items() if effect.cause
    }
    assert not set(UNLISTED) & set(EFFECTS)


@pytest.mark.parametrize("excitation", EXCITATIONS)
def test_a_hidden_effect_is_visible_over_the_noise(excitation):
    case = draw(11, "one", ("coulomb_friction",), excitation, sees_speed=False, duration=4.0)
    y, u = run(case)
    start = case.rig.K_L, case.rig.omega_n, case.rig.zeta
    assert best_baseline(y, u, case.tick, start).rms > 3.0 * case.noise
    assert case.noise == pytest.approx(
        0.01 * np.std(y - np.polyval(np.polyfit(case.t, y, 1), case.t)), rel=1e-6
    )


def test_beside_a_coarse_sensor_an_effect_counts_by_what_it_leaves_before_rounding():
    both = ("coulomb_friction", "sensor_quantization")
    case = draw(3, "two", both, "multisine", sees_speed=False, duration=4.0)
    rough, u = run(case)
    fine = replace(case.rig, effects={"coulomb_friction": case.rig.effects["coulomb_friction"]})
    y, _ = simulate(fine, case.t, Drive(GIVEN, u), latency=case.latency)
    assert float(np.std(rough - y)) > 2.0 * case.noise
    start = case.rig.K_L, case.rig.omega_n, case.rig.zeta
    left = best_baseline(y, u, case.tick, start).rms
    assert case.visible["coulomb_friction"] * case.noise == pytest.approx(left, rel=0.01)


def test_a_load_at_rest_is_no_record():
    t, random = np.arange(2000), np.random.default_rng(1)
    noise = random.normal(0.0, 0.01, len(t))
    assert moves(np.sin(0.1 * t) + noise, 0.01)
    assert not moves(np.where(t < 700, np.sin(0.1 * t), 0.0) + noise, 0.01)


@pytest.mark.parametrize(("hysteresis", "follows"), [(0.0, True), (0.1, False)])
def test_a_relay_with_hysteresis_does_not_follow_the_noise(hysteresis, follows):
    rig = Rig(K_L, OMEGA_N, ZETA, {"coulomb_friction": {"level": 2.0 * K_L * OMEGA_N**2 / 100.0}})
    t, noise = np.arange(0.0, 2.0, 1e-3), np.random.default_rng(1).normal(0.0, 0.02, 2000)
    drive = Drive(RELAY, np.zeros(len(t)), (0.2, 0.0, 0.0, 0.0, hysteresis))
    (_, quiet), (_, u) = simulate(rig, t, drive), simulate(rig, t, drive, noise)
    assert chatters(u, quiet) == follows


@pytest.mark.parametrize(
    "effects",
    [{"coulomb_friction": {"level": 1500.0}}, {"stribeck_friction": {"level": 1500.0, "speed": 8.0}}],
    ids=["coulomb", "stribeck"],
)
def test_where_friction_sticks_does_not_depend_on_the_step(monkeypatch, effects):
    t, rig = np.arange(0.0, 2.0, 5e-4), Rig(28.5, 115.0, 0.28, effects)
    _, u = simulate(rig, t, Drive(RELAY, np.zeros(len(t)), (0.7, 0.0, 0.0, 0.0, 0.01)))
    y, _ = simulate(rig, t, Drive(GIVEN, u))
    assert np.count_nonzero(np.diff(y) == 0.0) > 10
    monkeypatch.setattr(hidden_rig, "LONGEST", hidden_rig.LONGEST / 10.0)
    assert apart(y, simulate(rig, t, Drive(GIVEN, u))[0]) < 1e-4


def test_bristles_under_a_load_that_slides_fast_do_not_depend_on_the_step(monkeypatch):
    bristles = {"coulomb_friction": {"level": 0.9}, "lugre_friction": {"stiffness": 3.4e4, "damping": 92.0}}
    t, rig = np.arange(0.0, 2.0, 5e-4), Rig(16.0, 222.0, 0.56, bristles)
    drive = Drive(GIVEN, 0.48 * np.sin(4.0 * t))
    y, _ = simulate(rig, t, drive)
    monkeypatch.setattr(hidden_rig, "LONGEST", hidden_rig.LONGEST / 20.0)
    assert apart(y, simulate(rig, t, drive)[0]) < 1e-4


@pytest.mark.parametrize(
    ("cause", "values", "least", "most"),
    [("valve_lag", {"time": 4e-3}, 0.0, 0.1), ("backlash", {"gap": 0.1}, 0.2, 1.0)],
    ids=["imitated", "not imitated"],
)
def test_what_a_sensors_lag_takes_up_beside_it_does_not_count(cause, values, least, most):
    t = np.arange(0.0, 2.0, 1e-3)
    u = np.repeat(np.random.default_rng(4).choice([-1.0, 1.0], 40), 50)
    rig = Rig(17.0, 60.0, 0.5, {cause: values, "sensor_lag": {"time": 4e-3}})
    y, _ = simulate(rig, t, Drive(GIVEN, u))
    alone = best_baseline(y, u, 1e-3, (17.0, 60.0, 0.5)).rms
    assert least <= left_beside(rig, cause, y, u, t) / alone <= most


@pytest.mark.parametrize(
    ("effects", "least", "most"),
    [({"coulomb_friction": {"level": 100.0}}, 0.0, 0.2), ({"relief": {"strength": 400.0}}, 0.2, 1.0)],
    ids=["listed", "not listed"],
)
def test_what_the_list_can_imitate_does_not_count(effects, least, most):
    t = np.arange(0.0, 1.0, 2e-3)
    u = np.repeat(np.random.default_rng(4).choice([-1.0, 1.0], 20), 25)
    rig = Rig(17.0, 60.0, 0.5, effects)
    y, _ = simulate(rig, t, Drive(GIVEN, u))
    alone = best_baseline(y, u, 2e-3, (17.0, 60.0, 0.5)).rms
    assert least <= left_by_list(rig, known(LISTED_SINCE[SLEW]), y, u, t) / alone <= most


def test_a_relief_valve_holds_the_pressure():
    rig = Rig(17.0, 60.0, 0.5, {"relief": {"strength": 400.0}})
    y, _ = simulate(rig, T, Drive(GIVEN, U))
    free, _ = simulate(Rig(17.0, 60.0, 0.5, {}), T, Drive(GIVEN, U))

    def strongest(y):
        return np.max(np.abs(np.diff(y, 2))) / (T[1] - T[0]) ** 2

    assert strongest(free) > 600.0
    assert 400.0 < strongest(y) < 440.0


def test_records_of_numbers_before_it_was_listed_hide_a_slow_valve_as_one_cause():
    case = draw(16847, duration=2.0)
    assert (case.kind, case.causes) == ("one", ("valve_rate_limit",))


def test_what_a_relay_cannot_see_is_not_hidden_under_it():
    with pytest.raises(Invisible, match="valve_deadband"):
        draw(5, "one", ("valve_deadband",), "relay", sees_speed=False, duration=1.0)


def test_a_number_makes_the_same_case_each_time(tmp_path):
    first, again = draw(21, duration=2.0), draw(21, duration=2.0)
    assert first == again
    for name, case in (("a", first), ("b", again)):
        write(make_record(case), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("cause", DEFECTS)
def test_the_file_holds_the_record_with_its_defects(tmp_path, cause):
    case = draw(7, "one", (cause,), "relay", sees_speed=True, duration=2.0)
    record = make_record(case)
    write(record, tmp_path / "run.csv")
    back = read(tmp_path / "run.csv")
    np.testing.assert_allclose(back.y, record.y, rtol=1e-8)
    assert np.isnan(back.y).any() == (cause == "missing_samples")
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert json.dumps(case.causes) not in header
    assert set(header.split(",")) <= {"t", "u", "y", "t_u", "ps"}


def test_hardly_a_sample_is_taken_after_the_command_that_follows_from_it():
    """Else the command leaves later than the record says, which then has a second defect."""
    case = draw(7, "one", ("timing_jitter",), "relay", duration=2.0)
    worst = replace(case, duration=20.0, defects={"jitter": MOST_JITTER * case.tick})
    assert np.mean(seen_at(worst) > worst.t + worst.latency) < 0.005
    assert np.std(seen_at(worst) - worst.t) > 0.2 * worst.tick
