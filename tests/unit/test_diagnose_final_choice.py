"""What is kept of a search: within its time, and never worse than the baseline."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_example import LEVEL, command, simulate

from seod.data import read
from seod.diagnose.fitting.held_out import HeldOut
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.command_period import command_period_s, in_step, relay_period_s
from seod.diagnose.record.series import Series
from seod.diagnose.record.windows import Cut, cut, segments
from seod.diagnose.search.budget import EFFORTS, Budget
from seod.diagnose.search.final_choice import _errors_of, above_noise, worse

T = np.arange(0.0, 25.0, 1e-3)


def series(t, y, u, period_s=1.0, window_s=2.0):
    nothing = np.empty(0)
    good = np.ones(len(t), np.bool_)
    told = 1e-3, window_s, period_s, False, 0.0, 0.0, 1e-3, 1e-3
    return Series(
        t, y, good, t, u, *[nothing] * 3, *told, t[1] - t[0], len(np.unique(u)), ((0, len(t)),), (t, u)
    )


def judged(held, whole, adequacy=50.0, names=(), sees_speed=False):
    found = SimpleNamespace(model=SimpleNamespace(names=names, sees_speed=sees_speed))
    return SimpleNamespace(
        found=found, held=SimpleNamespace(rms=held, nrmse=held, adequacy=adequacy), whole=whole
    )


def test_a_set_that_simulates_worse_than_the_baseline_is_worse():
    base = judged(0.3, 0.9)
    assert worse(judged(1.3, 0.5), base)
    assert worse(judged(0.1, 1.0), base)
    assert not worse(judged(0.1, 0.2), base)


def test_a_baseline_no_nearer_to_the_whole_than_a_mean_is_no_measure_of_it():
    """An oscillation begun anew in each window left 13 %, and over the whole recording 100 %."""
    base = judged(0.13, 1.004)
    assert not worse(judged(0.04, 1.06), base)
    assert worse(judged(0.2, 0.5), base)


@pytest.mark.parametrize(
    ("name", "sees_speed", "is_worse"),
    [
        pytest.param("position_ripple", True, False, id="nobody measures where the load is"),
        pytest.param("position_ripple", False, True, id="the readings tell it"),
        pytest.param("periodic_disturbance", True, True, id="a time is told"),
        pytest.param("coulomb_friction", True, True, id="no wave"),
    ],
)
def test_a_wave_that_loses_its_place_in_one_run_is_not_worse_for_it(name, sees_speed, is_worse):
    """A ripple left 1.8 % of windows in place of 5.7 %, and of one run under gusts as much as without."""
    own = judged(0.018, 0.0569, names=(name,), sees_speed=sees_speed)
    assert worse(own, judged(0.057, 0.0568)) is is_worse


@pytest.mark.parametrize(("sees_speed", "nearer"), [(True, "in windows"), (False, "in one run")])
def test_sets_are_compared_in_windows_alone_where_a_wave_loses_its_place_in_one_run(sees_speed, nearer):
    """A plant alone had been told, and 23 % of the movement left for noise, where 1 % is."""
    some = {
        "in windows": judged(0.137, 0.385, names=("position_ripple",), sees_speed=sees_speed),
        "in one run": judged(0.157, 0.231, sees_speed=sees_speed),
    }
    errors = _errors_of(list(some.values()))
    assert min(some, key=lambda which: errors(some[which])) == nearer


def test_of_a_coarse_sensor_only_what_lies_beyond_the_interval_of_a_reading_is_worse():
    place = 7.3 * np.sin(T)
    one = replace(series(T, np.round(place), T), slack=0.5)
    windows = Cut((one,), ((0, 0, len(T)),))
    every, nothing = np.ones(len(T), np.bool_), np.zeros((len(T), 5))
    true, near = (
        HeldOut(windows, seen, nothing, np.zeros((1, 7)), every, every)
        for seen in (place, np.where(T % 1.0 < 0.1, np.round(place) + 0.7, np.round(place)))
    )
    assert true.nrmse > near.nrmse
    assert true.rms == 0.0 < near.rms
    assert not worse(SimpleNamespace(held=true, whole=1.0), SimpleNamespace(held=near, whole=2.0))


def test_shares_are_parts_of_the_movement_where_the_baseline_errs_more_than_that():
    """A baseline that had run away by four times the movement left a disturbance a share of nothing."""
    assert above_noise(SimpleNamespace(nrmse=4.0, floor=0.01)) == pytest.approx(1.0 - 1e-4)
    assert above_noise(SimpleNamespace(nrmse=0.3, floor=0.01)) == pytest.approx(0.09 - 1e-4)
    assert above_noise(SimpleNamespace(nrmse=0.01, floor=0.02)) == 0.0


def test_drift_of_a_whole_recording_does_not_count_where_only_noise_is_left():
    assert not worse(judged(0.01, 0.03, adequacy=1.01), judged(0.3, 0.02))


def test_a_budget_is_spent_when_its_time_is_over_and_says_so_where_something_was_left_out():
    now = [5.0]
    budget = Budget(lambda: now[0], 40.0)
    now[0] = 44.0
    assert not budget.spent
    assert budget.remarks == ()
    now[0] = 46.0
    assert budget.remarks == ()
    assert budget.spent
    assert "--effort thorough" in budget.remarks[0]


def test_a_search_that_begins_anew_has_all_its_work_but_no_other_end_by_the_clock():
    now, wall = [0.0], [0.0]
    first = Budget(lambda: now[0], 40.0, safety=(lambda: wall[0], 600.0))
    now[0], wall[0] = 41.0, 400.0
    assert first.spent
    again = first.anew()
    assert not again.spent
    assert again.remarks == ()
    wall[0] = 601.0
    assert again.spent
    assert "600 s by the clock" in again.remarks[0]


def test_one_trial_has_a_part_of_it():
    now = [0.0]
    ended = Budget(lambda: now[0], 25.0).trial()
    now[0] = 0.9
    assert not ended()
    now[0] = 1.1
    assert ended()


def test_a_command_that_repeats_itself_has_a_period():
    u = np.sign(np.sin(2.0 * np.pi * T / 6.0)) + 0.3 * np.sin(2.0 * np.pi * T / 2.0)
    assert command_period_s(T, u) == pytest.approx(6.0, rel=0.002)
    assert command_period_s(T, np.sin(2.0 * np.pi * (0.2 + 0.1 * T) * T)) is None
    assert command_period_s(T, np.random.default_rng(1).standard_normal(len(T))) is None


@pytest.mark.parametrize(("order", "expected"), [(1.0, True), (3.1, True), (3.45, False), (9.0, False)])
def test_what_repeats_with_the_command_is_no_disturbance(order, expected):
    one = series(T, T, np.sign(np.sin(2.0 * np.pi * T / 6.0)))
    assert in_step(Cut((one,), ((0, 0, len(T)),)), order * 2.0 * np.pi / 6.0) is expected


def test_what_is_in_step_with_a_relay_is_its_answer_but_for_its_own_frequency():
    t = np.arange(12000) / 1000.0
    u = np.sign(np.sin(2.0 * np.pi * t / 0.0623))
    u[u == 0.0] = 1.0
    assert relay_period_s(t, u) == pytest.approx(0.0623, rel=1e-3)
    windows = Cut((series(t, np.sin(t), u),), ((0, 0, len(t)),))
    told = [in_step(windows, order * 2.0 * np.pi / 0.0623) for order in (1.0, 2.0, 3.0, 3.1, 6.0, 8.0)]
    assert told == [False, True, True, False, True, False]
    assert relay_period_s(t, u * (1.0 + 0.1 * np.sin(t))) is None
    wandering = np.where(np.sin(2.0 * np.pi * (8.0 + 0.5 * t) * t) > 0.0, 1.0, -1.0)
    assert relay_period_s(t, wandering) is None


def test_pieces_hold_a_period_at_least():
    slow = cut([series(T, np.sin(T), np.cos(T), 6.0, 6.2)])[0]
    quick = cut([series(T, np.sin(T), np.cos(T), 0.5, 6.2)])[0]
    assert len(segments(slow).windows) == len(slow.windows)
    assert len(segments(quick).windows) > 2 * len(quick.windows)
    assert len(segments(slow, 0.5).windows) > 10 * len(slow.windows)


@pytest.mark.slow
def test_a_search_without_work_answers_and_says_what_it_left_out(tmp_path, monkeypatch):
    u = command(4000)
    t, y, _, _ = simulate(u, {"coulomb_friction": {"level": LEVEL}})
    np.savetxt(
        tmp_path / "run.csv", np.c_[t, u, y], delimiter=",", header="t,u,y [rad]", comments="", fmt="%.9g"
    )
    monkeypatch.setitem(EFFORTS, "quick", 1e-9)
    answer = diagnose([read(tmp_path / "run.csv")], (), Options(effort="quick"))
    assert any("--effort thorough" in remark for remark in answer.remarks)
    assert answer.extended.holdout_nrmse <= answer.baseline.holdout_nrmse
