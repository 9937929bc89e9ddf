"""Frequency responses against analytic ones and a simulator written apart (scipy)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete, dlsim

from seod.respond import RespondError, Segment, respond
from seod.respond.fit import Plant, fit, model
from seod.respond.period import even_voltage, find_period
from seod.respond.points import Points
from seod.respond.spectrum import of_voltage, spectra

pytestmark = pytest.mark.slow

RATE = 1000.0


def matrices(K_L, omega_n, zeta, output="position"):
    """Of Eq. 1 and its integral."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(omega_n**2), -2.0 * zeta * omega_n]])
    C = np.array([[1.0, 0.0, 0.0] if output == "position" else [0.0, 1.0, 0.0]])
    return A, np.array([[0.0], [0.0], [K_L * omega_n**2]]), C, np.zeros((1, 1))


def simulated(u, plant, output="position", rate=RATE, delay_ticks=0):
    """Of scipy's exact zero-order hold, from rest; the delay in whole ticks."""
    discrete = cont2discrete(matrices(*plant, output), 1.0 / rate)
    late = np.concatenate((np.zeros(delay_ticks), u[: len(u) - delay_ticks]))
    return dlsim(discrete, late)[1][:, 0]


def multisine(n, period, seed=1, orders=range(1, 60, 2), rate=RATE):
    random = np.random.default_rng(seed)
    t = np.arange(n) / rate
    phases = random.uniform(0.0, 2.0 * np.pi, 100)
    return sum(0.03 * np.sin(2 * np.pi * k * t / period + phases[k]) for k in orders if k % 8 != 3)


def recorded(u, y, seed=2, noise=0.0, rate=RATE, **more):
    t = np.arange(len(u)) / rate
    y = y + np.random.default_rng(seed).normal(0.0, noise or 1e-12, len(u))
    return Segment.of("test", t, u, y, None, **more)


@pytest.mark.parametrize(("output", "noise"), [("position", 5e-4), ("velocity", 0.05)])
@pytest.mark.parametrize("plant", [(17.0, 80.0, 0.2), (4.0, 45.0, 0.8), (10.0, 60.0, 1.4)])
def test_points_lie_on_the_analytic_response_and_the_fit_finds_the_plant(plant, output, noise) -> None:
    u = multisine(9000, 1.5)
    y = simulated(u, plant, output, delay_ticks=2)
    found = respond([recorded(u, y, noise=noise, output=output, period=1.5).after(3.0)])
    truth = model(Plant(*plant, 2e-3), found.points.omega, output)
    off = np.abs(found.points.G - truth) / (np.sqrt(2.0) * found.points.sd)
    assert np.median(off) < 1.5
    assert np.percentile(off, 90) < 3.0
    assert found.quality == "ok"
    for name, value in zip(("K_L", "omega_n", "zeta", "delay"), (*plant, 2e-3), strict=True):
        assert abs(getattr(found.fit.plant, name) - value) < 4.0 * found.fit.sd[name], name
    assert found.fit.sd["zeta"] < 0.05 * plant[2]


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    plant, inside = (17.0, 80.0, 0.3), 0
    u = multisine(6000, 1.5)
    y = simulated(u, plant)
    for seed in range(16):
        found = respond([recorded(u, y, seed, noise=1e-3, period=1.5).after(1.5)], delay=0.0)
        for name, value in zip(("omega_n", "zeta"), plant[1:], strict=True):
            inside += abs(getattr(found.fit.plant, name) - value) < 1.96 * found.fit.sd[name]
    assert inside >= 26  # of 32; 30.4 expected, 25 or fewer twice in 1000


def test_realisations_are_averaged() -> None:
    def measured(count):
        parts = []
        for seed in range(count):
            u = multisine(6000, 1.5, seed)
            y = simulated(u, (17.0, 80.0, 0.3))
            parts.append(recorded(u, y, seed + 50, noise=2e-3, period=1.5).after(1.5))
        return respond(parts).fit.sd["zeta"]

    assert measured(4) < 0.75 * measured(1)


@pytest.mark.parametrize("power", [2, 3])
def test_even_and_odd_distortion_show_on_their_own_lines(power) -> None:
    u = multisine(9000, 1.5)
    speed = simulated(u, (17.0, 80.0, 0.5), "velocity")
    bent = speed + 0.3 * np.std(speed) * (speed / np.std(speed)) ** power
    found = respond([recorded(u, bent, noise=1e-3, output="velocity", period=1.5).after(3.0)])
    odd, even = found.detection.distortion(True), found.detection.distortion(False)
    assert (odd[1], even[1]) == (power == 3, power == 2)
    assert (odd if power == 3 else even)[0] > 0.1
    assert found.quality == "nonlinear"
    assert ("odd" if power == 3 else "even") in found.message


