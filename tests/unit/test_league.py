"""The league's rivals on limit cycles of known plants; its counting, its file and its tables."""

from __future__ import annotations

import json
import math
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "bench"))

import kept_runs
import league
import league_runs
import league_summary
from accuracy_cases import PLANTS, Case
from accuracy_truth import E_A, K_L, make
from league_cases import GRID, QUICK, VARIED, factor, unequal_levels
from league_rivals import TABLE
from league_rivals.base import Told, harmonic, last_cycles
from league_rivals.describing import describing
from league_runs import METHODS, Said, hear

from sim.parameters import parameters
from sim.runs import RELAY, ideal_relay
from sim.state import new_state

EXACT = {0.2: (0.99872, 1.27573), 0.45: (0.99398, 1.28499), 1.0: (0.97801, 1.31663), 4.0: (0.93477, 1.41561)}
"""By zeta, of the exact limit cycle: xi = omega_s / omega_n and Gamma = 2 zeta omega_n V_s / (K_L e_a)."""
OMEGA_N, FINE = 100.0, 1e-4
SHARES = {"describing": 0.05, "areas": 0.06, "fourier": 3e-3, "A-function": 0.02, "shifting": 0.02,
          "asymmetric": 2e-4, "asymmetric, told": 2e-4}  # fmt: skip
"""Of the truth, by which each may be wrong without noise: a sampled relay's cycles do not repeat exactly."""


def ideal(zeta: float, hysteresis: float = 0.0, latency: float = 0.0):
    """Cycles of a relay that sees every instant, and what a method may be told."""
    p, relay = parameters(K_L, OMEGA_N, zeta), np.zeros(1, RELAY)
    amplitude = 1.28 * K_L * E_A / (2.0 * zeta * OMEGA_N)
    relay["e_a"], relay["hysteresis"], relay["latency"] = E_A, hysteresis * amplitude, latency
    t = FINE * np.arange(int((12.0 + 4.0 / zeta) * 2.0 * math.pi / OMEGA_N * (1.0 + zeta) / FINE))
    y, switches, state = np.empty(len(t)), np.empty(500), new_state(p, 0.0, -0.1 * amplitude)
    count = ideal_relay(p[0], state[0], relay[0], t, y, switches)
    t_u = np.concatenate([[0.0], switches[:count] + latency])
    u = E_A * (-1.0) ** np.arange(count + 1)
    told = Told(K_L, E_A, hysteresis * amplitude, 0.0, latency)
    return last_cycles(t, y, t_u, u, 4), told


@pytest.mark.parametrize(("zeta", "exact"), EXACT.items())
def test_the_describing_function_is_wrong_by_what_it_leaves_out(zeta, exact):
    xi, gamma = exact
    found = describing(*ideal(zeta))
    assert found.omega_n == pytest.approx(xi * OMEGA_N, rel=2e-4)
    assert found.zeta == pytest.approx(4.0 / math.pi / gamma / xi * zeta, rel=2e-3 if zeta > 2 else 4e-4)


@pytest.mark.parametrize("zeta", [0.2, 0.8, 1.0, 1.5])
@pytest.mark.parametrize("hysteresis", [0.0, 0.3])
@pytest.mark.parametrize("latency", [0.0, 1e-3])
def test_the_a_function_is_exact_with_an_ideal_relay(zeta, hysteresis, latency):
    found = TABLE["A-function"].find(*ideal(zeta, hysteresis, latency))
    assert (found.omega_n, found.zeta) == pytest.approx((OMEGA_N, zeta), rel=1e-3)


def test_an_area_holds_a_third_of_the_third_harmonic():
    """The rectified mean of a sine and a tenth of its third harmonic is 1 + 0.1 / 3 the sine's."""
    record, told = ideal(0.45)
    w = 2.0 * math.pi / record.period
    at = w * (record.t - record.ups[0])
    record = record._replace(y=-(np.sin(at) + 0.1 * np.sin(3.0 * at)))
    one, other = (TABLE["areas"].find(record._replace(y=scale * record.y), told) for scale in (1.0, 2.0))
    sine = TABLE["areas"].find(record._replace(y=-np.sin(at)), told)
    assert sine.zeta / one.zeta == pytest.approx(1.0 + 0.1 / 3.0, rel=1e-3)
    assert other.zeta == pytest.approx(0.5 * one.zeta)


def test_a_harmonic_is_the_plants_frequency_response():
    run = make(unequal_levels(Case(0.45, 0.0725, 0.0, before=6)), 1)
    record = league_runs.cycles(run)
    for n in (1, 2):
        s = 2j * math.pi * n / record.period
        omega_n = run.plant.omega_n
        true = K_L / (s * ((s / omega_n) ** 2 + 2.0 * run.plant.zeta * s / omega_n + 1.0))
        assert abs(harmonic(record, n) / true - 1.0) < 2e-3


