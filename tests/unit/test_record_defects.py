"""Defects of recordings are found, with their numbers, and sound records have none."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seod.data import Recording
from seod.data.problems import Problem
from seod.diagnose.record.column_checks import (
    gain_remarks,
    tells_supply,
    time_remarks,
    with_believed_supply,
)
from seod.diagnose.record.defects import examine
from seod.diagnose.record.fourth_differences import slopes
from seod.diagnose.record.sensor_step import counts
from seod.diagnose.record.timing_jitter import _line
from sim.defects import jittered, missing_samples, outliers

NOISE = 0.01
T = np.arange(8000) * 1e-3


def movement(t):
    return np.sin(9.0 * t) + 0.3 * np.sin(41.0 * t + 1.0)


def recording(y, t=T, u=None):
    rows = np.arange(1, len(t) + 1)
    u = np.sign(np.cos(9.0 * t)) if u is None else u
    return Recording((Path("run.csv"),), t, u, y, None, None, None, rows, {}, {}, ())


def noisy(seed=1, t=T):
    return movement(t) + np.random.default_rng(seed).normal(0.0, NOISE, len(t))


def inside(parameter, value):
    return parameter.ci95[0] <= value <= parameter.ci95[1]


def only(found):
    assert len(found.found) == 1, found.found
    return found.found[0]


@pytest.mark.parametrize("seed", range(5))
def test_a_sound_record_has_no_defects(seed):
    found = examine(recording(noisy(seed)))
    assert (found.found, found.step, found.remarks) == ((), 0.0, ())
    assert not found.bad.any()


def test_outliers_are_counted_and_measured():
    off = outliers(len(T), 0.01, 0.3, np.random.default_rng(3))
    found = examine(recording(noisy() + off))
    defect = only(found)
    assert defect.name == "outliers"
    assert inside(defect.parameters["rate"], 0.01)
    assert inside(defect.parameters["size"], 0.3)
    large = np.abs(off) > 15.0 * NOISE
    assert found.bad[large].mean() > 0.9
    assert not found.bad[off == 0.0].any()


def test_corners_and_jumps_of_the_signal_are_no_outliers():
    corners = np.abs(np.sin(9.0 * T)) * 4.0
    jumps = np.floor(T * 3.0) % 2
    found = examine(recording(noisy() + corners + jumps))
    assert not found.bad.any()
    assert found.found == ()


def test_the_sharp_corners_of_a_speed_that_friction_turns_are_no_outliers():
    turns = 24.0 * NOISE * np.cumsum(np.cumsum(np.abs(np.diff(np.floor(T * 17.3), prepend=0.0))))
    found = examine(recording(noisy() + turns - np.polyval(np.polyfit(T, turns, 2), T)))
    assert not found.bad.any()
    assert found.found == ()


def test_a_curved_speed_that_friction_turns_has_no_outliers():
    """At each corner the curve before it or behind it makes the corner look less of one."""
    speed = movement(6.0 * T)
    noise = np.random.default_rng(1).normal(0.0, 0.1 * NOISE, len(T))
    found = examine(recording(speed + 0.4 * np.abs(speed) + noise))
    assert not found.bad.any()
    assert found.found == ()


@pytest.mark.parametrize("gap", [1, 2, 3, 4])
def test_two_outliers_near_each_other_are_both_left_out(gap):
    """Neither leaves the pattern of one."""
    off = outliers(len(T), 0.01, 0.3, np.random.default_rng(3))
    off[[1000, 1000 + gap, 5000, 5000 + gap]] = 0.5, -0.4, 0.3, 0.35
    off[[k + j for k in (1000, 5000) for j in range(-9, 10) if j not in (0, gap)]] = 0.0
    found = examine(recording(noisy() + off))
    defect = only(found)
    assert found.bad[[1000, 1000 + gap, 5000, 5000 + gap]].all()
    assert not found.bad[off == 0.0].any()
    assert inside(defect.parameters["rate"], 0.01)
    assert inside(defect.parameters["size"], 0.3)


def test_few_readings_have_no_neighbours_that_tell_an_outlier_from_a_bend():
    y = noisy()[:18]
    y[[5, 11, 14]] += 1.0, -1.2, 1.1
    assert not examine(recording(y, T[:18])).bad[[0, 1, 8, 17]].any()


@pytest.mark.parametrize("hole", [0.01, 1.0, 100.0])
def test_neighbours_behind_a_hole_of_any_length_are_no_error(hole):
    off = outliers(len(T), 0.01, 0.3, np.random.default_rng(3))
    t = np.where(np.arange(len(T)) < 3000, T, T + hole)
    off[2990:3010] = 0.0
    off[[2997, 2999, 3001]] = 0.5, -0.4, 0.6
    assert [each.name for each in examine(recording(noisy() + off, t)).found][-1:] == ["outliers"]


@pytest.mark.parametrize("rows_are_there", [True, False], ids=["empty readings", "no rows"])
def test_missing_samples_are_counted(rows_are_there):
    gone = missing_samples(len(T), 0.03, 4.0, np.random.default_rng(2))
    y = noisy()
    record = recording(np.where(gone, np.nan, y)) if rows_are_there else recording(y[~gone], T[~gone])
    defect = only(examine(record))
    assert defect.name == "missing_samples"
    assert inside(defect.parameters["rate"], 0.03)
    assert inside(defect.parameters["length"], 4.0)
    assert defect.parameters["rate"].value == pytest.approx(gone.mean(), rel=0.02)


def test_one_gap_is_told_with_what_little_it_says():
    y = noisy()
    y[1000:1030] = np.nan
    defect = only(examine(recording(y)))
    assert defect.name == "missing_samples"
    assert defect.parameters["length"].value == 30.0
    assert inside(defect.parameters["rate"], 4.0 * 30.0 / len(T))
    assert inside(defect.parameters["rate"], 0.25 * 30.0 / len(T))


def test_a_single_lost_sample_is_passed_over():
    y = noisy()
    y[1000] = np.nan
    assert examine(recording(y)).found == ()


@pytest.mark.parametrize("seed", range(4))
def test_timing_jitter_is_told_from_noise_by_the_slope(seed):
    taken = jittered(T, 3e-3 / 12.0, np.random.default_rng(seed + 50))
    y = movement(6.0 * taken) + np.random.default_rng(seed).normal(0.0, NOISE / 3.0, len(T))
    defect = only(examine(recording(y)))
    assert defect.name == "timing_jitter"
    assert defect.parameters["deviation"].value == pytest.approx(2.5e-4, rel=0.05)
    assert defect.p_value < 1e-6


@pytest.mark.parametrize(("deviation", "names"), [(4e-4, ["timing_jitter"]), (6e-4, [])])
def test_samples_that_would_change_places_are_not_late(deviation, names):
    """A noise that grows with the slope, as much as times off by 0.4 and by 0.6 intervals would make."""
    random = np.random.default_rng(52)
    late = deviation * np.gradient(movement(6.0 * T), T) * random.normal(size=len(T))
    found = examine(recording(movement(6.0 * T) + late + 0.1 * NOISE * random.normal(size=len(T))))
    assert [each.name for each in found.found] == names


def late_samples(random):
    """Readings of late samples, and what the load does at the times that they tell."""
    taken = jittered(T, 2.5e-4, random)
    return movement(6.0 * taken) + noisy(1) - movement(T), movement(6.0 * T)


@pytest.mark.parametrize("slow", [0.0, 40.0 * NOISE])
def test_a_model_that_follows_late_samples_takes_the_jitter_back(slow):
    """Whatever else it leaves: a slow error is none of single samples."""
    y, moves = late_samples(np.random.default_rng(50))
    off = slow * np.sin(T)
    found = examine(recording(y))
    assert [each.name for each in found.confirmed(T, y, moves + off)] == ["timing_jitter"]
    follows = y - noisy(1) + movement(T)
    assert found.confirmed(T, y, follows + off) == ()
    some = np.where(0.5 * T[-1] > T, follows, np.nan)
    assert found.confirmed(T, y, some + off) == (), "of half of the rows"


@pytest.mark.parametrize("simulated", [np.nan, np.inf, 1e200])
def test_a_model_that_was_not_asked_or_ran_away_takes_nothing_back(simulated):
    y, _ = late_samples(np.random.default_rng(50))
    found = examine(recording(y))
    assert found.confirmed(T, y, np.full(len(T), simulated)) == found.found != ()


@pytest.mark.parametrize("slow", [0.0, 40.0 * NOISE])
def test_a_model_that_moves_as_outliers_do_takes_them_back(slow):
    off = outliers(len(T), 0.01, 0.3, np.random.default_rng(3))
    y = noisy() + off
    found = examine(recording(y))
    assert len(found.off)
    assert np.array_equal(found.readings, y[found.off])
    believed = y.copy()
    believed[found.off] = np.nan
    wrong = slow * np.sin(T)
    assert [each.name for each in found.confirmed(T, believed, movement(T) + wrong)] == ["outliers"]
    assert found.confirmed(T, believed, movement(T) + off + wrong) == ()


def test_each_defect_is_asked_of_what_a_model_leaves_by_itself():
    late, moves = late_samples(np.random.default_rng(50))
    y = late + outliers(len(T), 0.01, 0.3, np.random.default_rng(3))
    found = examine(recording(y))
    believed = y.copy()
    believed[found.off] = np.nan
    follows = late - noisy(1) + movement(T)
    assert {each.name for each in found.confirmed(T, believed, moves)} == {"outliers", "timing_jitter"}
    assert [each.name for each in found.confirmed(T, believed, follows)] == ["outliers"]
    assert [each.name for each in found.confirmed(T, believed, moves + y - late)] == ["timing_jitter"]


@pytest.mark.parametrize("value", [1e300, -1e300, 1e40])
def test_one_reading_beyond_all_bounds_is_left_out(value):
    y = noisy()
    y[4000] = value
    found = examine(recording(y))
    assert found.bad.tolist() == (np.arange(len(y)) == 4000).tolist()


def test_a_quick_signal_with_little_noise_has_no_jitter():
    burst = np.maximum(np.sin(2.0 * T), 0.0) ** 2 * np.sin(400.0 * T)
    found = examine(recording(burst + 0.1 * noisy()))
    assert "timing_jitter" not in [each.name for each in found.found]


def test_of_differences_most_of_which_are_none_no_line_is_made():
    """Of readings that stand still in most rows, and jump."""
    steepness = np.linspace(0.0, 50.0, 1000)
    level, growth, _ = _line(steepness, np.where(np.arange(1000) % 3, 0.0, 1e-9 * steepness))
    assert (level, growth) == (0.0, 0.0)


def test_true_times_that_are_uneven_are_no_jitter():
    t = np.sort(T + np.random.default_rng(1).normal(0.0, 2e-4, len(T)))
    t = t[np.concatenate([[True], np.diff(t) > 2e-4])]
    assert [
        each.name for each in examine(recording(noisy(2, t), t)).found if each.name == "timing_jitter"
    ] == []


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(step=st.floats(0.03, 0.3), offset=st.floats(-1.0, 1.0), before=st.booleans())
def test_counts_are_found_before_or_after_noise(step, offset, before):
    random = np.random.default_rng(5)
    noise = random.normal(0.0, 0.1 * step, len(T))
    y = movement(T) + (noise if before else 0.0)
    y = np.floor(y / step + 0.5) * step + offset + (0.0 if before else noise)
    found = counts(y, 0.1 * step)
    assert found.step == pytest.approx(step, abs=max(4.0 * found.sd, 1e-9))
    assert found.sd < 0.01 * step


@pytest.mark.parametrize("step", [0.05, 0.0613, 0.0777])
def test_a_step_behind_a_converter_is_as_sure_as_its_levels_lie_in_line(step):
    """The converter rounds each level to its own, finer step."""
    finer = 0.00137
    y = finer * np.round(step * np.round(movement(T) / step) / finer)
    found = counts(y, 0.0)
    assert abs(found.step - step) < 3.0 * found.sd
    assert found.sd < 0.01 * step


def test_a_steep_ripple_gathers_readings_but_is_no_step_of_a_sensor():
    load = 3.0 * movement(T)
    y = load + 0.17 * np.sin(11.0 * load) + np.random.default_rng(1).normal(0.0, 0.2 * NOISE, len(T))
    assert np.abs(np.mean(np.exp(11.0j * y))) > 0.5  # they do gather
    assert counts(y, 0.2 * NOISE).step == 0.0


def test_no_counts_where_the_load_moves_as_far_from_row_to_row():
    """There and back at one speed, as under a square wave: at each row it is where it had been before."""
    way = 8.0 * NOISE * np.abs(np.arange(8000) % 1000 - 500)
    y = way + np.random.default_rng(3).normal(0.0, NOISE, 8000)
    assert counts(y, NOISE).step == 0.0


def test_no_counts_where_the_load_rests_for_long():
    y = np.where(T < 6.0, 0.3, movement(T)) + np.random.default_rng(1).normal(0.0, NOISE, len(T))
    assert counts(y, NOISE).step == 0.0


def test_a_clipped_sensor_is_told_and_its_rows_left_out():
    y = np.minimum(noisy(), 0.8)
    found = examine(recording(y))
    assert "stands at 0.8" in found.remarks[0]
    assert found.bad[y == 0.8].mean() > 0.95
    assert not found.bad[y < 0.8].any()


@pytest.mark.parametrize(
    ("u", "y", "words"),
    [
        (None, 3.0 * T, "straight line over t"),
        (movement(T), 2.0 * movement(T), "another scale"),
        (noisy(), np.sign(np.cos(9.0 * T)), "exchanged"),
    ],
)
def test_wrong_columns_are_named(u, y, words):
    (remark,) = examine(recording(y, u=u)).remarks
    assert remark.startswith("run.csv: ")
    assert words in remark
    assert "--columns" in remark


def test_a_record_of_noise_alone_is_told():
    (remark,) = examine(recording(np.random.default_rng(1).normal(0.0, NOISE, len(T)))).remarks
    assert "mostly noise" in remark


def test_times_in_milliseconds_are_suspected():
    slow = recording(noisy(), 1000.0 * T)
    assert "--units t=ms" in examine(slow).remarks[0]
    doubted = Problem("unit", Path("run.csv"), "t", np.array([], np.int64), "has no unit")
    assert not [each for each in examine(replace(slow, problems=(doubted,))).remarks if "ms?" in each]


def test_times_that_are_told_to_be_in_seconds_are_believed():
    assert not examine(replace(recording(noisy(), 1000.0 * T), read_in={"t": "s"})).remarks


@pytest.mark.parametrize(
    ("omega_n", "told"),
    [
        (0.06, "omega_n is 0.06 rad/s. If it is in ms, omega_n is 60 rad/s: `--units t=ms`"),
        (6e-5, "If it is in us, omega_n is 60 rad/s: `--units t=us`"),
        (1e-9, "`--units t=us`"),
    ],
)
def test_times_without_a_unit_are_suspected_where_the_plant_is_slow(omega_n, told):
    one = recording(noisy())
    (remark,) = time_remarks(one, omega_n)
    assert told in remark
    assert not time_remarks(replace(one, read_in={"t": "s"}), omega_n)
    assert not time_remarks(recording(noisy(), 1000.0 * T), omega_n)  # by the rate
    doubted = Problem("unit", Path("run.csv"), "t", np.array([], np.int64), "has no unit")
    assert not time_remarks(replace(one, problems=(doubted,)), omega_n)


def test_a_plant_of_usual_speed_says_nothing_of_times():
    assert not time_remarks(recording(noisy()), 0.6)
    assert not time_remarks(recording(noisy()), float("nan"))


@pytest.mark.parametrize(
    ("K_L", "expected", "words"),
    [
        (-17.0, 17.0, "sign of u or of y"),
        (17.0 * 57.3, 17.0, "degrees for radians"),
        (17.0 / 57.3, 17.0, "radians for degrees"),
        (17e3, 17.0, "thousandths"),
        (17.0 * 9.55, 17.0, "turns a minute"),
    ],
)
def test_sign_and_unit_are_seen_in_the_gain(K_L, expected, words):
    (remark,) = gain_remarks("run.csv", K_L, expected)
    assert words in remark


@pytest.mark.parametrize(
    ("ps", "told"),
    [
        (np.zeros(len(T)), "never above 0"),
        (np.full(len(T), -2.5e6), "never above 0"),
        (np.where(T < 1.0, 7e6, 0.0), "seldom above 0"),
        (np.where(T < 1.0, 0.0, 7e6), ""),
        (np.where(T < 1.0, np.nan, 7e6), ""),
    ],
    ids=["unplugged", "below its range", "mostly", "switched on late", "known late"],
)
def test_a_supply_pressure_that_is_none_is_told_and_not_used(ps, told):
    one = replace(recording(noisy()), ps=ps, names={"ps": "p_s [bar]"})
    kept, said = with_believed_supply(one)
    assert tells_supply(one) == (not told)
    assert (kept.ps is None) == bool(said) == bool(told)
    assert all(f"run.csv: column 'p_s [bar]', the supply pressure ps, is {told}" in each for each in said)
    assert all("--columns ps=" in each for each in said)


def test_an_empty_supply_pressure_is_none():
    kept, said = with_believed_supply(replace(recording(noisy()), ps=np.full(len(T), np.nan)))
    assert (kept.ps, said) == (None, ())


@pytest.mark.parametrize("K_L", [17.0, 10.0, 40.0])
def test_a_gain_of_the_right_size_says_nothing(K_L):
    assert gain_remarks("run.csv", K_L, 17.0) == []
    assert gain_remarks("run.csv", K_L) == []


def test_slopes_are_those_of_the_cubic_through_the_neighbours():
    t = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 200))
    np.testing.assert_allclose(slopes(t, 3.0 + 2.0 * t - 5.0 * t**3), 2.0 - 15.0 * t**2, rtol=1e-5, atol=1e-5)
    assert math.isfinite(slopes(t, np.ones_like(t)).sum())