def test_a_linear_plant_has_no_distortion_even_under_feedback() -> None:
    """What feeds back noise puts it into the voltage: the response has no bias, empty lines stay empty."""
    random, t = np.random.default_rng(3), np.arange(9000) / RATE
    r = multisine(9000, 1.5)
    A, B, _, _, _ = cont2discrete(matrices(17.0, 80.0, 0.3), 1 / RATE)
    x, u, y = np.zeros((3, 1)), np.empty(9000), np.empty(9000)
    for k in range(9000):
        y[k] = x[0, 0] + random.normal(0.0, 3e-3)
        u[k] = r[k] - 1.2 * y[k]
        x = A @ x + B * u[k]
    found = respond([Segment.of("loop", t, u, y, None, period=1.5).after(3.0)])
    assert not found.detection.distortion(True)[1]
    assert not found.detection.distortion(False)[1]
    assert abs(found.fit.plant.zeta - 0.3) < 4.0 * found.fit.sd["zeta"] < 0.02
    assert abs(found.fit.plant.omega_n - 80.0) < 4.0 * found.fit.sd["omega_n"]


def test_jitter_gaps_and_a_period_between_ticks_do_no_harm() -> None:
    random, period = np.random.default_rng(4), 1.50037
    edges = np.arange(1500) * 6.0 / RATE
    began = edges + random.uniform(0.0, 3e-4, 1500)
    omega, sizes = (
        2.0 * np.pi * np.array([1, 3, 7, 13, 21, 31]) / period,
        np.array([0.2, 0.2, 0.1, 0.1, 0.1, 0.1]),
    )
    u = np.sin(np.outer(edges, omega) + np.arange(6)) @ sizes
    t = np.arange(9000) / RATE + random.uniform(-2e-4, 2e-4, 9000)
    truth = Plant(17.0, 80.0, 0.3)
    y = continuous(truth, began, u, t)
    y[random.choice(9000, 400, replace=False)] = math.nan
    found = respond([Segment.of("jitter", t, u, y, began, period=period).after(2 * period)])
    assert np.allclose(found.points.G, model(truth, found.points.omega, "position"), rtol=2e-3)
    assert found.fit.plant.zeta == pytest.approx(0.3, rel=2e-3)
    assert found.fit.plant.omega_n == pytest.approx(80.0, rel=1e-3)


def continuous(plant, began, u, t):
    """The position at times t [s]: a sum of the responses to all steps of the voltage, in closed form."""
    root = np.sqrt(complex(plant.zeta**2 - 1.0))
    a, b = plant.omega_n * (root - plant.zeta), plant.omega_n * (-root - plant.zeta)
    y = np.zeros(len(t))
    for start, step in zip(began, np.diff(u, prepend=0.0), strict=True):
        since = np.maximum(t - start, 0.0)
        ea, eb = np.exp(a * since), np.exp(b * since)
        y += step * plant.K_L * (since - ((a * (eb - 1.0) / b - b * (ea - 1.0) / a) / (a - b)).real)
    return y


def test_a_relay_tells_its_odd_harmonics() -> None:
    """Free running, its period no whole number of ticks; K_L known, as for any relay."""
    K_L, omega_n, zeta = 17.0, 80.0, 0.3
    A, B, _, _, _ = cont2discrete(matrices(K_L, omega_n, zeta), 1 / RATE)
    x, u, y, random = np.zeros((3, 1)), np.empty(8000), np.empty(8000), np.random.default_rng(5)
    for k in range(8000):
        y[k] = x[0, 0] + random.normal(0.0, 5e-4)
        u[k] = (
            (0.5 if k == 0 else math.copysign(0.5, u[k - 1]))
            if abs(y[k]) < 2e-3
            else -math.copysign(0.5, y[k])
        )
        x = A @ x + B * u[k]
    found = respond([Segment.of("relay", np.arange(8000) / RATE, u, y, None)], K_L=K_L, delay=0.0)
    base = found.points.omega[0]
    assert found.periodic
    assert np.allclose(found.points.omega[:3] / base, [1, 3, 5], atol=1e-6)
    assert found.fit.plant.omega_n == pytest.approx(omega_n, rel=0.01)
    assert found.fit.plant.zeta == pytest.approx(zeta, rel=0.02)


def test_noise_as_an_input_is_averaged_over_windows() -> None:
    random = np.random.default_rng(6)
    u = np.convolve(random.normal(0.0, 0.4, 30_000), np.ones(6) / 6, "same")
    for output, noise in (("position", 5e-4), ("velocity", 0.05)):
        found = respond([recorded(u, simulated(u, (17.0, 80.0, 0.3), output), noise=noise, output=output)])
        assert not found.periodic
        assert found.fit.plant.omega_n == pytest.approx(80.0, rel=0.01)
        assert found.fit.plant.zeta == pytest.approx(0.3, rel=0.04)
        low = found.points.omega < 200.0
        assert np.all(found.points.coherence[low] > 0.9)


def test_coherence_tells_noise() -> None:
    u = multisine(9000, 1.5)
    y = simulated(u, (17.0, 80.0, 0.3))
    clean = respond([recorded(u, y, period=1.5).after(3.0)]).points.coherence
    noisy = respond([recorded(u, y, noise=0.2, period=1.5).after(3.0)])
    assert np.all(clean > 0.9999)
    assert noisy.points.coherence[-5:].max() < 0.9
    assert noisy.quality == "noisy"


