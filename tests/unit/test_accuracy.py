"""The accuracy bench: records and bound against scipy's plant, the baselines, the file; a small run of it."""

from __future__ import annotations

import json
import math
import sys
from argparse import Namespace
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from relay_truth import Loop, rows
from scipy.linalg import expm

sys.path.append(str(Path(__file__).parents[2] / "bench"))

import accuracy
import accuracy_runs
import accuracy_truth
import baselines
import kept_runs
from accuracy_cases import GRID, PLANTS, TICK, Case, about_the_plants
from accuracy_runs import Heard, Said, hear
from accuracy_summary import summary, wilson
from accuracy_truth import E_A, K_L, Run, make

PLAIN = [Case(*plant) for plant in PLANTS]


def states(
    zeta: float, omega_n: float, u: np.ndarray, start: np.ndarray, load: float = 0.0, gain: float = K_L
) -> np.ndarray:
    """Position, speed, acceleration at the ticks, each of `u` held for one: matrix exponential; (n, 3)."""
    a = np.zeros((4, 4))
    a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(omega_n**2), -2 * zeta * omega_n, gain * omega_n**2]]
    move, state, out = expm(a * TICK), start, []
    for volts in u:
        out.append(state)
        state = move[:3, :3] @ state + move[:3, 3] * (volts - load)
    return np.array(out)


def in_force(run: Run) -> np.ndarray:
    """The voltage at the plant from each tick to the next, unequal gains and the load's share in it."""
    volts = np.concatenate([[0.0] * run.case.delay, run.u])[: len(run.u)]
    return volts + run.case.unequal * np.abs(volts) - run.case.load * E_A


@lru_cache
def replayed(case: Case, seed: int) -> tuple[Run, np.ndarray]:
    """A record, and the motion of scipy's plant under its voltages from the start that suits it best."""
    run = make(case, seed)
    forced = states(run.plant.zeta, run.plant.omega_n, in_force(run), np.zeros(3), gain=run.plant.K_L)
    scale = np.diag(run.plant.omega_n ** np.arange(3.0))
    free = np.stack([states(run.plant.zeta, run.plant.omega_n, 0.0 * run.u, x)[:, 0] for x in scale])
    start = np.linalg.lstsq(free.T, run.y - forced[:, 0], rcond=None)[0]
    return run, forced + states(run.plant.zeta, run.plant.omega_n, 0.0 * run.u, scale @ start)


OTHERS = [
    {"load": 0.3},
    {"unequal": -0.3},
    {"bias": 1 / 3},
    {"load": 0.1, "bias": -1 / 3},
    {"two_phase": True},
]


@pytest.mark.parametrize("case", [*PLAIN, *(replace(PLAIN[1], **changes) for changes in OTHERS)])
def test_a_record_is_the_motion_of_the_plant_written_apart_and_noise(case):
    run, motion = replayed(case, 3)
    left = run.y - motion[:, 0]
    assert np.std(left) == pytest.approx(run.sigma, rel=0.12)
    clean, motion = replayed(replace(case, noise=0.0), 3)
    assert np.max(np.abs(clean.y - motion[:, 0])) < 1e-5 * np.ptp(clean.y)


@pytest.mark.parametrize("case", PLAIN)
def test_the_limit_cycle_is_that_of_the_loop_written_apart(case):
    amplitude, period = accuracy_truth.scale_of(case)
    there = rows(Loop(case.zeta, case.turn / TICK, delay=1.0, start=0.5), 2.0)
    y, u = np.array([[row.y, row.u] for row in there])[2000:].T
    assert 0.5 * np.ptp(y) == pytest.approx(amplitude, rel=0.02)
    assert TICK * np.mean(np.diff(np.flatnonzero(np.diff(u) > 0.0))) == pytest.approx(period, rel=0.02)


