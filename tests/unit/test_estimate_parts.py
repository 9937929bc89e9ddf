"""Local fits, switches, and the judges of quality."""

from __future__ import annotations

import math

import numpy as np
import pytest

from seod.estimate.limit_cycle.local_fit import crossing, peak
from seod.estimate.limit_cycle.switches import Switch, SwitchTracker
from seod.estimate.quality import NoiseMeter, agree, clipped


def _sine(count: int, seed: int = 0, noise: float = 0.0, jitter: float = 0.0, loss: float = 0.0):
    """One and a half periods of sin(2 pi t), `count` samples a period."""
    rng = np.random.default_rng(seed)
    t = np.arange(-0.25, 1.25, 1.0 / count)
    t = np.sort(t + jitter / count * rng.uniform(-0.5, 0.5, len(t)))
    t = t[rng.random(len(t)) >= loss]
    return t, np.sin(2.0 * math.pi * t) + noise * rng.standard_normal(len(t))


@pytest.mark.parametrize("count", [20, 107, 3000])
@pytest.mark.parametrize(("jitter", "loss"), [(0.0, 0.0), (0.8, 0.15)])
def test_fits_find_a_sine_s_crossing_and_peak(count, jitter, loss):
    t, y = _sine(count, jitter=jitter, loss=loss)
    assert crossing(t, y, 0.0, 0.53, 0.125) == pytest.approx(0.5, abs=1e-3)
    assert crossing(t, y, 0.2, 0.46, 0.125) == pytest.approx(0.5 - math.asin(0.2) / (2 * math.pi), abs=1e-3)
    at, value = peak(t, y, 1, 0.3, 0.175)
    assert (at, value) == (pytest.approx(0.25, abs=0.01), pytest.approx(1.0, abs=1e-3))
    assert peak(t, y, -1, 0.7, 0.175)[1] == pytest.approx(-1.0, abs=1e-3)


def test_noise_averages_out_where_the_highest_sample_would_mislead():
    fitted, highest, crossed = [], [], []
    for seed in range(60):
        t, y = _sine(107, seed, noise=0.05)
        fitted.append(peak(t, y, 1, 0.25, 0.175)[1])
        highest.append(y[(t > 0.1) & (t < 0.4)].max())
        crossed.append(crossing(t, y, 0.0, 0.5, 0.125))
    assert abs(np.mean(fitted) - 1.0) < 0.01 < 0.05 < np.mean(highest) - 1.0
    assert np.mean(crossed) == pytest.approx(0.5, abs=1e-3)


def test_fits_say_when_samples_are_missing_or_nothing_crosses():
    t, y = _sine(100)
    assert crossing(t, y, 0.0, 5.0, 0.1) is None
    assert crossing(t, y, 3.0, 0.5, 0.1) is None
    assert crossing(t[:2], y[:2], 0.0, t[0], 0.1) is None
    assert peak(t, y, 1, 5.0, 0.1) is None
    assert peak(t, t, 1, 0.5, 0.05) is None
    assert crossing(t, 0.0 * y, 0.1, 0.5, 0.1) is None


def _track(times: list[float]) -> list[Switch]:
    """Switches told by a relay that changes side at `times`."""
    tracker, up, told = SwitchTracker(), True, []
    tracker.update(-1.0, -1.0, up)
    for t in times:
        up = not up
        switch = tracker.update(t - 0.1, t, up)
        if switch:
            told.append(switch)
    return told


def test_each_switch_is_told_when_the_next_begins():
    told = _track([0.0, 1.0, 2.0, 3.0])
    assert [(s.t, s.up, s.merged) for s in told] == [(0.0, False, 1), (1.0, True, 1), (2.0, False, 1)]
    assert told[1].seen == pytest.approx(0.9)


def test_chatter_is_one_switch_of_the_same_mean_voltage():
    told = _track([0.0, 1.0, 2.0, 2.02, 2.05, 3.0, 4.0])
    merged = next(s for s in told if s.merged == 3)
    assert merged.t == pytest.approx(2.0 - 2.02 + 2.05)
    assert [round(s.t, 2) for s in told] == [0.0, 1.0, 2.03, 3.0]
    assert [s.up for s in told] == [False, True, False, True]


def test_a_short_spike_within_a_half_cycle_is_no_switch():
    told = _track([0.0, 1.0, 2.0, 2.5, 2.52, 3.0, 4.0])
    assert [s.t for s in told] == [0.0, 1.0, 2.0, 3.0]
    assert [s.up for s in told] == [False, True, False, True]


def test_a_long_first_run_does_not_make_the_rest_chatter():
    told = _track([0.0, 100.0, *(101.0 + k for k in range(400))])
    assert [s.merged for s in told[-10:]] == [1] * 10


def test_agreement_is_judged_against_scatter():
    rng = np.random.default_rng(3)
    steady = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    trend = [0.01 * k for k in range(7)]
    transient = [0.5**k for k in range(7)]
    scatter = list(rng.normal(0.0, 0.01, 7))
    assert agree(steady)
    assert agree(scatter)
    assert not agree(trend)
    assert not agree(transient)
    assert not agree([a + 10.0 * b for a, b in zip(scatter, trend, strict=True)])
    assert not agree([0.0, 0.0])
    assert agree([0.004 * (k > 3) for k in range(7)], slack=4.0)


def test_noise_is_measured_and_motion_is_not():
    rng = np.random.default_rng(1)
    meter, still = NoiseMeter(), NoiseMeter()
    for k in range(5000):
        motion = math.sin(0.05 * k)
        meter.update(motion + 0.02 * rng.standard_normal(), 1000.0)
        still.update(motion, 1000.0)
    assert meter.sd == pytest.approx(0.02, rel=0.1)
    assert still.sd < 1e-4


def test_missing_samples_are_no_noise():
    meter = NoiseMeter()
    for k in range(1000):
        if k % 7 == 0:
            meter.skip()
        else:
            meter.update(math.sin(0.05 * k), 1000.0)
    assert meter.sd < 1e-4


@pytest.mark.parametrize("samples", [20, 50, 500])
def test_a_clipped_peak_is_flat_and_a_coarse_one_is_not(samples):
    y = [math.sin(math.pi * (k + 0.3) / samples) for k in range(samples)]
    coarse = [0.02 * round(x / 0.02) for x in y]
    assert clipped([min(x, 0.93) for x in y])
    assert clipped([-min(x, 0.93) for x in y])
    assert not clipped(y)
    assert not clipped(coarse)
    assert not clipped([])
    assert not clipped([1.0] * samples)