def test_coefficients_of_a_stepwise_voltage_are_exact() -> None:
    began = np.array([0.0, 0.11, 0.3, 0.52, 0.9, 1.3])
    segment = Segment(
        "u", np.arange(20) / 10.0, np.zeros(20), began, np.array([1.0, -2.0, 0.5, 3.0, 0.0, 1.0])
    )
    omega = np.array([2.0, 7.0])
    fine = 0.05 + (np.arange(2_000_000) + 0.5) * 1e-6 / 2.0
    held = segment.u[np.searchsorted(began, fine, side="right") - 1]
    integral = [2.0 * np.mean(held * np.exp(-1j * w * (fine - 0.05))) for w in omega]
    assert np.allclose(of_voltage(segment, 0.05, 1.0, omega), integral, atol=1e-5)
    assert np.allclose(even_voltage(segment, np.array([0.05, 1.05])), held.mean(), atol=1e-5)


@pytest.mark.parametrize("period", [0.4, 0.5371])
def test_a_period_is_found_to_a_part_of_a_tick(period) -> None:
    t = np.arange(8000) / RATE
    u = np.sign(np.sin(2 * np.pi * t / period + 0.3)) + 0.3 * np.sin(6 * np.pi * t / period)
    found = find_period(Segment("u", t, u, t, u))
    assert found == pytest.approx(period, abs=2e-5)
    sweep = np.sin(2 * np.pi * (1.0 + 2.0 * t) * t)
    assert find_period(Segment("u", t, sweep, t, sweep)) is None


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_the_fit_finds_any_plant_without_noise(seed) -> None:
    random = np.random.default_rng(seed)
    plant = Plant(
        random.uniform(0.1, 50.0) * random.choice([-1.0, 1.0]),
        random.uniform(20.0, 200.0),
        10.0 ** random.uniform(-1.0, 0.3),
        random.uniform(0.0, 3e-3),
    )
    omega = np.geomspace(5.0, 400.0, 25)
    G = model(plant, omega, "position", lag=1e-3)
    points = Points(omega, G, 1e-3 * np.abs(G), np.ones(25), np.ones(25))
    found = fit(points, "position", lag=1e-3).plant
    assert [found.K_L, found.omega_n, found.zeta] == pytest.approx(
        [plant.K_L, plant.omega_n, plant.zeta], rel=1e-4
    )
    assert found.delay == pytest.approx(plant.delay, abs=1e-7)


def test_what_tells_nothing_is_said() -> None:
    t, u = np.arange(3000) / RATE, multisine(3000, 1.5)
    y = simulated(u, (17.0, 80.0, 0.3))
    with pytest.raises(RespondError, match="y never changes"):
        recorded(u, np.zeros(3000) * y, noise=0.0).__class__.of("flat", t, u, 0.0 * y, None)
    with pytest.raises(RespondError, match="u never changes"):
        Segment.of("still", t, 0.0 * u, y, None)
    with pytest.raises(RespondError, match="it takes"):
        Segment.of("short", t[:20], u[:20], y[:20], None)
    with pytest.raises(RespondError, match="it takes"):
        Segment.of("nan", t, u, y * math.nan, None)
    with pytest.raises(RespondError, match="do not increase"):
        Segment.of("back", t[::-1], u, y, t)
    with pytest.raises(RespondError, match="holds 2 settled periods"):
        spectra(recorded(u, y, period=1.4))
    with pytest.raises(RespondError, match="no samples for"):
        respond(
            [
                Segment.of(
                    "gap", np.where(t > 1.0, t + 9.0, t), np.random.default_rng(1).normal(size=3000), y, None
                )
            ]
        )


@given(st.integers(0, 10_000), st.integers(0, 3))
@settings(max_examples=15, deadline=None)
def test_any_data_give_a_word_or_a_reason(seed, kind) -> None:
    random, n = np.random.default_rng(seed), int(np.random.default_rng(seed).integers(1, 700))
    t = np.cumsum(random.uniform(0.0, 2e-3, n))
    u = random.normal(size=n) if kind else np.sign(np.sin(40.0 * t))
    y = random.normal(size=n) if kind < 2 else np.round(random.normal(size=n))
    y[random.random(n) < 0.05] = math.nan
    try:
        quality = respond([Segment.of("any", t, u, y, None if kind else t + 1e-4)]).quality
    except RespondError:
        quality = "refused"
    assert quality in ("refused", "ok", "noisy", "nonlinear", "out_of_range")


def test_windows_of_a_relay_whose_phase_wanders_are_laid_upon_each_other() -> None:
    t = np.arange(8000) / RATE
    u = np.sign(np.sin(2 * np.pi * t / 0.08 + 0.6 * np.sin(2 * np.pi * t / 7.0)))
    found = spectra(Segment("relay", t, u, t, u, period=0.08))
    fifth = found.u[:, 4]
    assert abs(fifth.mean()) > 0.95 * np.sqrt(np.mean(np.abs(fifth) ** 2))
