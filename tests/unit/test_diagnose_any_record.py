"""Any record ends in an answer or a sentence; and the places where some did not."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_truth import RATE, linear, multisine, recording

from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import CAUSES, further_causes, group
from seod.diagnose.fitting.initial_states import measured_places
from seod.diagnose.fitting.least_squares import settle
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.fourth_differences import stencils
from seod.diagnose.record.outliers import outliers
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, cut, segments
from seod.diagnose.search.budget import EFFORTS
from seod.diagnose.verdict.experiment_trial import perform, times
from seod.diagnose.verdict.next_experiment import excitations
from sim.parameters import parameters

sys.path.append(str(Path(__file__).parents[2] / "bench"))

import any_record

USUAL = Scales(2.0, 1.5, 300.0, 0.2, 1.2, 0.3, 60.0, 30.0, 1e-3)
N = 12000


def sized(unit: float, slower: float) -> Scales:
    """A usual recording in another unit, of a rig that is slower."""
    return replace(
        USUAL,
        speed=unit * USUAL.speed / slower,
        pressure=unit * USUAL.pressure / slower**2,
        centre=unit * USUAL.centre,
        travel=unit * USUAL.travel,
        peak_to_peak=unit * USUAL.peak_to_peak,
        omega_n=USUAL.omega_n / slower,
        span_s=slower * USUAL.span_s,
        tick_s=slower * USUAL.tick_s,
        slowest=USUAL.slowest / slower,
    )


@pytest.fixture
def little(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", any_record.BUDGET)
    monkeypatch.setattr(any_record, "MOST", 700)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("number", range(40))
def test_any_record_ends_in_an_answer_or_a_sentence(number, little, tmp_path):
    what, text = any_record.outcome(number, tmp_path)
    assert what in {"answer", "sentence"}, text
    assert text


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "number",
    [
        pytest.param(7092, id="fewer steps than a step takes"),
        pytest.param(7117, id="a travel of less than a curve may have"),
        pytest.param(7125, id="a window without a sample that has its past"),
        pytest.param(7196, id="no plant that makes any of the readings"),
        pytest.param(7444, id="a term that one fold alone has"),
    ],
)
def test_records_that_ended_in_a_traceback_do_no_more(number, monkeypatch, tmp_path):
    monkeypatch.setitem(EFFORTS, "quick", any_record.BUDGET)
    what, text = any_record.outcome(number, tmp_path)
    assert what in {"answer", "sentence"}, text


@pytest.mark.parametrize("slower", [0.01, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("unit", [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9])
def test_every_cause_that_is_tried_has_starts_that_its_limits_allow(unit, slower):
    sizes = sized(unit, slower)
    model = baseline_model(sizes, 1.0, sees_speed=False, fixed={})
    assert np.all(model.bounds[0] < model.bounds[1])
    some = [name for name in ("coulomb_friction",) if CAUSES[name].has_room(sizes)]
    for name in (*some, *further_causes(sizes, some)):
        searched = group(name, sizes)
        more = model.with_effect("coulomb_friction") if CAUSES[name].needs else model
        more = more.with_effect(name)
        ends = [{c.place: getattr(c, end) for c in searched.coordinates} for end in ("low", "high")]
        plant = {"K_L": 1.0, "omega_n": sizes.omega_n, "zeta": 0.4, "coulomb_friction.level": sizes.pressure}
        for start in (*searched.starts, *ends):
            more.kernel_parameters(more.searched(plant | start))
        assert np.all(more.bounds[0] < more.bounds[1])


def test_a_window_whose_begin_or_end_is_all_clipped_is_not_held_out():
    y = linear(multisine(N))
    one = series(recording(multisine(N), y))
    held_out = cut([one])[1].windows
    (_, first, last), *others = held_out
    for part in (slice(first, first + (last - first) // 3), slice(first + (last - first) // 6, last)):
        good = one.good.copy()
        good[part] = False
        assert cut([replace(one, good=good)])[1].windows == tuple(others)


def test_segments_without_a_sample_are_left_out():
    one = series(recording(multisine(N), linear(multisine(N))))
    good = one.good.copy()
    good[3000:6000] = False
    clipped = replace(one, good=good)
    small = segments(Cut([clipped], ((0, 0, N),)), 0.5)
    assert all(clipped.good[a:b].any() for _, a, b in small.windows)
    assert sum(b - a for _, a, b in small.windows) <= N - 3000 + round(RATE)
    assert len(measured_places(small)) == len(small.windows)


def test_few_rows_that_last_long_are_few_segments():
    one = series(recording(multisine(N), linear(multisine(N))))
    paused = replace(one, t=one.t + 1e6 * (np.arange(N) > 6000))
    small = segments(Cut([paused], ((0, 5000, 7000),)))
    assert all(b > a for _, a, b in small.windows)
    assert len(small.windows) <= 200


def test_states_that_no_row_tells_stay_as_they_are():
    one = series(recording(multisine(N), linear(multisine(N))))
    model, whole = baseline_model(USUAL, 1.0, sees_speed=False, fixed={}), Cut([one], ((0, 0, N),))
    x = model.searched({"K_L": 1.0, "omega_n": 60.0, "zeta": 0.4})
    start = measured_places(whole)
    assert np.array_equal(settle(model, whole, x, start, np.zeros(N, np.bool_)), start)


def test_outliers_far_beyond_their_own_noise_have_a_size_where_the_rest_is_noisier():
    y = np.zeros(4000)
    y[[20, 50, 80, 110]] = 1.0, 2.0, -4.0, 3.0
    found = stencils(np.arange(4000) * 1e-3, y, np.arange(4000))
    told = outliers(found, np.where(np.arange(len(found.middle)) < 130, 1e-3, 10.0))
    assert told.rows.tolist() == [20, 50, 80, 110]
    assert 0.0 < told.values["rate"] < 0.1


@pytest.mark.parametrize("omega_n", [1e-3, 0.1, 1.0, 60.0])
def test_a_trial_lasts_long_enough_for_a_slow_plant(omega_n):
    tick = min(1e-3, 0.1 / omega_n)
    t = times(omega_n, tick)
    for each in excitations(omega_n, 2.0, tick):
        assert each.band[0] < each.band[1]
        run = perform(parameters(1.0, omega_n, 0.4), each, t)
        assert np.ptp(run.u) > 0.0
    assert t[-1] * omega_n / (2.0 * np.pi) > 2.9
