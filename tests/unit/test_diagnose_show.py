"""What the pictures are made of: a residual that is known comes out as what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_example import K_L, LEVEL, NOISE, OMEGA_N, RATE, ZETA, example
from numpy.testing import assert_allclose

from seod.diagnose.report.checks import _phase
from seod.diagnose.result import Score
from seod.diagnose.show.acting import acting
from seod.diagnose.show.distortion import harmonics, period
from seod.diagnose.show.maps import binned, edges_of, explains, plane
from seod.diagnose.show.residual import residual
from seod.diagnose.show.spectra import autocorrelation, cross_correlation, spectrum
from seod.diagnose.verdict.bootstrap import interval
from seod.diagnose.verdict.figures import scored_windows

TRUTH = Score(K_L, OMEGA_N, ZETA, 0.0, 0.0, False)


@pytest.fixture(scope="module")
def windows():
    return scored_windows(example())


def test_friction_is_a_force_with_the_sign_of_the_velocity(windows):
    seen = [residual(w, w.y_baseline, TRUTH, "position") for w in windows]
    v = np.concatenate([w.velocity for w in windows])
    force = np.concatenate([r.force for r in seen])
    for sign in (-1.0, 1.0):
        moving = (sign * v > 3.0) & np.isfinite(force)
        assert np.mean(force[moving]) == pytest.approx(sign * LEVEL, rel=0.1)


def test_the_same_of_a_speed(windows):
    w = windows[0]
    v, linear = (np.gradient(y, w.t) for y in (w.y_extended, w.y_baseline))
    force = residual(replace(w, y=v), linear, TRUTH, "velocity").force
    moving = (w.velocity > 3.0) & np.isfinite(force)
    assert np.mean(force[moving]) == pytest.approx(LEVEL, rel=0.1)


def test_the_causes_are_measured_whatever_the_baseline_makes_of_them(windows):
    """The baseline's zeta is half as high again and takes part of the friction; the causes are all of it."""
    d = example()
    force = np.concatenate([acting(d, w) for w in windows])
    v = np.concatenate([w.velocity for w in windows])
    for sign in (-1.0, 1.0):
        moving = (sign * v > 3.0) & np.isfinite(force)
        assert np.mean(force[moving]) == pytest.approx(sign * LEVEL, rel=0.1)
    assert explains(binned(v, force), force)
    assert not explains(binned(np.concatenate([w.t for w in windows]), force), force)


def test_a_valve_does_not_act_on_the_load(windows):
    d = example()
    valve = replace(d, extended=replace(d.extended, effects={"valve_deadband": {"half_width": 0.1}}))
    assert acting(valve, windows[0]) is None


def test_volts_are_those_that_are_missing():
    """A plant that gets 0.05 V more than the model knows of."""
    rows = np.arange(3000)
    t = rows / RATE
    speed = K_L * 0.05
    from diagnosis_example import Window

    w = Window(
        0, (0, 3000), t, 0 * t, speed * t, None, None, 0 * t, 0 * t, 0 * t, 0 * t, 0 * t, rows > 600, True
    )
    volts = residual(w, w.y_baseline, TRUTH, "position").volts
    assert_allclose(volts[np.isfinite(volts)], 0.05, rtol=1e-6)


def test_missing_samples_leave_no_hole_in_the_force(windows):
    y = windows[0].y.copy()
    y[500:510] = np.nan
    holed = residual(replace(windows[0], y=y), windows[0].y_baseline, TRUTH, "position")
    assert np.isnan(holed.error[500:510]).all()
    assert np.isfinite(holed.force[400:600]).all()


def test_bins_tell_the_mean_and_how_sure_it_is():
    random = np.random.default_rng(3)
    x = random.uniform(-1, 1, 20_000)
    found = binned(x, 2.0 * x + random.normal(0, 0.1, len(x)))
    kept = np.isfinite(found.mean)
    assert kept.sum() == 24
    assert_allclose(found.mean[kept], 2.0 * found.centre[kept], atol=0.02)
    inside = (found.low < 2.0 * found.centre) & (2.0 * found.centre < found.high)
    assert inside[kept].mean() > 0.8
    wide = binned(x, 2.0 * x + random.normal(0, 0.1, len(x)), correlated=16.0)
    ratio = (wide.high - wide.low)[kept] / (found.high - found.low)[kept]
    assert_allclose(ratio, 4.0, rtol=0.2)


