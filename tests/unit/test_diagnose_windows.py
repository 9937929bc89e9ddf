"""Windows, noise and what a window's own start does, against truths that are known."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, RATE, ZETA, linear, multisine, recording
from plant_laws import ACCELERATION, PLACE, SPEED
from plant_truth import Plant

from seod.diagnose.fitting.simulate import inside, simulate
from seod.diagnose.record import blocks
from seod.diagnose.record import series as series_of
from seod.diagnose.record.blocks import in_blocks
from seod.diagnose.record.noise import noise_sd
from seod.diagnose.record.series import dominant_hz, series
from seod.diagnose.record.windows import (
    Cut,
    all_but,
    beginnings,
    cut,
    fitted_windows,
    hardly_settle,
    sample,
    segments,
    sparse,
    undivided,
)
from seod.diagnose.result import DiagnoseError
from sim.parameters import parameters

T = np.arange(12000) / RATE


def of(y, u=None, **more):
    return recording(multisine(len(y)) if u is None else u, y, **more)


@pytest.fixture(scope="module")
def one():
    return series(of(linear(multisine(12000))))


def test_noise_is_seen_through_a_movement_a_thousand_times_larger():
    random = np.random.default_rng(1)
    y = 50.0 * np.sin(2.0 * np.pi * 4.0 * T) + random.normal(0.0, 0.05, len(T))
    every = np.ones(len(T), np.bool_)
    assert noise_sd(T, y, every) == pytest.approx(0.05, rel=0.04)


def test_noise_is_not_seen_in_rows_that_do_not_count_nor_over_gaps():
    random = np.random.default_rng(1)
    y = np.sin(2.0 * np.pi * 2.0 * T) + random.normal(0.0, 0.01, len(T))
    good = random.random(len(T)) > 0.02
    y[~good] += 100.0
    kept = (T < 4.0) | (T > 7.0)
    assert noise_sd(T[kept], y[kept], good[kept]) == pytest.approx(0.01, rel=0.05)


def test_the_dominant_frequency_is_found_beside_a_drift():
    y = 3.0 * T + np.sin(2.0 * np.pi * 5.3 * T) + 0.3 * np.sin(2.0 * np.pi * 31.0 * T)
    assert dominant_hz(T, y, np.ones(len(T), np.bool_)) == pytest.approx(5.3, abs=0.1)


def test_the_dominant_period_of_a_long_position_is_not_that_of_its_drift(monkeypatch):
    """The longer it is recorded, the farther it drifts, and the slower."""
    y = 20.0 * np.sin(2.0 * np.pi * 0.09 * T) + np.sin(2.0 * np.pi * 5.3 * T)
    assert series(of(y)).period_s == pytest.approx(1.0 / 0.09, rel=0.1)
    monkeypatch.setattr(series_of, "SERIES", replace(series_of.SERIES, drifting_rows=len(T) - 1))
    assert series(of(y)).period_s == pytest.approx(1.0 / 5.3, rel=0.02)
    assert series(of(y), sees_speed=True).period_s == pytest.approx(1.0 / 0.09, rel=0.1)


def test_noise_is_not_taken_for_the_speed_of_a_long_position(monkeypatch):
    """Of a slow movement sampled quickly the change is noise for the most part."""
    y = np.sin(2.0 * np.pi * 0.4 * T) + np.random.default_rng(1).normal(0.0, 0.05, len(T))
    monkeypatch.setattr(series_of, "SERIES", replace(series_of.SERIES, drifting_rows=len(T) - 1))
    assert series(of(y)).period_s == pytest.approx(1.0 / 0.4, rel=0.1)


@pytest.mark.parametrize(("hz", "length"), [(20.0, 1.0), (5.0, 2.0), (0.7, 3.0)])
def test_a_window_is_ten_periods_at_least_a_second_at_most_a_quarter(hz, length):
    assert series(of(np.sin(2.0 * np.pi * hz * T))).window_s == pytest.approx(length, rel=0.06)


def test_every_second_window_is_held_out_and_none_is_in_both(one):
    fitted, held = cut([one])
    assert len(fitted.windows) - len(held.windows) in (0, 1)
    every = sorted(fitted.windows + held.windows)
    assert every[0] == fitted.windows[0]
    assert every[1] == held.windows[0]
    for (_, _, last), (_, first, _) in pairwise(every):
        assert last == first
    assert every[-1][2] == len(one.t)


def test_a_long_recording_is_cut_in_blocks_at_distances_of_which_no_two_are_alike(one, monkeypatch):
    monkeypatch.setattr(blocks, "BLOCKS", replace(blocks.BLOCKS, searched_rows=len(one.t) // 3))
    (long,) = in_blocks([replace(one, window_s=one.tick * len(one.t) / 80.0)])
    begins = [begin for begin, _ in long.blocks]
    assert len(begins) == 5
    apart = [b - a for a, b in combinations(begins, 2)]
    assert len(set(apart)) == len(apart)
    assert long.blocks[0][0] == 0
    assert long.blocks[-1][1] == len(one.t)
    assert sum(b - a for a, b in long.blocks) == pytest.approx(len(one.t) / 3, abs=5)
    fitted, held = cut([long])
    for _, first, last in (*fitted.windows, *held.windows):
        assert any(a <= first < last <= b for a, b in long.blocks)
    assert len(undivided(fitted).windows) == 5


@pytest.mark.parametrize(("longer", "count"), [(1.001, 2), (1.4, 3), (1.8, 4), (2.4, 5)])
def test_blocks_lie_beside_each_other_however_little_longer_the_recording_is(one, monkeypatch, longer, count):
    monkeypatch.setattr(blocks, "BLOCKS", replace(blocks.BLOCKS, searched_rows=int(len(one.t) / longer)))
    (long,) = in_blocks([replace(one, window_s=one.tick * len(one.t) / 80.0)])
    assert len(long.blocks) == count
    assert all(end <= begin for (_, end), (begin, _) in pairwise(long.blocks))
    fitted, held = cut([long])
    every = sorted(fitted.windows + held.windows)
    assert all(last <= first for (_, _, last), (_, first, _) in pairwise(every))


def test_a_short_recording_is_searched_whole(one):
    assert in_blocks([one]) == [one]


def test_what_is_fitted_last_is_all_but_the_rows_held_out(one, monkeypatch):
    monkeypatch.setattr(blocks, "BLOCKS", replace(blocks.BLOCKS, searched_rows=len(one.t) // 3))
    (long,) = in_blocks([replace(one, window_s=one.tick * len(one.t) / 80.0)])
    _, held = cut([long])
    every = all_but([long], held)
    counted = np.zeros(len(one.t), np.bool_)
    for (_, first, last), rows in zip(every.windows, every.slices, strict=True):
        counted[first:last] = every.good[rows]
    unseen = np.zeros(len(one.t), np.bool_)
    for _, first, last in held.windows:
        unseen[first:last] = True
    assert not np.any(counted & unseen)
    assert np.count_nonzero(counted | unseen) > 0.95 * len(one.t)


def test_pieces_hold_the_same_rows_and_a_sample_only_some(one):
    fitted, _ = cut([one])
    small = segments(fitted, 0.5)
    assert np.array_equal(small.gathered("t"), fitted.gathered("t"))
    some = sample(small, 2.0)
    assert set(some.windows) < set(small.windows)
    assert some.sizes.sum() == pytest.approx(2.0 * RATE, rel=0.3)


def test_what_tells_nothing_is_refused_with_its_reason():
    y = linear(multisine(12000))
    for wrong, why in (
        (of(y, u=np.full(12000, np.nan)), "has no command u"),
        (of(y, u=np.zeros(12000)), "the command u never changes"),
        (of(np.full(12000, np.nan)), "has 0 samples of y; a diagnosis needs 200"),
    ):
        with pytest.raises(DiagnoseError, match=why):
            series(wrong)


def test_a_command_that_is_missing_is_the_one_before(one):
    u = multisine(12000)
    u[100:103] = np.nan
    assert np.all(series(of(linear(multisine(12000)), u=u)).u[100:103] == u[99])


@pytest.mark.slow
def test_windows_begin_where_the_plant_written_apart_is():
    """Delay, lag and hysteresis from the recording's start; the load from each window's own."""
    effects = {
        "transport_delay": {"time": 0.0033},
        "valve_lag": {"time": 0.004},
        "valve_hysteresis": {"half_width": 0.1},
        "square_root_flow": {"supply": 9000.0},
        "load_bias": {"acceleration": 200.0},
    }
    n = 500
    u = multisine(n)
    truth, given = Plant(K_L, OMEGA_N, ZETA, effects), 0
    y, states = np.empty(n), np.empty((n, 3))
    for k in range(n):
        while given < k and T[given] + 0.0033 <= T[k]:
            truth.advance(T[given] + 0.0033)
            truth.command(u[given])
            given += 1
        truth.advance(T[k])
        y[k] = truth.reading(truth.w)
        states[k] = truth.w[[ACCELERATION, SPEED, PLACE]]
    one = series(recording(u, y, noise=0.0))
    windows = Cut([one], ((0, 150, 260), (0, 320, 500)))
    start = np.zeros((2, 7))
    start[:, :3] = states[[150, 320]]
    record = parameters(K_L, OMEGA_N, ZETA, effects)
    rows = np.r_[150:260, 320:500]
    assert np.max(np.abs(simulate(record, windows, start) - y[rows])) < 1e-5 * np.ptp(y)
    seen, within = inside(record, windows, start)
    assert np.array_equal(seen, simulate(record, windows, start))
    assert np.all(np.max(np.abs(within[:, :3] - states[rows]), axis=0) < 1e-4 * np.ptp(states, axis=0))


def test_an_unstable_plant_is_followed_until_it_has_left_the_recording():
    one = series(recording(np.sin(7.0 * T), np.sin(9.0 * T), noise=0.0))
    bristles = {"coulomb_friction": {"level": 900.0}, "lugre_friction": {"stiffness": 2e5, "damping": 400.0}}
    spring = {"load_spring": {"stiffness": -1e4, "centre": 0.0}}
    record = parameters(64.0, 82.0, 1.6, {**spring, **bristles})
    start = np.zeros((2, 7))
    start[:, 2] = [1.0, -2.0]
    windows = Cut([one], ((0, 100, 400), (0, 500, 900)))
    seen, within = inside(record, windows, start)
    for piece in windows.slices:
        gone = int(np.argmax(np.abs(seen[piece]) > 1e3))
        assert 0 < gone < piece.stop - piece.start - 1
        assert np.all(seen[piece][gone:] == seen[piece][gone])
        assert np.all(within[piece][gone:] == within[piece][gone])
    assert np.all(np.isfinite(seen))


def test_recordings_of_few_rows_are_fitted_as_a_whole_without_the_rows_held_out(one):
    u = multisine(300)
    few = series(of(linear(u), u))
    to_fit, held_out = cut([few])
    (window,) = fitted_windows(to_fit).windows
    whole = fitted_windows(to_fit)
    assert hardly_settle(to_fit)
    assert window[2] - window[1] > 200
    assert not any(whole.series[0].good[a:b].any() for _, a, b in held_out.windows)
    assert not hardly_settle(cut([one])[0])
    assert fitted_windows(cut([one])[0]).windows == segments(cut([one])[0]).windows


def test_of_many_rows_the_first_part_of_each_window_is_taken(one):
    fitted, _ = cut([one])
    rows = int(fitted.sizes.sum()) // 3
    short = beginnings(fitted, rows)
    assert 0 <= short.sizes.sum() - rows <= len(fitted.windows)
    assert [(k, a) for k, a, _ in short.windows] == [(k, a) for k, a, _ in fitted.windows]
    assert np.ptp(short.sizes / fitted.sizes) < 0.01
    assert beginnings(fitted, int(fitted.sizes.sum())) is fitted


def test_of_few_readings_a_cycle_a_relays_search_sees_all():
    """A sensor that repeats its readings has fewer than rows: it is they that are counted."""
    t = np.arange(20_000) / RATE
    u = np.where(np.sin(2.0 * np.pi * 4.0 * t) > 0.0, 1.0, -1.0)
    read = np.arange(len(t)) % 12 == 0
    y = np.repeat(np.sin(2.0 * np.pi * 4.0 * t[read]), 12)[: len(t)]
    held = series(of(y, u), ~read, taken=t)
    whole = Cut((held,), ((0, 0, 10_000), (0, 10_000, 20_000)))
    assert held.reading_s == pytest.approx(12.0 / RATE)
    assert int(sparse(whole).series[0].good.sum()) == int(read.sum())
