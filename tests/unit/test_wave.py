"""`wave` fed row by row: values with true intervals, words, window; plants of scipy and of the kernel."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from relay_truth import E_A, K_L, PLANTS, TICK, Loop, amplitude_of, rows, settings

from seod.config.resolution import resolution_of
from seod.config.sensors import AbsoluteEncoderConfig, IncrementalEncoderConfig, LinearConfig
from seod.estimate import make_estimator
from seod.estimate.base import Estimate, Row
from seod.estimate.wave import estimator as wave
from seod.estimate.wave.answer import repeating_counts
from sim.parameters import parameters
from sim.runs import RELAY, sampled_relay
from sim.state import new_state

pytestmark = pytest.mark.slow


def run(feed: list[Row], loop: Loop | None = None, **known) -> list[Estimate]:
    estimator = make_estimator(settings("wave", loop, **known))
    return [estimate for row in feed if (estimate := estimator.update(row))]


@lru_cache
def run_loop(loop: Loop, seconds: float) -> list[Estimate]:
    return run(rows(loop, seconds), loop)


def good(answers: list[Estimate]) -> list[Estimate]:
    return [a for a in answers if a.quality == "ok"]


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
@pytest.mark.parametrize(
    "changes",
    [
        {"delay": 0.0},
        {"delay": 3.0, "hysteresis": 0.1, "noise": 0.002},
        {"jitter": 0.5, "loss": 0.1, "noise": 0.01},
        {"load": 0.15, "noise": 0.01},
        {"noise": 0.05, "hysteresis": 0.2},
    ],
    ids=str,
)
def test_the_truth_lies_where_the_answer_says(zeta, omega_n, changes):
    answers = good(
        run_loop(Loop(zeta, omega_n, **{"delay": 1.0, "start": 0.2} | changes), 45.0 / omega_n + 0.5)
    )
    assert len(answers) > 10
    for name, truth in (("omega_n", omega_n), ("zeta", zeta)):
        z = [(getattr(a, name) - truth) / getattr(a, f"{name}_sd") for a in answers]
        assert np.max(np.abs(z)) < 4.5
        assert math.sqrt(np.mean(np.square(z))) < 2.0  # neighbours share their samples


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_the_first_good_answer_comes_within_two_cycles(zeta, omega_n):
    first = good(run_loop(Loop(zeta, omega_n, 1.0, noise=0.01, start=0.5), 1.5))[0]
    assert first.t - 50.0 < 2.05 * 2.0 * math.pi / first.frequency
    assert first.zeta == pytest.approx(zeta, rel=0.03)


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_a_start_from_rest_ends_in_the_right_valley(zeta, omega_n):
    for seed in range(6):
        last = run_loop(Loop(zeta, omega_n, 1.0, noise=0.002, seed=seed), 0.6)[-1]
        assert last.quality == "ok"
        assert last.zeta == pytest.approx(zeta, rel=0.01)


def test_an_answer_tells_all_that_a_fit_can():
    loop = Loop(*PLANTS[0], delay=1.0, noise=0.005, start=0.2)
    last = run(rows(loop, 1.0), loop, K_L_sd=0.3, delay_sd=2e-4)[-1]
    assert last.quality == "ok"
    assert last.advice is None
    assert last.frequency == pytest.approx(0.98 * 117.0, rel=0.03)
    assert last.amplitude == pytest.approx(amplitude_of(*PLANTS[0]), rel=0.06)
    assert 0.0 < last.K_L_sd <= 0.31
    assert abs(last.K_L - K_L) < 3.0 * last.K_L_sd
    assert abs(last.delay_s) < 1e-3
    assert set(last.correlation) == {f"omega_n,{x}" for x in ("zeta", "K_L", "delay")} | {
        "zeta,K_L",
        "zeta,delay",
        "K_L,delay",
    }
    assert last.correlation["zeta,K_L"] > 0.5  # the amplitude tells their ratio
    assert last.lag_s == pytest.approx(0.5 * 4.5 * 2.0 * math.pi / last.frequency, rel=0.3)
    assert last.misfit < 0.01
    assert 0.97 < last.fitness <= 1.0
    assert abs(last.mean_speed) < 0.1


def test_a_certain_gain_has_no_deviation():
    last = run_loop(Loop(*PLANTS[0], delay=1.0, noise=0.005, start=0.2), 1.0)[-1]
    assert (last.K_L, last.K_L_sd, last.delay_s) == (K_L, 0.0, 0.0)
    assert set(last.correlation) == {"omega_n,zeta"}


def joined(first: Loop, second: Loop, seconds: float) -> list[Row]:
    """The plant changes at its set point's crossing: the second loop's rows after those of the first."""
    before, after = rows(first, seconds), rows(second, seconds)
    shift = before[-1].t + TICK - after[0].t
    return [*before, *(r._replace(t=r.t + shift, t_u=r.t_u + shift) for r in after)]


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_a_step_of_omega_n_is_followed_within_two_cycles(noise):
    feed = joined(Loop(0.3, 100.0, 1.0, noise=noise), Loop(0.3, 120.0, 1.0, noise=noise, seed=2), 1.0)
    change = feed[2000].t
    answers = run(feed)
    period = 2.0 * math.pi / good(answers)[-1].frequency
    later = [a for a in answers if a.t > change + 2.1 * period]
    assert all(abs(a.omega_n - 120.0) < max(5.0 * a.omega_n_sd, 0.6) for a in later)
    assert all(a.quality == "ok" for a in later)
    lags = [a.lag_s for a in answers if a.lag_s]
    assert min(a.lag_s for a in later) < 0.6 * max(lags)
    assert later[-1].lag_s == pytest.approx(max(lags), rel=0.25)  # and the window grows again


# ---- on the kernel


@lru_cache
def kernel(effect: str, values: tuple[tuple[str, float], ...], noise: float, seed: int = 1) -> list[Estimate]:
    """One second of a plant with one effect under a sampled relay with a small hysteresis."""
    zeta, omega_n = PLANTS[1]
    record = parameters(K_L, omega_n, zeta, {effect: dict(values)} if effect else {})
    amplitude, t = amplitude_of(zeta, omega_n), TICK * np.arange(2000)
    relay = np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"], relay["latency"] = E_A, 0.1 * amplitude, TICK
    y, u, t_u, none = np.zeros(2000), np.zeros(2000), np.zeros(2000), np.zeros(0)
    disturbed = noise * amplitude * np.random.default_rng(seed).standard_normal(2000)
    sampled_relay(record[0], new_state(record)[0], relay[0], t, disturbed, none, none, none, y, u, t_u)
    feed = [Row(*map(float, x), 0.0, E_A, 0.0, exciting=True) for x in zip(t, y, u, t_u, strict=True)]
    return run(feed, hysteresis=0.1 * amplitude)


def after_the_start(answers: list[Estimate]) -> list[str]:
    return [a.quality for a in answers if a.t > 0.3]


@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_the_linear_plant_is_never_called_nonlinear(noise):
    words = [word for seed in range(8) for word in after_the_start(kernel("", (), noise, seed))]
    assert len(words) > 200
    assert words.count("nonlinear") == 0
    assert words.count("ok") > 0.98 * len(words)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("backlash", (("gap", 0.1 * amplitude_of(*PLANTS[1])),)),
        ("valve_lag", (("time", 1.5e-3),)),
        ("valve_hysteresis", (("half_width", 0.15),)),
        ("coulomb_friction", (("level", 5e-4 * K_L * E_A * 145.0**2),)),
        ("square_root_flow", (("supply", K_L * E_A * 145.0),)),
    ],
)
def test_what_is_not_linear_is_called_so(effect, values):
    answers = kernel(effect, values, 0.002)
    words = after_the_start(answers)
    assert words.count("nonlinear") > 0.7 * len(words), words
    assert answers[-1].misfit > 5e-4
    assert "seod ramp" in next(a.advice for a in answers if a.quality == "nonlinear")


def test_a_coarse_sensor_is_not_nonlinear():
    step = 0.03
    loop = Loop(*PLANTS[1], delay=1.0, step=step, noise=0.002)
    answers = run(rows(loop, 1.5), resolution=step * amplitude_of(*PLANTS[1]))
    words = [a.quality for a in answers][10:]
    assert words.count("nonlinear") + words.count("saturated") < 0.05 * len(words)
    z = [(a.zeta - 0.45) / a.zeta_sd for a in good(answers)]
    assert math.sqrt(np.mean(np.square(z))) < 2.0


def test_counts_that_repeat_widen_the_interval_and_dither_makes_them_average():
    assert repeating_counts(0.0, 1.0) == 0.0
    assert repeating_counts(1.0, 1.0 / math.sqrt(12.0)) == pytest.approx(1.0)
    assert repeating_counts(1.0, 1.0) < 1e-9
    loop = Loop(*PLANTS[1], delay=1.0, step=0.02, noise=0.0)
    coarse, fine = (
        run(rows(x, 1.0))[-1] for x in (loop, replace(loop, step=0.0, noise=0.02 / math.sqrt(12.0)))
    )
    assert coarse.zeta_sd > 1.1 * fine.zeta_sd


def test_a_slow_drift_is_followed_by_a_short_window():
    steady, drifting = (kernel("parameter_drift", (("omega_n", rate),), 0.002) for rate in (0.0, 0.3))
    assert drifting[-1].lag_s < 0.7 * steady[-1].lag_s
    truth = 145.0 * (1.0 + 0.3 * (drifting[-1].t - drifting[-1].lag_s))
    assert drifting[-1].omega_n == pytest.approx(truth, rel=0.01)
    assert drifting[-1].quality == "ok"


# ---- words


def test_a_clipped_sensor_is_saturated():
    assert run_loop(Loop(*PLANTS[1], clip=0.9), 1.0)[-1].quality == "saturated"


def test_a_strong_load_is_asymmetric():
    last = run_loop(Loop(*PLANTS[1], load=0.24), 2.0)[-1]
    assert last.quality == "asymmetric"
    assert last.asymmetry > 0.2


def test_a_wrong_gain_is_out_of_range():
    last = run(rows(Loop(*PLANTS[1]), 1.0), K_L=K_L / 100)[-1]
    assert last.quality in {"out_of_range", "nonlinear", "no_oscillation"}
    assert last.quality != "ok"


def test_an_actuator_that_stands_does_not_oscillate():
    feed = [Row(k * TICK, 1e-4, -E_A, k * TICK, 0.0, E_A, 0.0, exciting=True) for k in range(3000)]
    assert run(feed)[-1].quality == "no_oscillation"


def test_a_relay_that_never_switches_fills_no_memory(monkeypatch):
    monkeypatch.setattr(wave, "MOST_SAMPLES", 1000)
    estimator = make_estimator(settings("wave", delay_sd=1e-4))
    for k in range(20_000):
        u = -E_A * (1.0 + 0.1 * (k % 2))  # the bias moves
        estimator.update(Row(k * TICK, 1e-4, u, k * TICK, 0.0, E_A, 0.0, exciting=True))
    assert len(estimator._samples) <= 1000
    assert len(estimator._voltages) <= 1001


def test_samples_that_never_change_bring_no_number():
    feed = [row._replace(y=0.5) for row in rows(Loop(*PLANTS[1]), 1.0)]
    assert all(a.zeta is None for a in run(feed) if a.quality == "ok") or not good(run(feed))


@pytest.mark.parametrize(
    ("sensor", "step"),
    [
        (
            IncrementalEncoderConfig(
                kind="incremental_encoder", channel="a", unit="rad", bits=16, counts_per_rev=-4000.0
            ),
            math.pi / 2000,
        ),
        (
            IncrementalEncoderConfig(
                kind="incremental_encoder", channel="a", unit="mm", bits=16, counts_per_unit=200.0
            ),
            5e-6,
        ),
        (AbsoluteEncoderConfig(kind="absolute_encoder", channel="a", unit="rad", bits=12), math.pi / 2048),
        (LinearConfig(channel="a", unit="rad"), 0.0),
    ],
)
def test_the_resolution_is_one_count(sensor, step):
    assert resolution_of(sensor) == pytest.approx(step)