def test_what_stands_still_has_one_bin_and_what_is_missing_none():
    assert len(edges_of(np.full(50, 3.0))) == 2
    assert len(edges_of(np.full(50, np.nan))) == 2
    assert np.isnan(binned(np.full(50, np.nan), np.ones(50)).mean).all()


def test_a_plane_puts_each_sample_into_its_cell():
    x = np.repeat(np.linspace(0, 1, 24), 240)
    y = np.tile(np.linspace(0, 1, 24), 240)
    edges_x, edges_y, values = plane(x, y, 10.0 * y + x)
    assert values.shape == (len(edges_y) - 1, len(edges_x) - 1)
    assert values[-1, 0] == pytest.approx(10.0, abs=0.5)
    assert values[0, -1] == pytest.approx(1.0, abs=0.5)


def test_white_noise_is_white_and_filtered_noise_is_not():
    random = np.random.default_rng(5)
    noise = [random.normal(size=4000) for _ in range(3)]
    assert autocorrelation(noise, 100).outside == pytest.approx(0.05, abs=0.05)
    slow = [np.convolve(each, np.ones(20), "same") for each in noise]
    assert autocorrelation(slow, 100).outside > 0.15


def test_cross_correlation_finds_the_lag_and_bounds_what_is_independent():
    random = np.random.default_rng(6)
    u = [np.convolve(random.normal(size=4000), np.ones(10), "same") for _ in range(3)]
    late = cross_correlation(u, [np.roll(each, 7) for each in u], 50)
    assert late.lag[np.argmax(late.value)] == 7
    apart = [np.convolve(random.normal(size=4000), np.ones(10), "same") for _ in range(3)]
    free = cross_correlation(u, apart, 50)
    assert free.outside < 0.2
    assert free.bound > 1.96 / np.sqrt(12_000)  # correlated signals agree by chance more often


def test_a_density_integrates_to_the_variance():
    noise = [np.random.default_rng(k).normal(0, 0.3, 5000) for k in range(3)]
    frequency, density = spectrum(noise, 500.0)
    assert np.sum(density) * (frequency[1] - frequency[0]) == pytest.approx(0.09, rel=0.05)


def test_odd_and_even_harmonics_are_told_apart():
    t = np.arange(4000)
    turn = 2 * np.pi * t / 161.3
    u = np.sign(np.sin(turn))
    length = period(u)
    assert length == pytest.approx(161.3, rel=2e-3)
    odd = harmonics([np.sin(turn) + 0.1 * np.sin(3 * turn)], 161.3)
    even = harmonics([np.sin(turn) + 0.1 * np.sin(2 * turn) + 0.01 * t], 161.3)
    assert_allclose(odd.amplitude[:4], [1.0, 0.0, 0.1, 0.0], atol=1e-9)
    assert_allclose(even.amplitude[:4], [1.0, 0.1, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("length", [161.3, 40.0])
def test_the_phase_of_a_cycle_begins_where_the_relay_switches_up(length):
    rows = np.arange(2000)
    begun = 0.37 * length
    turn = ((rows - begun) / length) % 1.0
    told = _phase(np.where(turn < 0.5, 0.5, -0.5), length)
    off = (told - turn + 0.5) % 1.0 - 0.5
    assert np.max(np.abs(off)) < 0.02


@pytest.mark.parametrize(
    "u", [np.random.default_rng(1).normal(size=3000), np.zeros(3000), np.linspace(0, 1, 3000) ** 2]
)
def test_what_does_not_repeat_has_no_period(u):
    assert period(u) is None


def test_the_bootstrap_covers_the_error(windows):
    """Of errors of known size, in nearly all of many trials."""
    inside = 0
    for trial in range(60):
        random = np.random.default_rng(trial)
        errors = [random.normal(0, 10 * NOISE, len(w.t)) for w in windows]
        spread = np.concatenate([w.y[w.scored] - w.y[w.scored].mean() for w in windows])
        true = 10 * NOISE / np.sqrt(np.mean(spread**2))
        low, high = interval(windows, errors, trial)
        inside += low < true < high
    assert inside >= 50
