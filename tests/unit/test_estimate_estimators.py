"""Both estimators on sampled relay loops: values, quality words, resets, and nonsense."""

from __future__ import annotations

import math
from dataclasses import fields
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from relay_truth import E_A, K_L, PLANTS, TICK, Loop, amplitude_of, rows, settings

from seod.estimate import make_estimator
from seod.estimate.base import QUALITIES, Estimate, Row


def run(feed: list[Row], **known) -> list[Estimate]:
    estimator = make_estimator(settings(**known))
    return [estimate for row in feed if (estimate := estimator.update(row))]


@lru_cache
def run_loop(loop: Loop, seconds: float, method: str = "exact", cycles: int = 4) -> list[Estimate]:
    return run(rows(loop, seconds), method=method, loop=loop, cycles=cycles)


def errors(loop: Loop, seconds: float, method: str = "exact") -> tuple[float, float]:
    """Mean relative errors of omega_n and zeta, over the answers that are ok, in %."""
    good = [e for e in run_loop(loop, seconds, method) if e.quality == "ok"]
    assert len(good) > 5
    return (
        100.0 * float(np.mean([e.omega_n / loop.omega_n - 1.0 for e in good])),
        100.0 * float(np.mean([e.zeta / loop.zeta - 1.0 for e in good])),
    )


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_exact_is_unbiased_whatever_the_known_delay(zeta, omega_n, delay):
    wn, z = errors(Loop(zeta, omega_n, delay, start=0.2), 1.2)
    assert abs(wn) < 0.2
    assert abs(z) < 0.3


@pytest.mark.parametrize(("zeta", "omega_n"), PLANTS)
def test_exact_is_unbiased_with_noise_hysteresis_and_load(zeta, omega_n):
    wn, z = errors(Loop(zeta, omega_n, 1.0, noise=0.01, hysteresis=0.1, load=0.05), 1.5)
    assert abs(wn) < 0.3
    assert abs(z) < 0.5


@pytest.mark.parametrize(
    "loop",
    [
        Loop(0.45, 145.0, 1.0, jitter=0.5),
        Loop(0.45, 145.0, 1.0, loss=0.1),
        Loop(0.45, 145.0, 1.0, step=0.01),
        Loop(0.45, 145.0, 2.7, noise=0.05, hysteresis=0.15),
        Loop(0.45, 400.0, 0.0),
        Loop(0.45, 400.0, 1.0),
        Loop(0.45, 12.0, 1.0),
        Loop(0.03, 145.0, 1.0, start=0.9),
        Loop(2.0, 145.0, 1.0),
    ],
    ids=["jitter", "loss", "steps", "noise", "coarse", "coarse-late", "fine", "light", "heavy"],
)
def test_exact_stands_what_rigs_do(loop):
    seconds = 6.0 if loop.omega_n < 20 else 2.5 if loop.zeta < 0.1 else 1.2
    wn, z = errors(loop, seconds)
    assert abs(wn) < 1.0
    assert abs(z) < 1.5


def test_exact_knows_what_its_own_fits_mistake_at_the_kinks_of_a_damped_motion():
    wn, z = errors(Loop(1.5, 100.0, 2.3, hysteresis=0.1, start=0.9), 1.5)
    assert abs(wn) < 0.25
    assert abs(z) < 0.25


def test_exact_takes_the_delay_that_it_is_told():
    loop = Loop(0.45, 145.0, 3.0)
    early = [row._replace(t_u=row.t_u - 2 * TICK) for row in rows(loop, 1.2)]
    told = run(early, loop=loop, delay_s=2 * TICK)[-1]
    untold = run(early, loop=loop)[-1]
    assert told.omega_n == pytest.approx(145.0, rel=3e-3)
    assert told.delay_s == pytest.approx(3.5 * TICK, abs=0.6 * TICK)
    assert untold.omega_n < 0.96 * 145.0


