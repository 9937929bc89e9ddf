"""Records of rough rigs: the numbers to be found are those of the file."""

from __future__ import annotations

import math
from dataclasses import replace

import hidden_cases
import hidden_rough
import numpy as np
import pytest
from hidden_cases import (
    A_TURN_SINCE,
    MOST_TURNS,
    OPEN,
    SENSORS_SINCE,
    Case,
    Invisible,
    _fair,
    channel_of,
    draw,
    run,
    turns,
)
from hidden_drives import multisine
from hidden_records import make_record, write
from hidden_rig import Rig
from hidden_rough import (
    MILD_SINCE,
    SAMPLERS,
    TOLD_SINCE,
    Rough,
    _mains,
    dimension,
    make_rough_record,
    rough,
    sampled,
    sampler_leaves,
)
from hidden_score import outcome
from hidden_strength import ALONE
from hidden_truth import told_by_rough_file
from kernel_cases import apart
from plant_truth import Plant
from truth_runs import follow

from seod.data import read

QUIET = Rough(0.0, 0.0, 0.0, 0.0, 50.0, 0, time=7.0, length=0.02, sign=1.0, volt=40.0)


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("unit/s^2", (1, -2)),
        ("rad/unit", (-1, 0)),
        ("V/s", (0, -1)),
        ("1", (0, 0)),
        ("s", (0, 1)),
        ("1/s^2", (0, -2)),
        ("unit/s^2 for each unit of f", (1, -2)),
    ],
)
def test_units_are_taken_apart(unit, powers):
    assert dimension(unit, sees_speed=False) == powers


def test_a_step_of_a_speed_is_one():
    assert dimension("unit (unit/s for a speed)", sees_speed=True) == (1, -1)
    assert dimension("unit (unit/s for a speed)", sees_speed=False) == (1, 0)