@pytest.mark.parametrize("name", TABLE)
@pytest.mark.parametrize("plant", PLANTS)
def test_each_rival_finds_the_plant_without_noise(name, plant):
    case = next(case for case in QUICK if (case.zeta, case.turn) == plant and case.noise == 0.0)
    run = make(unequal_levels(case) if TABLE[name].unequal else case, 3)
    found = TABLE[name].find(league_runs.cycles(run), league_runs.told(run))
    true = run.plant.omega_n, run.plant.zeta
    assert (found.omega_n, found.zeta) == pytest.approx(true, rel=SHARES[name])
    if found.K_L is not None:
        assert pytest.approx(K_L, rel=SHARES[name]) == found.K_L


@pytest.mark.parametrize("name", ["fourier", "A-function", "shifting", "asymmetric", "asymmetric, told"])
@pytest.mark.parametrize("what", ["load=0.1", "hysteresis=0.3", "delay=3"])
def test_what_is_varied_does_not_mislead_those_that_reckon_with_it(name, what):
    case = next(c for c in VARIED if factor(c) == what and c.zeta == 0.8 and c.noise == 0.0)
    run = make(unequal_levels(case) if TABLE[name].unequal else case, 1)
    found = TABLE[name].find(league_runs.cycles(run), league_runs.told(run))
    assert (found.omega_n, found.zeta) == pytest.approx((run.plant.omega_n, run.plant.zeta), rel=0.02)


def test_a_describing_function_without_hysteresis_is_wrong_where_there_is_one():
    record, told = ideal(0.45, hysteresis=0.3)
    right, ignored = (describing(record, x) for x in (told, told._replace(hysteresis=0.0)))
    assert right.zeta == pytest.approx(0.45, rel=0.03)
    assert ignored.omega_n < 0.91 * OMEGA_N < 0.97 * OMEGA_N < right.omega_n


def test_chatter_is_counted_once():
    record, _ = ideal(0.45)
    times = np.sort(np.concatenate([record.t_u, record.t_u[1:] + 2e-4, record.t_u[1:] + 4e-4]))
    repeats = np.where(np.arange(len(record.u)) > 0, 3, 1)
    back = np.concatenate([[1.0], np.tile([1.0, -1.0, 1.0], len(record.u) - 1)])
    levels = np.repeat(record.u, repeats) * back
    noisy = last_cycles(record.t, record.y, times, levels, 4)
    assert noisy.ups == pytest.approx(record.ups + 2e-4)  # of the same mean voltage
    assert noisy.downs == pytest.approx(record.downs + 2e-4)
    assert last_cycles(record.t, record.y, times[:9], levels[:9], 4) is None


def test_a_glitch_that_changes_nothing_is_no_switch():
    record, _ = ideal(0.45)
    at = 0.5 * (record.ups[0] + record.downs[0])
    k = int(np.searchsorted(record.t_u, at))
    times = np.insert(record.t_u, k, [at, at + 2e-4])
    levels = np.insert(record.u, k, [-E_A, E_A])
    noisy = last_cycles(record.t, record.y, times, levels, 4)
    assert (noisy.ups == record.ups).all()
    assert (noisy.downs == record.downs).all()


def test_a_relay_with_unequal_levels_has_them_as_one_to_two():
    case = unequal_levels(QUICK[1])
    run = make(case, 1)
    assert np.unique(run.u) == pytest.approx([-4.0 / 3.0 * E_A, 2.0 / 3.0 * E_A])
    record = league_runs.cycles(run)
    assert np.mean(record.downs - record.ups[:-1]) == pytest.approx(2.0 / 3.0 * record.period, rel=0.02)


# ---- what is counted


@pytest.mark.slow
def test_a_seed_asks_every_method_and_wave_is_the_closest():
    """A small run of the league: 4 records of each plant with 1 % noise."""
    heard = [hear(case, seed) for case in QUICK[3:] for seed in range(4)]
    assert tuple(heard[0]) == ("wave", "exact", "peaks", "two-phase", *TABLE)
    assert set(heard[0]) == set(METHODS)
    said = {method: league_summary.summary(heard, method) for method in METHODS}
    assert max(said["wave"].ratio) < 1.7  # 3 standard deviations of chance from 1
    assert min(said["wave"].covered) >= 9
    assert max(said["two-phase"].ratio) < 1.8
    assert said["wave"].rms[1] < min(
        said[name].rms[1] for name in ("peaks", "describing", "areas", "fourier")
    )
    assert hear(QUICK[3], 1, compared=False)["wave"] == heard[1]["wave"]