@pytest.mark.parametrize(
    ("plant", "wn", "z"), [(PLANTS[0], -1.7, -1.7), (PLANTS[1], -4.5, -4.6), (PLANTS[2], -3.0, -2.7)]
)
def test_peaks_errs_as_the_paper_s_arithmetic_does(plant, wn, z):
    found = errors(Loop(*plant, delay=1.0), 1.5, "peaks")
    assert found == pytest.approx((wn, z), abs=0.7)


@pytest.mark.parametrize("lowpass", [None, 200.0])
def test_peaks_are_not_broken_by_noise(lowpass):
    loop = Loop(*PLANTS[1], delay=1.0, noise=0.01)
    clean = run(rows(Loop(*PLANTS[1], delay=1.0), 1.2), method="peaks", lowpass_hz=lowpass)[-1]
    noisy = [e for e in run(rows(loop, 1.2), method="peaks", lowpass_hz=lowpass) if e.quality == "ok"]
    assert len(noisy) > 20
    assert np.mean([e.omega_n for e in noisy]) == pytest.approx(clean.omega_n, rel=0.02)
    assert np.mean([e.zeta for e in noisy]) == pytest.approx(clean.zeta, rel=0.03)


@pytest.mark.slow
def test_ninety_five_percent_intervals_cover_the_truth():
    inside = []
    for seed in range(18):
        loop = Loop(*PLANTS[seed % 3], delay=1.0 + seed % 2, noise=0.01, start=0.5, seed=seed)
        last = run_loop(loop, 0.55 if loop.omega_n > 100 else 1.1)[-1]
        inside.append(abs(last.omega_n - loop.omega_n) < 1.96 * last.omega_n_sd)
        inside.append(abs(last.zeta - loop.zeta) < 1.96 * last.zeta_sd)
        assert last.omega_n_sd < 0.01 * loop.omega_n
        assert last.zeta_sd < 0.015 * loop.zeta
    assert np.mean(inside) > 0.85


@pytest.mark.parametrize("method", ["peaks", "exact"])
def test_an_answer_each_half_cycle_from_settling_to_ok(method):
    answers = run_loop(Loop(*PLANTS[0], delay=1.0, start=0.2), 1.2, method)
    words = [e.quality for e in answers]
    first = words.index("ok")
    assert set(words[:first]) == {"settling"}
    assert set(words[first:]) == {"ok"}
    assert np.diff([e.t for e in answers[-10:]]) == pytest.approx(math.pi / answers[-1].frequency, rel=0.1)
    ok = answers[-1]
    assert ok.advice is None
    assert answers[0].advice
    assert ok.method == method
    assert ok.frequency == pytest.approx(0.98 * 117.0, rel=0.02)
    assert ok.amplitude == pytest.approx(amplitude_of(*PLANTS[0]), rel=0.06)
    assert ok.K_L == K_L
    assert abs(ok.mean_speed) < 1e-3
    assert abs(ok.asymmetry) < 0.01
    assert 0.9 < ok.fitness <= 1.0


def test_settling_lasts_as_long_as_the_limit_cycle_grows():
    slow = [e for e in run_loop(Loop(0.05, 117.0, 1.0), 1.6) if e.quality == "ok"]
    quick = [e for e in run_loop(Loop(0.45, 145.0, 1.0), 1.2) if e.quality == "ok"]
    assert slow[0].t > quick[0].t + 0.3
    assert slow[0].zeta == pytest.approx(0.05, rel=0.03)


def test_fitness_tells_a_good_model_from_a_bad_one():
    loop = Loop(*PLANTS[1], delay=3.0)
    exact, peaks = (run_loop(loop, 1.2, m)[-1].fitness for m in ("exact", "peaks"))
    assert exact > 0.99 > 0.9 > peaks


def last_word(feed: list[Row], **known) -> Estimate:
    return run(feed, **known)[-1]