@pytest.mark.parametrize("sees_speed", [False, True])
@pytest.mark.parametrize(
    "cause",
    ["coulomb_friction", "asymmetric_gain", "load_bias", "valve_rate_limit", "valve_deadband", "backlash"],
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


# Mains, commands through a sampler, and causes that are hidden alone


def bare(excitation="multisine", *, sees_speed=False, duration=1.5):
    """A plant without effects, its record without noise."""
    rig = Rig(12.0, 90.0, 0.3, {}, sees_speed)
    return Case(SENSORS_SINCE, "clean", (), excitation, rig, 1e-3, duration, 1.0, 0.01, 0.0)


def through(sampler, count, late=0):
    return replace(QUIET, time=1.0, length=1.0, sampler=sampler, sampled=count, late=late)


def silent(case):
    return np.zeros(len(case.t))


def test_records_of_lower_numbers_have_neither_mains_nor_a_sampler():
    assert not any(rough(replace(bare(), number=number)).mains for number in range(40))
    assert {rough(replace(bare(), number=number)).sampler for number in range(40)} == {"none"}
    later = [rough(replace(bare(), number=SENSORS_SINCE + number)) for number in range(40)]
    assert {each.sampler for each in later} == set(SAMPLERS)
    assert 5 < sum(each.mains > 0.0 for each in later) < 30
    assert all((each.leaves > 0.0) == (each.sampler != "none") for each in later)
    assert all(0 < each.late <= each.sampled for each in later if each.sampler == "late")


def test_from_a_number_on_commands_have_any_unit():
    case = draw(40, "clean", (), "multisine", False, duration=3.0)
    units = [rough(replace(case, number=number)).volt for number in range(133980, 134020)]
    assert set(units[:20]) == {1.0}
    assert min(units[20:]) < 2.0 < 1000.0 < max(units[20:])


def test_from_a_number_on_no_sampler_loses_more_than_the_noise():
    def each(since):
        drives = ("two-phase", "operation")
        return [rough(replace(bare(drive), number=since + k)) for k in range(15) for drive in drives]

    assert max(one.leaves for one in each(SENSORS_SINCE)) > 2.0 * bare().noise_part
    later = each(MILD_SINCE)
    assert max(one.leaves for one in later) <= bare().noise_part
    assert {one.sampler for one in later} > {"none"}
    assert all((one.leaves > 0.0) == (one.sampler != "none") for one in later)


def test_from_a_number_on_a_file_that_tells_when_commands_were_given_has_no_sampler():
    def samplers(latency):
        return {rough(replace(bare(), number=TOLD_SINCE + k, latency=latency)).sampler for k in range(20)}

    assert samplers(3e-4) == {"none"}
    assert samplers(0.0) > {"none"}


def test_what_is_drawn_besides_leaves_the_rest_as_it_was():
    case = replace(bare(), number=SENSORS_SINCE + 3)
    before, after = rough(replace(case, number=case.number)), rough(case)
    names = ("colour", "hum", "wander", "gusts", "hum_hz", "bits", "time", "length", "sign")
    random = np.random.default_rng([case.number, 9])
    assert [getattr(before, name) for name in names] == [getattr(after, name) for name in names]
    parts = random.dirichlet([1.0, 1.0, 1.0, 1.0]) * (random.random(4) < (1.0, 0.4, 0.4, 0.4))
    assert after.hum == parts[1] / parts.sum()


@pytest.mark.parametrize("time", [1.0, 0.3, 37.0], ids=["1 kHz", "3.3 kHz", "27 Hz"])
def test_mains_hum_at_50_hz_of_the_files_clock(time):
    case = bare(duration=4.0)
    wave = _mains(case, replace(QUIET, time=time))

    def left(hz):
        turns = 2.0 * math.pi * hz * time * case.t
        lines = np.column_stack([f(k * turns) for k in (1, 2, 3) for f in (np.sin, np.cos)])
        return float(np.std(wave - lines @ np.linalg.lstsq(lines, wave, rcond=None)[0]))

    assert left(50.0) < 1e-6
    assert left(50.0 + 2.0 / (4.0 * time)) > 0.5
    assert np.std(wave) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("number", range(40, 44))
def test_with_mains_the_disturbance_is_as_large(number):
    case = draw(number, "clean", (), "multisine", False, duration=12.0)
    how = replace(rough(case), bits=0, time=1.0, length=1.0, sign=1.0, mains=0.5, gusts=0.0)
    disturbed = make_rough_record(case, how).y - make_record(replace(case, noise=0.0)).y
    assert 0.5 * case.noise < float(np.std(disturbed)) < 2.0 * case.noise
    spectrum = np.abs(np.fft.rfft(disturbed * np.hanning(len(disturbed)))) ** 2
    hz = np.fft.rfftfreq(len(disturbed), case.tick)
    assert spectrum[np.abs(hz - 50.0) < 0.5].sum() > 0.15 * spectrum[1:].sum()


@pytest.mark.parametrize("sees_speed", [False, True])
@pytest.mark.parametrize(("sampler", "late"), [("finer", 0), ("late", 3), ("late", 4)])
def test_a_command_between_rows_moves_the_plant_and_the_record_has_samples_of_it(sampler, late, sees_speed):
    case, parts = bare(sees_speed=sees_speed, duration=0.4), 4
    y, u = sampled(case, through(sampler, parts, late), silent(case))
    t = np.arange(len(case.t) * parts) * case.tick / parts
    command = multisine(t, case.volts, case.rig.omega_n, np.random.default_rng([case.number, 1]))
    rows = np.arange(len(case.t)) * parts
    np.testing.assert_array_equal(u, command[np.maximum(rows - late, 0)])
    rig = case.rig
    plant = Plant(rig.K_L, rig.omega_n, rig.zeta, {}, sees_speed=sees_speed)
    assert apart(y, follow(plant, t, command, case.t)) < 1e-3
    held = Plant(rig.K_L, rig.omega_n, rig.zeta, {}, sees_speed=sees_speed)
    assert apart(y, follow(held, case.t, u, case.t)) > 5e-3


def test_a_relay_between_rows_switches_where_no_row_is():
    case = bare("relay", duration=1.0)
    y, u = sampled(case, through("finer", 8), silent(case))
    rows = np.flatnonzero(np.diff(u)) + 1
    assert len(rows) > 8
    late = y[rows] / (y[rows] - y[rows - 1])  # where zero was crossed, as a part of the row
    assert np.ptp(late) > 0.5
    assert set(np.unique(u)) == {-1.0, 1.0}


def test_a_command_that_is_seldom_looked_at_stands_still_between():
    case = bare("steps")
    y, u = run(case)
    seen, looked = sampled(case, through("slower", 3), silent(case))
    np.testing.assert_array_equal(seen, y)
    np.testing.assert_array_equal(looked, np.repeat(u[::3], 3)[: len(u)])
    assert not np.array_equal(looked, u)


def test_pressures_and_pushes_come_with_their_rows_also_between_them():
    effects = {"measured_disturbance": {"gain": 400.0}}
    rig = Rig(12.0, 90.0, 0.3, effects)
    case = Case(SENSORS_SINCE, "one", tuple(effects), "multisine", rig, 1e-3, 1.0, 1e-9, 0.01, 0.0)
    plain, _ = sampled(case, through("none", 1), silent(case))
    finer, _ = sampled(case, through("finer", 4), silent(case))
    assert apart(finer, plain) < 1e-3
    assert np.ptp(plain) > 1e-2


def test_a_sampler_leaves_the_more_the_less_it_looks():
    case = bare(duration=4.0)
    few = [sampler_leaves(case, through("slower", count)) for count in (2, 3, 4)]
    assert 0.0 < few[0] < few[1] < few[2]
    assert sampler_leaves(case, through("late", 4, 4)) > sampler_leaves(case, through("late", 4, 1)) > 0.0
    assert sampler_leaves(case, through("none", 1)) < 1e-3


def effect(name):
    return {"name": name, "parameters": {}, "indistinguishable_from": []}


@pytest.mark.parametrize(
    ("kind", "causes", "verdict", "named", "leaves", "mains", "expected"),
    [
        ("one", ("backlash",), "unexplained", ["backlash"], 0.03, 0.0, "exact"),
        ("one", ("backlash",), "unexplained", ["backlash"], 0.01, 0.0, "wrong"),
        ("one", ("backlash",), "unexplained", ["valve_lag"], 0.03, 0.0, "wrong"),
        ("clean", (), "unexplained", [], 0.03, 0.0, "exact"),
        ("clean", (), "effects", ["valve_lag"], 0.03, 0.0, "wrong"),
        ("unlisted", ("drag",), "unexplained", [], 0.03, 0.0, "exact"),
        ("unlisted", ("drag",), "clean", [], 0.03, 0.0, "wrong"),
        ("clean", (), "effects", ["periodic_disturbance"], 0.0, 0.3, "exact"),
        ("clean", (), "effects", ["periodic_disturbance"], 0.0, 0.0, "wrong"),
    ],
)
def test_what_a_sampler_leaves_may_be_unexplained(kind, causes, verdict, named, leaves, mains, expected):
    how = replace(QUIET, sampler="late", leaves=leaves, mains=mains)
    judged = how.forgiven(causes, {"verdict": verdict, "effects": [effect(each) for each in named]})
    assert outcome(kind, causes, judged) == expected


def test_a_hum_that_is_told_to_be_as_good_as_what_is_hidden_counts():
    how = replace(QUIET, mains=0.3)
    named = effect("periodic_disturbance") | {"indistinguishable_from": ["load_resonance"]}
    told = {"verdict": "effects", "effects": [named]}
    assert outcome("one", ("load_resonance",), how.forgiven(("load_resonance",), told)) == "within"
    assert outcome("one", ("backlash",), how.forgiven(("backlash",), told)) == "wrong"
    assert outcome("clean", (), how.forgiven((), told)) == "exact"


def test_a_delay_is_not_counted_where_a_sampler_has_one_of_its_own():
    rig = Rig(12.0, 90.0, 0.3, {"transport_delay": {"time": 2e-3}, "valve_lag": {"time": 1e-3}})
    case = replace(bare(), rig=rig)
    assert set(told_by_rough_file(case, through("finer", 4))) == {"valve_lag"}
    assert set(told_by_rough_file(case, through("none", 1))) == {"transport_delay", "valve_lag"}


def test_readings_that_repeat_do_so_on_a_clock_of_the_files_seconds():
    case = draw(SENSORS_SINCE + 1, "one", ("held_readings",), "multisine", duration=4.0)
    how = replace(rough(case), bits=0, gusts=0.0)
    record, time = make_rough_record(case, how), told_by_rough_file(case, how)["held_readings"]["time"]
    assert time > 1.2 * case.tick * how.time
    fresh = np.flatnonzero(np.diff(record.y)) + 1
    since = record.t[fresh] - record.t[0]
    late = since - time * np.floor(since / time + 1e-6)
    assert len(fresh) == pytest.approx(case.duration * how.time / time, rel=0.02)
    assert np.max(late) < 1.001 * case.tick * how.time


@pytest.mark.parametrize("sees_speed", [False, True])
def test_a_sensor_without_sign_is_hidden_where_no_loop_is_closed(sees_speed):
    case = draw(SENSORS_SINCE + 2, "one", ("rectified_sensor",), None, sees_speed, duration=3.0)
    assert case.excitation in OPEN
    assert make_record(replace(case, noise=0.0)).y.min() >= 0.0
    with pytest.raises(Invisible, match="no loop can be closed"):
        draw(SENSORS_SINCE + 2, "one", ("rectified_sensor",), "relay", sees_speed)


def test_a_measured_disturbance_comes_with_its_channel(tmp_path):
    case = draw(SENSORS_SINCE + 3, "one", ("measured_disturbance",), "multisine", duration=3.0)
    record = make_rough_record(case, replace(rough(case), bits=0))
    np.testing.assert_array_equal(record.f, channel_of(case))
    assert np.std(record.f) == pytest.approx(1.0, abs=0.4)
    write(record, tmp_path / "run.csv")
    np.testing.assert_allclose(read(tmp_path / "run.csv").f, record.f, rtol=1e-8)
    assert make_record(draw(5, "clean", (), "steps", duration=1.0)).f is None


def test_what_is_hidden_alone_is_drawn_and_never_beside_another():
    from hidden_cases import _causes

    random = np.random.default_rng(1)
    assert set(ALONE) <= {_causes("one", random, SENSORS_SINCE)[0] for _ in range(400)}
    assert not set(ALONE) & {_causes("one", random, SENSORS_SINCE - 1)[0] for _ in range(400)}
    assert not set(ALONE) & {name for _ in range(200) for name in _causes("two", random, SENSORS_SINCE)}
    with pytest.raises(Invisible, match="hidden alone"):
        draw(SENSORS_SINCE, "two", ("held_readings", "backlash"))


def test_from_a_number_on_an_eccentric_encoder_that_turns_more_than_a_wave_is_no_curve():
    """Beside unequal gains the load runs on: what was to be a part of a turn was ten."""
    curve = {"amplitude": 0.1, "wavenumber": 3.0, "phase": 0.4}
    rig = Rig(12.0, 90.0, 0.3, {"asymmetric_gain": {"ratio": 0.3}, "sensor_nonlinearity": curve}, False)
    case = Case(A_TURN_SINCE, "two", tuple(rig.effects), "multisine", rig, 1e-3, 4.0, 1.0, 0.01, 0.0)
    waves = turns(case, run(case)[0])
    assert waves == pytest.approx(3.0 * np.ptp(run(case)[0]) / (2.0 * np.pi))
    assert waves > MOST_TURNS
    with pytest.raises(Invisible, match="ripple"):
        _fair(case)
    _fair(replace(case, number=A_TURN_SINCE - 1))


def test_torques_under_which_the_truth_has_no_end_are_left_out(monkeypatch):
    """Oil whose stiffness depends on the place was driven to where it is none: all readings were missing."""
    case = draw(40, "clean", (), "multisine", False, duration=3.0)
    how, usual = replace(rough(case), hum=0.0, wander=0.0, gusts=0.5), hidden_rough.sampled

    def without_end(shaken, how, noise):
        y, u = usual(shaken, how, noise)
        return y * (np.nan if "gusts" in shaken.rig.effects else 1.0), u

    monkeypatch.setattr(hidden_rough, "sampled", without_end)
    assert np.all(np.isfinite(make_rough_record(case, how).y))


def test_from_a_number_on_plants_are_sampled_slowly_and_quickly():
    case = draw(40, "clean", (), "multisine", False, duration=12.0)
    every = (hidden_cases._in_rows(replace(case, number=number)) for number in range(134000, 134030))
    rows = [1.0 / (each.tick * case.rig.omega_n) for each in every]
    assert 4.0 <= min(rows) < 8.0
    assert 30.0 < max(rows) <= 60.0
    fine = draw(134000, "clean", (), "multisine", False, duration=12.0)
    assert len(fine.t) <= 24000
    assert draw(133999, "clean", (), "multisine", False, duration=12.0).tick in {1e-3, 5e-4}