@pytest.mark.parametrize("case", [*PLAIN, replace(PLAIN[1], free="K_L"), replace(PLAIN[1], free="delay")])
def test_the_bound_is_that_of_the_plant_written_apart(case):
    run, motion = replayed(case, 1)
    first = len(run.t) - int(2.5 * run.period / TICK)
    scale = 0.1 * K_L * E_A * run.plant.omega_n ** np.array([-1.0, 0.0, 1.0])

    def at(x: np.ndarray) -> np.ndarray:
        plant = run.plant.zeta * math.exp(x[1]), run.plant.omega_n * math.exp(x[0])
        begin, gain = motion[first] + x[2:5] * scale, run.plant.K_L + 0.03 * K_L * x[6]
        moved = states(*plant, in_force(run)[first:], begin, 0.1 * x[5], gain)
        return (
            moved[:, 0] - x[7] * 0.3 * TICK * moved[:, 1]
        )  # a later voltage: all is later, but for the start

    count = {"": 6, "K_L": 7, "delay": 8}[case.free]
    slopes = np.stack([at(1e-4 * e) - at(-1e-4 * e) for e in np.eye(8)[:count]]) / 2e-4 / run.sigma
    if case.free == "delay":
        slopes = np.delete(slopes, 6, axis=0)
    information = slopes @ slopes.T
    if case.free:
        information[-1, -1] += 1.0
    expected = np.sqrt(np.diag(np.linalg.inv(information))[:2])
    assert accuracy_truth.bound(run, run.t[first]) == pytest.approx(expected, rel=0.02)