@pytest.mark.parametrize("method", ["peaks", "exact"])
class TestQuality:
    def test_asymmetric(self, method):
        last = last_word(rows(Loop(*PLANTS[1], load=0.15), 1.2), method=method)
        assert last.quality == "asymmetric"
        assert last.asymmetry == pytest.approx(0.15, abs=0.02)
        assert "bias" in last.advice

    @pytest.mark.slow
    def test_chatter_is_noisy_and_asks_for_hysteresis(self, method):
        last = last_word(rows(Loop(0.45, 20.0, noise=0.05), 3.0), method=method)
        assert last.quality == "noisy"
        assert "hysteresis" in last.advice

    def test_hysteresis_cures_the_chatter(self, method):
        loop = Loop(0.45, 20.0, noise=0.05, hysteresis=0.25)
        assert last_word(rows(loop, 4.0), method=method, loop=loop).quality == "ok"

    def test_saturated(self, method):
        assert last_word(rows(Loop(*PLANTS[1], clip=0.9), 1.2), method=method).quality == "saturated"

    def test_out_of_range(self, method):
        last = last_word(rows(Loop(*PLANTS[1]), 1.2), method=method, K_L=K_L / 100)
        assert last.quality == "out_of_range"
        assert last.zeta is None
        assert last.omega_n is None

    def test_stale_and_back(self, method):
        good = rows(Loop(*PLANTS[1]), 1.0)
        held = [good[-1]._replace(t_u=good[-1].t_u + k * TICK, fresh=False) for k in range(1, 200)]
        later = [r._replace(t=r.t + 1.1, t_u=r.t_u + 1.1) for r in good]
        words = [e.quality for e in run([*good, *held, *later], method=method)]
        assert words.count("stale") == 1
        assert words[words.index("stale") - 1] == "ok"
        assert words[words.index("stale") + 1] == "settling"
        assert words[-1] == "ok"

    def test_an_actuator_that_stands(self, method):
        feed = [Row(k * TICK, 1e-4, -E_A, k * TICK, 0.0, E_A, 0.0, exciting=True) for k in range(3000)]
        last = last_word(feed, method=method)
        assert last.quality == "no_oscillation"
        assert "does not move" in last.advice
        assert "raise e_a" in last.advice

    def test_an_actuator_that_runs_away(self, method):
        feed = [
            Row(k * TICK, 1e-3 + 2.0 * k * TICK, -E_A, k * TICK, 0.0, E_A, 0.0, exciting=True)
            for k in range(3000)
        ]
        last = last_word(feed, method=method)
        assert last.quality == "no_oscillation"
        assert "one way" in last.advice
        assert "raise e_a" in last.advice

    def test_an_actuator_stuck_in_noise(self, method):
        last = last_word(rows(Loop(*PLANTS[1], friction=True, noise=0.02), 2.0), method=method)
        assert last.quality == "no_oscillation"
        assert last.zeta is None
        assert "raise e_a" in last.advice


@pytest.mark.parametrize("method", ["peaks", "exact", "wave"])
@pytest.mark.parametrize(
    "broken",
    [
        lambda r: r._replace(e_a=2 * r.e_a, u=2 * r.u),
        lambda r: r._replace(reference=r.reference + 1e-3),
        lambda r: r._replace(t=r.t + 0.5, t_u=r.t_u + 0.5),
        lambda r: r._replace(t=r.t - 3.0, t_u=r.t_u - 3.0),
    ],
    ids=["e_a", "set point", "gap", "time runs back"],
)
def test_a_break_starts_anew(method, broken):
    feed = rows(Loop(*PLANTS[1]), 0.5)
    estimator = make_estimator(settings(method))
    before = [e for row in feed if (e := estimator.update(row))]
    after = estimator.update(broken(feed[-1]._replace(t=feed[-1].t + TICK, t_u=feed[-1].t_u + TICK)))
    assert before[-1].quality == "ok"
    assert after.quality == "settling"
    assert after.zeta is None


def test_a_pause_of_the_excitation_starts_anew():
    feed = rows(Loop(*PLANTS[1]), 0.5)
    estimator = make_estimator(settings())
    assert [e for row in feed if (e := estimator.update(row))][-1].quality == "ok"
    assert estimator.update(feed[-1]._replace(exciting=False, e_a=0.0)) is None
    later = [row._replace(t=row.t + 1.0, t_u=row.t_u + 1.0) for row in feed]
    assert next(e for row in later if (e := estimator.update(row))).quality == "settling"