def test_what_is_far_off_counts_as_no_answer():
    far = league_runs._judged([0.1, 0.1], [1.5, math.nan, 0.0, math.nan])
    assert (far.quality, far.numbers) == ("far off", None)
    near = league_runs._judged([0.1, 0.1], [0.5, math.nan, -0.25, math.nan])
    heard = [{"describing": far}, {"describing": near}, {"describing": near}]
    s = league_summary.summary(heard, "describing")
    assert (s.runs, s.good, s.words, s.covered) == (3, 2, ["far off"], None)
    assert (s.bias, s.sd) == ((0.5, -0.25), (0.0, 0.0))
    assert s.ratio == pytest.approx((5.0, 2.5))
    assert league_summary.summary(heard, "wave") is None


def said_by(wave: float, other: float) -> list[dict[str, Said]]:
    """Runs whose errors are that many bounds, up and down in turn."""
    names = {"wave": wave, "describing": other, "asymmetric, told": 2.0 * wave}
    return [
        {name: Said("ok", [0.01, 0.01], [x * 0.01 * (-1) ** k, 0.01] * 2) for name, x in names.items()}
        for k in range(400)
    ]


def test_the_verdict_tells_where_the_goals_are_missed():
    found = {QUICK[3].name: said_by(1.0, 6.0), QUICK[4].name: said_by(1.5, 6.0)}
    text = league_summary.verdict(found)
    assert "omega_n: RMS of `wave` over the bound is 1.275, 2 cases" in text
    assert "beyond chance in 1: zeta 0.45 omega_n Ts 0.0725 noise % 1." in text
    assert "best of all others: RMS over that of `wave` 2.0" in text
    assert "best of those without a fit of the whole response: RMS over that of `wave` 5.0" in text
    assert "at least 5 in 1 of 2 cases" in text
    goals = league_summary.goals(found)
    assert "| 1.50 ± 0.10 |" in goals
    assert "2.0 (asymmetric, told)" in goals
    assert "4.0 (describing)" in goals


def results() -> dict[str, list[dict[str, Said]]]:
    """Of all cases, as a run keeps them."""
    clean = [{name: Said("ok", [0.0, 0.0], [0.001, 0.0, -0.002, 0.0]) for name in METHODS}] * 3
    return {case.name: said_by(1.0, 6.0) if case.noise else clean for case in (*GRID, *VARIED)}


@pytest.fixture(scope="module")
def fonts(tmp_path_factory):
    """matplotlib opens its fonts once and keeps them."""
    league.draw(results(), tmp_path_factory.mktemp("fonts"))


@pytest.mark.slow
@pytest.mark.usefixtures("fonts")
def test_all_tables_are_made_of_what_there_is(tmp_path):
    silent = [{"wave": Said("asymmetric", [0.01, 0.01])} for _ in range(5)]
    found = results()
    found[QUICK[4].name] = silent
    parts = league.tables(found)
    assert "No answer of `wave` that is `ok`: zeta 0.45" in parts["verdict"]
    assert "`asymmetric`" in parts["goals"]
    assert "| -0.2 |" in parts["bias-zeta"]
    league.draw(found, tmp_path)
    assert len(list(tmp_path.glob("league-*.png"))) == 4


def test_what_is_done_already_is_not_done_again(tmp_path, monkeypatch, capsys):
    asked = []

    def line(case, block, digest):
        asked.append((case, block))
        heard = [{"wave": Said("ok", [1.0, 1.0], [0.0, 1.0, 0.0, 1.0])}]
        return json.dumps({"case": case.name, "block": block, "digest": digest, "heard": heard})

    monkeypatch.setattr(league_runs, "line", line)
    options = Namespace(
        quick=True, only="", file=tmp_path / "found.jsonl", scheduler="local", workers=0, runs=20
    )
    kept_runs.work(league_runs, league.tasks(options), options, "abc")
    assert len(asked) == len(QUICK)
    kept = options.file.read_text()
    options.file.write_text(kept[: kept.rindex("heard")])  # as if it had been killed in the last line
    kept_runs.work(league_runs, league.tasks(options), options, "abc")
    assert len(asked) == len(QUICK) + 1
    kept_runs.work(league_runs, league.tasks(options), options, "other sources")
    assert len(asked) == 2 * len(QUICK) + 1
    found = league_runs.read(options.file, "abc")
    assert found[QUICK[0].name][0][0]["wave"].quality == "ok"
    options.quick = False
    names = [case.name for case, _ in league.tasks(options)]
    noisy = {case.name for case in (*GRID, *VARIED) if case.noise}
    assert all(names.count(name) == (2 if name in noisy else 1) for name in names)
    assert len(set(names)) == 24 + 2 * 27