def test_of_two_phases_one_is_slower_and_each_has_its_cycles():
    run = make(replace(PLAIN[1], two_phase=True, noise=0.0), 2)
    second = np.array([row.second for row in run.rows()])
    ups = np.flatnonzero(np.diff(run.u) > 0.0) + 1
    periods, phases = np.diff(ups), second[(ups[1:] + ups[:-1]) // 2]
    turns = np.flatnonzero(np.diff(second))
    assert len(turns) >= 2
    assert np.mean(periods[phases]) > 1.2 * np.mean(periods[~phases])
    assert turns[1] - turns[0] == pytest.approx(3 * np.mean(periods[phases]), rel=0.15)


@pytest.mark.parametrize("unknown", [("K_L",), ("delay",), ("K_L", "delay")])
def test_the_bound_is_wider_where_less_is_known(unknown):
    run = make(PLAIN[1], 1)
    begin = run.t[-1] - 4.0 * run.period
    assert np.all(accuracy_truth.bound(run, begin, unknown) > 2.0 * accuracy_truth.bound(run, begin))


def test_a_longer_window_and_less_noise_lower_the_bound():
    run = make(PLAIN[1], 1)
    short, long = (accuracy_truth.bound(run, run.t[-1] - cycles * run.period) for cycles in (1.5, 4.5))
    assert np.all(long < 0.6 * short)
    assert accuracy_truth.bound(replace(run, sigma=0.5 * run.sigma), run.t[0]) == pytest.approx(
        0.5 * accuracy_truth.bound(run, run.t[0])
    )


def test_a_seed_makes_a_record_again_and_another_one_another():
    one, same, other = make(GRID[0], 1), make(GRID[0], 1), make(GRID[0], 2)
    assert np.array_equal(one.y, same.y)
    assert one.plant != other.plant
    assert len({case.name for _, case in about_the_plants()} | {case.name for case in GRID}) == 24 + 21 * 3


@pytest.mark.slow
def test_wave_reaches_the_bound_and_its_intervals_hold():
    """A small run of the bench: 6 records of each plant."""
    heard = [hear(case, seed, compared=False) for case in PLAIN for seed in range(6)]
    found = summary(heard, "wave")
    assert found.good >= 17
    assert max(found.ratio) < 1.7  # 4 standard deviations of chance from 1
    assert max(map(abs, found.bias)) < 2e-3
    assert min(found.covered) >= 13
    assert np.max(found.first) < 2.1


# ---- what users would write


def test_both_baselines_find_the_plant_without_noise():
    run = make(Case(0.45, 0.0725, noise=0.0), 1)
    omega = 2.0 * math.pi / run.period
    omega_n, _, zeta, _ = baselines.least_squares(run.y, run.u, TICK, 1, omega)
    assert (omega_n, zeta) == pytest.approx((run.plant.omega_n, run.plant.zeta), rel=1e-4)
    guess = 1.2 * run.plant.omega_n, 0.6 * run.plant.zeta
    omega_n, _, zeta, _ = baselines.kalman(run.y, run.u, TICK, 1, K_L, 0.0, guess)
    assert (omega_n, zeta) == pytest.approx((run.plant.omega_n, run.plant.zeta), rel=1e-3)


@pytest.mark.slow
def test_noise_misleads_least_squares_and_not_the_filter():
    heard = [hear(PLAIN[1], seed) for seed in range(4)]
    assert summary(heard, "RLS").bias[1] > 0.2
    assert abs(summary(heard, "EKF").bias[1]) < 0.002


def test_no_plant_has_poles_that_oscillate_from_tick_to_tick():
    assert baselines._poles(np.zeros(5), TICK) is None
    assert baselines._poles(np.array([0.0, -1e-30, 0, 0, 0]), TICK) is None


# ---- the file and the tables


def test_what_is_done_already_is_not_done_again(tmp_path, monkeypatch):
    asked = []

    def line(case, block, digest):
        asked.append((case, block))
        heard = [Heard([1.0, 1.0], {"wave": Said("ok", [0.0, 1.0, 0.0, 1.0])})]
        return json.dumps({"case": case.name, "block": block, "digest": digest, "heard": heard})

    monkeypatch.setattr(accuracy_runs, "line", line)
    options = Namespace(quick=True, only="", file=tmp_path / "found.jsonl", scheduler="local", workers=0)
    kept_runs.work(accuracy_runs, accuracy.tasks(options), options, "abc")
    assert len(asked) == 6
    kept = options.file.read_text()
    options.file.write_text(kept[: kept.rindex("heard")])  # as if it had been killed in the last line
    kept_runs.work(accuracy_runs, accuracy.tasks(options), options, "abc")
    assert len(asked) == 7
    kept_runs.work(accuracy_runs, accuracy.tasks(options), options, "other sources")
    assert len(asked) == 13
    found = accuracy_runs.read(options.file, "abc")
    assert sorted(map(len, found.values())) == [2, 2, 2]
    options.only = PLAIN[0].name
    kept_runs.work(accuracy_runs, accuracy.tasks(options), options, "abc")
    assert len(asked) == 13
    kept_runs.work(accuracy_runs, accuracy.tasks(options), options, "newest")
    assert len(asked) == 15
    assert {len(blocks) for blocks in accuracy_runs.read(options.file, None).values()} == {2}
    assert found[PLAIN[0].name][1][0].said["wave"].quality == "ok"


def test_a_summary_counts_only_what_is_ok():
    good, bad = Said("ok", [0.1, 0.1, -0.3, 0.1], 1.5, [0.1, 0.1, 0.1, 0.1]), Said("settling", [9.0] * 4)
    s = summary([Heard([0.05, 0.1], {"wave": x}) for x in (good, good, bad)], "wave")
    assert (s.runs, s.good, s.words["settling"]) == (3, 2, 1)
    assert s.bias == pytest.approx((0.1, -0.3))
    assert s.covered == (2, 0)
    assert s.first_covered == (2, 2)
    assert s.first.tolist() == [1.5, 1.5]
    assert summary([], "wave") is None


def test_wilsons_interval_is_the_published_one():
    """Newcombe, Statistics in Medicine 17, 1998, table I: 81 of 263 and 0 of 20."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)


def test_tables_are_put_in_their_places():
    text = "a\n<!-- one -->\nold\n<!-- end -->\nb\n<!-- two -->\n<!-- end -->\n"
    assert kept_runs.put(text, {"one": "new\n", "two": "2\n", "none": "x"}) == (
        "a\n<!-- one -->\nnew\n<!-- end -->\nb\n<!-- two -->\n2\n<!-- end -->\n"
    )
