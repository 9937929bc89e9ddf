"""Whole recordings in one simulation: numbers fitted to them, and how far off they are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, RATE, ZETA, linear, multisine, recording

from seod.diagnose import one_search
from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting.free_run import fitted_in_one_run, fitted_to_all_rows, free_runs
from seod.diagnose.fitting.initial_states import begun_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.uncertainty import covariance
from seod.diagnose.fitting.uncertainty import linear as linearised
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, cut, fitted_windows

SIZES = Scales(2.0, 10.0, 1000.0, 0.0, 1.0, 0.3, OMEGA_N, 8.0, 1.0 / RATE)
TRUTH = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA}


@pytest.fixture(scope="module")
def rig():
    """Recording of 20 s whose command has a mean, model, its numbers, and windows to fit and held out."""
    u = multisine(20_000) + 0.2
    one = series(recording(u, linear(u)), np.zeros(len(u), np.bool_), sees_speed=False)
    model = baseline_model(SIZES, 1.0, False, {})
    x = model.searched(TRUTH)
    return one, model, x, *cut([one])


def found(model, x, windows):
    """A fit to windows that has not taken a step."""
    return fit(model, windows, x, begun_states(model, x, windows), most=0)


def test_a_gain_that_windows_left_wrong_by_three_hundredths_is_put_right_by_the_whole_run(rig):
    one, model, x, to_fit, held_out = rig
    begun = found(model, x + np.where(np.arange(len(x)) == 0, 0.03, 0.0), to_fit)
    better = fitted_in_one_run(begun, held_out, np.inf, map, lambda: False)
    assert model.values(better.x)["K_L"] == pytest.approx(K_L, rel=5e-4)
    before, after = (free_runs(model, each.x, [one], 1)[0] for each in (begun, better))
    assert after.from_fitted < 1.1 * one.noise < 3.0 * one.noise < before.from_fitted
    assert after.from_measured < 2.0 * one.noise, "the first sample has noise, too"


def test_numbers_that_are_right_stay_those_of_the_windows(rig):
    _, model, x, to_fit, held_out = rig
    begun = found(model, x, to_fit)
    assert fitted_in_one_run(begun, held_out, np.inf, map, lambda: False) is begun
    assert fitted_in_one_run(begun, held_out, np.inf, map, lambda: True) is begun


def test_numbers_that_leave_more_of_windows_than_eq_1_are_not_taken(rig):
    _, model, x, to_fit, held_out = rig
    begun = found(model, x + np.where(np.arange(len(x)) == 0, 0.03, 0.0), to_fit)
    assert fitted_in_one_run(begun, held_out, 0.0, map, lambda: False) is begun


@pytest.mark.parametrize(
    ("adequacy", "most"),
    [
        pytest.param(1.04, 0.00105, id="noise alone is left of windows: as near"),
        pytest.param(3.0, 0.034, id="more is left: nearer than Eq. 1"),
    ],
)
def test_numbers_for_whole_recordings_do_no_worse_in_windows_where_noise_alone_is_left(adequacy, most):
    """One run that was begun at the other flank of a gap bent four numbers by four of their intervals."""
    best, base = (SimpleNamespace(held=SimpleNamespace(rms=rms, adequacy=adequacy)) for rms in (0.001, 0.034))
    assert one_search._most(SimpleNamespace(best=best, base=base)) == pytest.approx(most)


def test_errors_of_whole_runs_are_in_the_unit_of_y_and_tell_which_start(rig):
    """A start 1 unit from the measured one is made up for by a fitted state, and not by a measured one."""
    one, model, x, *_ = rig
    moved = replace(one, y=one.y + 5.0 * one.noise * (np.arange(len(one.y)) == 0))
    near, far = free_runs(model, x, [one, moved], 1)
    assert (near.unseen, far.unseen) == (False, True)
    assert near.from_fitted == pytest.approx(one.noise, rel=0.05)
    assert far.from_measured == pytest.approx(np.hypot(5.0, 1.0) * one.noise, rel=0.3)
    assert far.from_fitted < 0.5 * far.from_measured
    assert far.as_json() == {
        "rms_from_measured": far.from_measured,
        "rms_from_fitted": far.from_fitted,
        "nrmse_from_fitted": pytest.approx(far.from_fitted / np.std(moved.y), rel=1e-6),
        "holdout": True,
    }


def test_the_last_fit_sees_the_rows_that_were_held_out_and_its_intervals_are_narrower(rig):
    """Readings that are 1 % larger in the windows held out move the last numbers."""
    one, model, x, to_fit, held_out = rig
    small = fitted_windows(to_fit)
    halves = fit(model, small, x, begun_states(model, x, small))
    every = Cut(held_out.series, tuple(sorted((*to_fit.windows, *held_out.windows))))
    last = fitted_to_all_rows(halves, every, map, lambda: False)
    assert last.cut.good.sum() > 1.9 * halves.cut.good.sum()
    by_noise = [np.linalg.inv(linearised(each)[0].curvature())[0, 0] for each in (last, halves)]
    assert np.sqrt(by_noise[0] / by_noise[1]) == pytest.approx(np.sqrt(0.5), rel=0.2)
    assert covariance(last)[0, 0] < covariance(halves)[0, 0]
    assert model.values(last.x)["K_L"] == pytest.approx(K_L, abs=4.0 * K_L * np.sqrt(covariance(last)[0, 0]))
    rows = np.concatenate([np.arange(a, b) for _, a, b in held_out.windows])
    other = np.isin(np.arange(len(one.y)), rows)
    moved = replace(one, y=np.where(other, 1.01 * one.y, one.y))
    wrong = fitted_to_all_rows(halves, Cut([moved], every.windows), map, lambda: False)
    assert model.values(wrong.x)["K_L"] > model.values(last.x)["K_L"] * 1.001


def test_the_last_fit_is_of_runs_as_long_as_those_by_which_rows_held_out_were_foretold(rig):
    _, model, x, to_fit, held_out = rig
    begun = found(model, x + np.where(np.arange(len(x)) == 0, 0.03, 0.0), to_fit)
    better = fitted_in_one_run(begun, held_out, np.inf, map, lambda: False)
    every = Cut(held_out.series, tuple(sorted((*to_fit.windows, *held_out.windows))))
    last = fitted_to_all_rows(better, every, map, lambda: False)
    longest = [max(b - a for _, a, b in each.cut.windows) for each in (better, last)]
    assert longest[1] >= longest[0] > 2 * max(b - a for _, a, b in every.windows)
    assert model.values(last.x)["K_L"] == pytest.approx(K_L, rel=5e-4)
