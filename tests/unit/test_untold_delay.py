"""Latencies that nobody told: live intervals hold the truth, and what windows told of the delay is kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_loop import rig_config
from relay_truth import E_A, K_L, PLANTS, TICK, Loop, rows, settings

from drivers.base import StampError
from seod.config.axis import EstimatorConfig
from seod.estimate import make_estimator
from seod.estimate.advice import of_estimate
from seod.estimate.base import Estimate, Row
from seod.estimate.known import Known
from seod.estimate.wave.delay_memory import DelayMemory
from seod.identify.live import Beforehand, _mean
from seod.observe.estimation import Axis
from seod.observe.timing import Timing
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH

NAN = math.nan
SEEDS = 8


def axis(timing: Timing | None = None, **estimator) -> Axis:
    """As of a rig file that says nothing of the delay."""
    config = rig_config().axes["motor"]
    config = config.model_copy(update={"estimator": EstimatorConfig(**estimator)})
    return Axis("motor", config, TICK, make_estimator, timing=timing)


def untold(feed: list[Row], latency: float) -> list[Row]:
    """Commands that left earlier than they came to the plant, by so many ticks."""
    return [row._replace(t_u=row.t_u - latency * TICK) for row in feed]


def told_to(axis: Axis, feed: list[Row]) -> list[Estimate]:
    flags = FLAG_EXCITING | FLAG_FRESH
    block = [(r.t, r.y, 0.0, r.u, r.t_u, E_A, 0.0, -r.y, NAN, NAN, K_L, 3, flags) for r in feed]
    return [each for each in axis.feed(block) if each.quality == "ok"]


def surprise(answer: Estimate, zeta: float, omega_n: float) -> list[float]:
    return [
        (answer.omega_n - omega_n) / answer.omega_n_sd,
        (answer.zeta - zeta) / answer.zeta_sd,
    ]


@pytest.mark.slow
@pytest.mark.parametrize("latency", [0.0, 0.1, 1.0, 2.0])
@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_the_defaults_hold_the_truth_whatever_the_latency(zeta, omega_n, latency):
    z = []
    for seed in range(SEEDS):
        loop = Loop(zeta, omega_n, 1.0 + latency, noise=0.004, start=0.2, seed=seed)
        answers = told_to(axis(), untold(rows(loop, 80.0 / omega_n + 0.3), latency))
        z += [surprise(answers[k], zeta, omega_n) for k in (0, -1)]
        assert abs(answers[-1].delay_s - latency * TICK) < 4.5 * answers[-1].delay_sd_s
    assert np.max(np.abs(z)) < 4.5
    assert 0.5 < math.sqrt(np.mean(np.square(z))) < 1.5


@pytest.mark.slow
def test_windows_that_share_no_sample_narrow_the_interval():
    zeta, omega_n = PLANTS[1]
    feed = untold(rows(Loop(zeta, omega_n, 1.5, noise=0.01, seed=3), 2.0), 1.0)
    kept = told_to(axis(), feed)
    alone = told_to(axis(delay_sd="unknown"), feed)
    certain = told_to(axis(delay=TICK, delay_sd=0.0), feed)
    wide, middle, narrow = (each[-1].omega_n_sd for each in (alone, kept, certain))
    assert 2.5 * narrow < middle < 0.5 * wide
    assert certain[-1].delay_sd_s == 0.0
    assert all(max(np.abs(surprise(each[-1], zeta, omega_n))) < 4.0 for each in (alone, kept, certain))


def test_a_delay_that_jumps_is_believed_anew():
    zeta, omega_n = PLANTS[2]
    loop = Loop(zeta, omega_n, 3.0, noise=0.002, seed=5)
    early = untold(rows(loop, 2.0), 0.0)
    whole = early[: len(early) // 2] + untold(early[len(early) // 2 :], 2.0)
    answers = told_to(axis(), whole)
    before = next(a for a in reversed(answers) if a.t < early[len(early) // 2].t)
    for answer, delay in ((before, 0.0), (answers[-1], 2.0 * TICK)):
        assert abs(answer.delay_s - delay) < 4.0 * answer.delay_sd_s < 2.0 * TICK
        assert max(np.abs(surprise(answer, zeta, omega_n))) < 4.0


def shifted(feed: list[Row], seconds: float) -> list[Row]:
    return [row._replace(t=row.t + seconds, t_u=row.t_u + seconds) for row in feed]


@pytest.mark.parametrize(("setting", "keeps"), [({"e_a": E_A}, True), ({"K_L": 1.001 * K_L}, False)])
def test_another_excitation_begins_with_the_delay_that_was_learnt(setting, keeps):
    feed = untold(rows(Loop(*PLANTS[1], 1.5, noise=0.01, seed=3), 1.5), 1.0)
    rig = axis()
    rig.change({"e_a": 0.3})
    first = told_to(rig, feed)[0]
    rig.change(setting)
    again = told_to(rig, shifted(feed, 2.0))[0]
    assert (again.delay_sd_s < 0.6 * first.delay_sd_s) is keeps


# ---- the memory by itself


class Told:
    """What an answer tells of the delay."""

    def __init__(self, begin: float, end: float, before: Known, delay: float, sd: float) -> None:
        self.window = type("window", (), {"t": np.array([begin, end]), "delay": before})
        self.fit = type("fit", (), {"delay": delay})
        self._sd = sd

    def sd(self, name: str) -> float:
        assert name == "delay"
        return self._sd


def test_only_windows_without_common_samples_hear_of_each_other():
    memory = DelayMemory(Known(0.0, 1e-3), 0.0)
    assert memory.before(0.0, 1.0) == Known(0.0, 1e-3)
    memory.learn(Told(0.0, 1.0, memory.prior, 3e-4, 2e-4))
    assert memory.before(0.5, 1.5) == Known(0.0, 1e-3)
    memory.learn(Told(0.5, 1.5, memory.prior, 9e-4, 1.9e-4))  # hardly more than the one before
    assert memory.before(1.0, 2.0) == Known(3e-4, pytest.approx(2e-4))
    memory.learn(Told(1.0, 2.0, memory.known, 4e-4, 1e-4))
    assert memory.before(1.5, 2.5).value == 3e-4
    assert memory.before(2.0, 3.0) == Known(4e-4, pytest.approx(1e-4))


def test_a_window_that_tells_more_takes_the_place_of_one_that_waits():
    memory = DelayMemory(Known(0.0, 1e-3), 0.0)
    memory.learn(Told(0.0, 1.0, memory.prior, 3e-4, 4e-4))
    memory.learn(Told(0.2, 1.5, memory.prior, 5e-4, 1e-4))
    assert memory.before(1.2, 2.0) == Known(0.0, 1e-3)
    assert memory.before(1.5, 2.0) == Known(5e-4, pytest.approx(1e-4))


def test_what_is_known_of_a_delay_fades_but_to_what_was_told():
    memory = DelayMemory(Known(0.0, 1e-3), 1e-4)
    memory.learn(Told(0.0, 1.0, memory.prior, 3e-4, 1e-4))
    assert memory.before(1.0, 10.0).sd == pytest.approx(1e-4 * math.sqrt(10.0))
    assert memory.before(1.0, 1e6).sd == 1e-3


@pytest.mark.parametrize("sd", [0.0, math.inf])
def test_nothing_is_kept_of_a_delay_that_is_certain_or_unknown(sd):
    memory = DelayMemory(Known(2e-4, sd), 1e-4)
    memory.learn(Told(0.0, 1.0, memory.prior, 3e-4, 1e-4))
    assert memory.before(5.0, 6.0) == Known(2e-4, sd)


def test_a_contradiction_is_judged_by_what_the_window_itself_tells():
    memory = DelayMemory(Known(0.0, 1e-3), 0.0)
    before = Known(3e-4, 2e-4)
    told = Told(0.0, 1.0, before, 3e-4 + 3.5e-4, 1.6e-4)
    assert not memory.contradicts(told)  # 2.9 deviations
    assert memory.contradicts(Told(0.0, 1.0, before, 3e-4 + 5e-4, 1.6e-4))
    assert not memory.contradicts(Told(0.0, 1.0, memory.prior, 9e-3, 1e-4))  # nothing was handed to it


def test_time_that_runs_back_forgets():
    memory = DelayMemory(Known(0.0, 1e-3), 0.0)
    memory.learn(Told(10.0, 11.0, memory.prior, 3e-4, 1e-4))
    assert memory.before(11.0, 12.0).value == 3e-4
    assert memory.before(1.0, 2.0) == Known(0.0, 1e-3)


# ---- what else states deviations


def test_exact_is_as_unsure_as_the_delay_and_the_gain():
    zeta, omega_n = PLANTS[1]
    feed = untold(rows(Loop(zeta, omega_n, 2.0, noise=0.002, seed=2), 1.2), 1.0)

    def last(**known) -> Estimate:
        estimator = make_estimator(settings("exact", **known))
        return [each for row in feed if (each := estimator.update(row))][-1]

    certain, doubtful, gain = last(), last(delay_sd=2.0 * TICK), last(K_L_sd=0.02 * K_L)
    assert abs(certain.omega_n - omega_n) > 5.0 * certain.omega_n_sd
    assert max(np.abs(surprise(doubtful, zeta, omega_n))) < 1.5
    assert gain.zeta_sd > 0.01 * zeta
    assert (last(delay_sd=math.inf).zeta_sd, last(K_L_sd=math.inf).zeta_sd) == (None, None)


def test_peaks_state_none():
    estimator = make_estimator(settings("peaks"))
    feed = rows(Loop(*PLANTS[1], 1.0, noise=0.002), 1.2)
    last = [each for row in feed if (each := estimator.update(row))][-1]
    assert last.quality == "ok"
    assert (last.omega_n_sd, last.zeta_sd, last.delay_sd_s) == (None, None, None)


def test_a_mean_of_windows_does_not_average_what_they_share():
    def answer(t: float, omega_n: float) -> Estimate:
        told = {"omega_n,delay": 0.8, "zeta,delay": 0.0}
        return Estimate(t, "wave", "ok", 0.5, 0.01, omega_n, 1.0, 17.0, 0.0, 1e-4, 2e-5, correlation=told)

    apart = [answer(-t, 100.0 + 0.1 * (-1) ** t) for t in range(100)]
    value, sd = _mean(apart, Beforehand(17.0, delay_sd=1e-3))
    assert value["omega_n"] == pytest.approx(100.0)
    assert sd["omega_n"] == pytest.approx(math.hypot(0.8, 0.06), rel=1e-3)
    assert sd["zeta"] == pytest.approx(0.001, rel=1e-3)
    assert (value["delay"], sd["delay"]) == (1e-4, 2e-5)
    _, alone = _mean(apart, Beforehand(17.0, delay_sd=math.inf))
    assert alone["omega_n"] == pytest.approx(0.1)


def test_gains_are_advised_for_the_longest_likely_delay():
    told = {"quality": "ok", "omega_n": 117.0, "zeta": 0.21, "K_L": 17.0, "delay_s": 1e-3}
    sure, doubtful = (of_estimate({**told, "delay_sd_s": sd}) for sd in (0.0, 1e-3))
    later = of_estimate({**told, "delay_s": 1e-3 * (1.0 + 1.96), "delay_sd_s": 0.0})
    assert doubtful["velocity_gain_limit"] == pytest.approx(later["velocity_gain_limit"])
    assert doubtful["velocity_gain_limit"] < sure["velocity_gain_limit"]


# ---- stamps


def stamped(scatter: float) -> Timing:
    return Timing(0.0, lambda: StampError(0.0, scatter))


def test_stamps_that_scatter_much_are_told():
    answer = Estimate(1.0, "wave", "ok", 0.21, 1e-4, 117.0, 0.01, frequency=115.0)
    told = stamped(1.5e-3).weigh(answer)
    assert told.quality == "noisy"
    assert "1.5 ms" in told.advice
    assert stamped(NAN).weigh(answer) == answer
    little = stamped(2e-4).weigh(answer)
    assert little.quality == "ok"
    assert little.omega_n_sd > 5e-4 * 117.0


@pytest.mark.parametrize(
    ("quality", "told"),
    [("ok", "noisy"), ("nonlinear", "noisy"), ("fault", "fault"), ("settling", "settling")],
)
def test_what_repeats_under_stamps_that_scatter_is_no_nonlinear_plant(quality, told):
    answer = Estimate(1.0, "wave", quality, 0.21, 1e-4, 117.0, 0.01, frequency=115.0)
    assert stamped(1.5e-3).weigh(answer).quality == told
    assert stamped(2e-4).weigh(answer).quality == quality


def test_stamps_that_are_off_together_are_a_delay():
    assert Timing(1e-3, lambda: StampError(1e-3, 0.0)).delay_sd == pytest.approx(math.sqrt(2.0) * 1e-3)
    assert axis(Timing(3e-3))._estimator_settings().delay_sd == 3e-3
    assert axis(Timing(3e-3), delay_sd=1e-5)._estimator_settings().delay_sd == 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_scattered_stamps_are_covered(zeta, omega_n):
    scatter = 0.05 / omega_n
    z = []
    for seed in range(SEEDS):
        loop = Loop(zeta, omega_n, 1.0, noise=0.002, start=0.2, seed=seed, tick=2e-3)
        feed = rows(loop, 120.0 / omega_n + 0.5)
        off = scatter * np.clip(np.random.default_rng(seed).standard_normal(len(feed)), -2.0, 2.0)
        feed = [row._replace(t=row.t + float(x)) for row, x in zip(feed, off, strict=True)]
        z.append(surprise(told_to(axis(stamped(scatter)), feed)[-1], zeta, omega_n))
    assert np.max(np.abs(z)) < 4.0