def test_reset_forgets():
    feed = rows(Loop(*PLANTS[1]), 0.5)
    estimator = make_estimator(settings())
    first = [estimator.update(row) for row in feed]
    estimator.reset()
    assert [estimator.update(row) for row in feed] == first


@pytest.mark.parametrize("method", ["peaks", "exact"])
def test_a_start_from_far_away_is_got_over(method):
    answers = run_loop(Loop(*PLANTS[1], start=30.0, noise=0.005), 2.2, method)
    assert answers[-1].quality == "ok"
    assert answers[-1].omega_n == pytest.approx(145.0, rel=0.08)


def test_few_cycles_answer_sooner():
    loop = Loop(*PLANTS[2], start=0.9)
    first = [next(e.t for e in run_loop(loop, 2.0, cycles=n) if e.quality == "ok") for n in (2, 8)]
    assert first[0] < first[1] - 0.3


def test_unknown_methods_are_told():
    with pytest.raises(ValueError, match="expected one of peaks, exact"):
        make_estimator(settings("magic"))


def is_clean(estimate: Estimate) -> bool:
    values = [getattr(estimate, f.name) for f in fields(estimate)]
    numbers = [v for v in values if isinstance(v, float)]
    deviations = [estimate.zeta_sd, estimate.omega_n_sd]
    return (
        all(math.isfinite(v) for v in numbers)
        and estimate.quality in QUALITIES
        and all(d is None or d >= 0.0 for d in deviations)
        and (estimate.fitness is None or 0.0 <= estimate.fitness <= 1.0)
        and (estimate.quality == "ok") == (estimate.advice is None)
    )


_number = st.one_of(st.floats(), st.sampled_from([0.0, 1e-300, -1e308, 1e8, math.nan, math.inf]))
_row = st.builds(
    Row, _number, _number, _number, _number, _number, _number, _number, st.booleans(), st.booleans()
)


@pytest.mark.slow
@hypothesis_settings(max_examples=60, deadline=None)
@given(st.lists(_row, max_size=40), st.sampled_from(["peaks", "exact", "wave"]))
def test_nonsense_rows_are_survived(feed, method):
    assert all(is_clean(e) for e in run(feed, method=method))


_step = st.tuples(st.sampled_from([1e-9, 1e-4, 5e-4, 0.01]), st.floats(-1e8, 1e8) | st.floats(-1e-3, 1e-3))


@hypothesis_settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(_step, st.integers(1, 9), st.booleans()), min_size=5, max_size=60),
    st.sampled_from(["peaks", "exact", "wave"]),
    st.sampled_from([1e-9, 1.0, 1e9]),
)
def test_any_motion_under_a_switching_relay_is_survived(runs, method, gain):
    feed, t, up = [], 0.0, True
    for (step, y), count, fresh in runs:
        up = not up
        for k in range(count):
            t += step
            feed.append(
                Row(t, y + k * step, E_A if up else -E_A, t, 0.0, E_A, 0.0, exciting=True, fresh=fresh)
            )
    assert all(is_clean(e) for e in run(feed, method=method, K_L=gain, cycles=1))


@pytest.mark.slow
@hypothesis_settings(max_examples=25, deadline=None)
@given(st.data(), st.sampled_from(["peaks", "exact", "wave"]))
def test_good_rows_with_some_spoilt_are_survived(data, method):
    feed = list(rows(Loop(*PLANTS[1]), 0.4))
    for _ in range(8):
        k = data.draw(st.integers(0, len(feed) - 1))
        name = data.draw(st.sampled_from(["t", "y", "u", "t_u", "e_a"]))
        feed[k] = feed[k]._replace(**{name: data.draw(_number)})
    assert all(is_clean(e) for e in run(feed, method=method))
