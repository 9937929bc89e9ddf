"""The search: from far off to the truth, along valleys, with windows of their own starts and errors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, RATE, ZETA, linear, multisine, recording

from seod.diagnose.causes.cause import Coordinate
from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import group, searched_causes
from seod.diagnose.causes.valve import LARGEST_LIMIT
from seod.diagnose.fitting import least_squares, uncertainty
from seod.diagnose.fitting.held_out import nrmse, simulate_held_out, wholes
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import LeastSquares, fit, settle
from seod.diagnose.fitting.model import baseline_model, grouped
from seod.diagnose.fitting.simulate import POSITION, PRESSURE, STATES
from seod.diagnose.fitting.uncertainty import base_sd, covariance, effect_parameters
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.sizes import scales
from seod.diagnose.tuning.fitting import FIT, UNCERTAINTY
from sim.effects import EFFECTS

SIZES = Scales(2.0, 10.0, 1000.0, 0.0, 1.0, 0.3, OMEGA_N, 8.0, 1.0 / RATE)
TRUTH = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA}


def windows(y, u, **more):
    fitted, held = cut([series(recording(u, y, **more))])
    return segments(fitted, 1.0), held


@pytest.fixture(scope="module")
def clean():
    u = multisine(8000)
    return windows(linear(u), u)


@pytest.fixture(scope="module")
def begun(clean):
    """Eq. 1 as the search finds it in the clean record, without any start."""
    return baseline(clean[0], False, {})


def deviations(found, cut_to):
    values = found.model.values(found.x)
    sd = base_sd(found, covariance(found))
    return {name: (values[name] - TRUTH[name]) / sd[name] for name in TRUTH}, sd


@pytest.mark.slow
def test_eq_1_is_found_without_any_start(clean, begun):
    found = begun.best
    off, sd = deviations(found, clean[0])
    assert max(abs(z) for z in off.values()) < 3.5
    assert sd["omega_n"] < 1e-3 * OMEGA_N
    assert np.mean(found.error) == pytest.approx(clean[0].noise[0] ** 2, rel=0.05)


@pytest.mark.slow
def test_the_same_of_a_speed_with_a_turned_sign():
    u = multisine(6000)
    one = series(recording(u, -linear(u, speed=True)), sees_speed=True)
    fitted, _ = cut([one])
    found = baseline(fitted, True, {}).best
    assert found.model.values(found.x)["K_L"] == pytest.approx(-K_L, rel=2e-3)


@pytest.mark.slow
def test_a_search_whose_time_is_up_tries_no_shorter_steps(clean, begun, monkeypatch):
    found, tried = begun.best, []
    monkeypatch.setattr(LeastSquares, "stepped", lambda *_: tried.append(1))
    fit(found.model, clean[0], found.x + 0.003, found.start, ended=lambda: bool(tried))
    assert len(tried) == 1
    tried.clear()
    fit(found.model, clean[0], found.x + 0.003, found.start)
    assert len(tried) > 1


@pytest.mark.slow
def test_what_a_step_promises_is_what_it_saves(begun):
    at = begun.best
    there = fit(at.model, at.cut, at.x, at.start, enough=1e-7)
    off = there.x + 0.003
    search = LeastSquares(at.model, at.cut, map, np.ones(len(off), np.bool_))
    start = settle(at.model, at.cut, off, there.start, at.cut.good)
    residual, error = search.tried(off, start)
    saved = search.cost(error) - there.cost
    promise = search.derivatives(off, start, residual, error).promise() / np.sum(search.count)
    assert saved > 10 * FIT.least_improvement
    assert promise == pytest.approx(saved, rel=0.2)


@pytest.mark.slow
def test_a_search_that_has_arrived_tries_no_step(begun, monkeypatch):
    at = begun.best
    there = fit(at.model, at.cut, at.x, at.start, enough=1e-7)
    steps = []
    monkeypatch.setattr(LeastSquares, "stepped", lambda *_: steps.append(1))
    fit(at.model, at.cut, there.x, there.start)
    assert not steps
    fit(at.model, at.cut, there.x + 0.003, there.start)
    assert steps


ANYWHERE = {
    "Eq. 1": ({}, True),
    "friction and play": ({"coulomb_friction": {"level": 100.0}, "backlash": {"gap": 0.01}}, True),
    "lags": ({"valve_lag": {"time": 2e-3}, "sensor_lag": {"time": 3e-3}}, True),
    "a second inertia": ({"load_resonance": {"inertia": 0.2, "omega": 300.0, "zeta": 0.1}}, True),
    "a spring": ({"load_spring": {"stiffness": 500.0, "centre": 0.0}}, False),
    "a ripple": ({"position_ripple": {"amplitude": 0.02, "wavenumber": 30.0}}, False),
    "a curve": ({"sensor_nonlinearity": {"order_3": 0.05, "half": 0.5}}, False),
    "no sign": ({"rectified_sensor": {"part": 1.0}}, False),
}


@pytest.mark.parametrize(("fixed", "anywhere"), ANYWHERE.values(), ids=ANYWHERE)
@pytest.mark.parametrize("memory", [(), (0.6,)], ids=["white", "coloured"])
def test_what_a_load_elsewhere_shows_is_known_without_a_simulation(
    clean, fixed, anywhere, memory, monkeypatch
):
    cut_to, counted = clean[0].remembering(memory), []
    model = baseline_model(SIZES, 1.0, False, fixed)
    start = np.zeros((len(cut_to.windows), STATES))
    start[:, POSITION] = 0.03
    search = LeastSquares(
        model, cut_to, lambda act, some: counted.append(len(some)) or map(act, some), np.ones(3, np.bool_)
    )
    at = model.searched(TRUTH)
    found = search.derivatives(at, start, *search.tried(at, start)).products
    monkeypatch.setattr(least_squares, "moves_alike_everywhere", lambda _: False)
    simulated = search.derivatives(at, start, *search.tried(at, start)).products
    assert counted[0] == counted[1] - anywhere
    assert np.allclose(found, simulated, rtol=1e-6, atol=1e-9 * np.abs(simulated).max())


@pytest.mark.slow
def test_a_curvature_that_rounding_made_negative_breaks_nothing_off(begun):
    found = begun.best
    assert base_sd(found, np.diag([-1e-30, 1e-6, 1e-6]))["K_L"] == 0.0


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Standardised errors of twenty recordings: of unit variance."""
    u = multisine(4000)
    y = linear(u)
    every = []
    for seed in range(20):
        to_fit, _ = windows(y, u, seed=seed)
        model = baseline_model(SIZES, 1.0, False, {})
        x = model.searched({"K_L": 16.0, "omega_n": 110.0, "zeta": 0.33})
        found = fit(model, to_fit, x, simulated_states(model, x, to_fit))
        every += list(deviations(found, to_fit)[0].values())
    assert 0.75 < np.std(every) < 1.25


@pytest.mark.slow
@pytest.mark.parametrize(("wander", "least", "most"), [(0.0, 1.0, 1.15), (3.0, 1.2, 3.0)])
def test_what_bends_a_record_slowly_widens_the_interval_of_what_it_looks_like(
    wander, least, most, monkeypatch
):
    """An offset of the sensor that moves slowly pulls a constant load up in one part and down in another."""
    u, ratios = multisine(8000), []
    y, t = linear(u), np.arange(8000) / RATE
    for seed in range(5):
        random = np.random.default_rng([7, seed])
        slow = np.sin(2.0 * np.pi * random.uniform(0.1, 0.2) * t + random.uniform(0.0, 6.3))
        to_fit, _ = windows(y + 0.01 * np.std(y) * wander * slow, u, noise=0.01, seed=seed)
        model = baseline_model(SIZES, 1.0, False, {}).with_effect("load_bias")
        x = model.searched(TRUTH | {"load_bias.acceleration": 0.0})
        found = fit(model, to_fit, x, simulated_states(model, x, to_fit))
        own = covariance(found)[-1, -1]
        with monkeypatch.context() as patch:
            patch.setattr(uncertainty, "UNCERTAINTY", replace(UNCERTAINTY, pulling_parts=()))
            ratios.append(np.sqrt(own / covariance(found)[-1, -1]))
    assert min(ratios) >= 1.0
    assert least <= np.mean(ratios) < most


@pytest.mark.filterwarnings("error")
def test_a_curvature_that_rounding_spoilt_tells_what_bounds_tell():
    """Two numbers that act alike: only their sum is known, each within its bounds, whatever rounding says."""
    bounds = np.array([0.01, 0.02])
    usual = np.array([[4.0, 1.0], [1.0, 9.0]])
    both = np.linalg.inv(usual + np.diag(bounds))
    np.testing.assert_allclose(uncertainty._inverse(usual, bounds), both, rtol=1e-9)
    alike = 6e5 * np.array([[1.0, 1.0 + 1.4e-7], [1.0 + 1.4e-7, 1.0]])
    found = uncertainty._inverse(alike, bounds)
    np.testing.assert_allclose(found, np.array([[1.0, -1.0], [-1.0, 1.0]]) / bounds.sum(), rtol=1e-2)
    spoilt = np.array([[4.0, 1e30], [1e30, -1e-310]])
    assert np.isfinite(uncertainty._inverse(spoilt, bounds)).all()


def test_of_a_number_that_the_samples_do_not_show_only_its_bounds_are_known(clean):
    """Commands never reach the valve's end: where that lies they do not tell."""
    to_fit = clean[0]
    model = baseline_model(SIZES, 1.0, False, {}).with_effect("valve_saturation")
    largest = SIZES.volts * LARGEST_LIMIT
    assert np.max(np.abs(to_fit.series[0].u)) < 0.9 * largest
    x = model.searched(TRUTH | {"valve_saturation.limit": 0.95 * largest})
    found = fit(model, to_fit, x, simulated_states(model, x, to_fit))
    spread = covariance(found)
    low, high = effect_parameters(found, "valve_saturation", spread)["limit"].ci95
    assert low < 0.2 * largest
    assert high > 1.9 * largest
    assert 0.0 < base_sd(found, spread)["K_L"] < 0.01 * K_L


def test_a_lag_is_found_through_the_valley_where_gain_and_damping_change_together():
    u = multisine(6000)
    to_fit, _ = windows(linear(u, lag=0.004), u)
    model = baseline_model(SIZES, 1.0, False, {}).with_effect("valve_lag")
    x = model.searched({"K_L": 30.0, "omega_n": 90.0, "zeta": 0.7, "valve_lag.time": 0.0005})
    found = fit(model, to_fit, x, simulated_states(model, x, to_fit), most=30)
    lag = effect_parameters(found, "valve_lag", covariance(found))["time"]
    assert lag.ci95[0] < 0.004 < lag.ci95[1]
    assert lag.ci95[1] - lag.ci95[0] < 2e-4


@pytest.mark.slow
def test_the_pressure_of_a_load_that_sticks_is_kept_where_it_hardly_shows():
    """Its step was 292 times the friction, spoilt the window's, and left the load at one noisy sample."""
    columns = np.array([[4.7e-9, 0.27, 1.0], [4.7e-9, 0.27, -1.0]] * 3)
    every = np.vstack([columns, 2.0 * columns, [[0.1, 0.27, 1.0]] * 6])
    windows = SimpleNamespace(slices=[slice(0, 6), slice(6, 12), slice(12, 18)])
    sticks = np.array([True, False, True])
    LeastSquares._hold_pressed(windows, every, [PRESSURE, POSITION], sticks)
    assert every[:, 0].tolist() == [0.0] * 6 + [9.4e-9] * 6 + [0.1] * 6
    assert np.all(every[:, 1] > 0.0)


def test_one_bad_window_has_no_veto():
    u = multisine(8000)
    y = linear(u)
    y[2000:2400] += np.linspace(0.0, 2.0, 400) ** 2
    to_fit, _ = windows(y, u)
    found = baseline(to_fit, False, {}).best
    values = found.model.values(found.x)
    assert values["omega_n"] == pytest.approx(OMEGA_N, rel=2e-3)
    assert values["zeta"] == pytest.approx(ZETA, rel=1e-2)


def test_initial_states_are_fitted_to_the_rows_given(clean):
    _, held = clean
    model = baseline_model(SIZES, 1.0, False, {})
    x = model.searched(TRUTH)
    start = settle(model, held, x, np.zeros((len(held.windows), 7)), held.started())
    exact = simulated_states(model, x, held)
    assert np.max(np.abs(start[:, 1] - exact[:, 1])) < 0.1 * SIZES.speed


def test_held_out_windows_of_a_true_model_have_the_noise_alone(clean):
    model = baseline_model(SIZES, 1.0, False, {})
    x = model.searched(TRUTH)
    true = simulate_held_out(model, x, clean[1])
    assert true.adequacy == pytest.approx(1.0, abs=0.08)
    assert true.nrmse == pytest.approx(true.floor, rel=0.05)
    _, whole, diverged = wholes(model, x, clean[1])
    assert whole == pytest.approx(0.01, rel=0.1)
    assert not diverged
    wrong = simulate_held_out(model, model.searched(TRUTH | {"omega_n": 1.05 * OMEGA_N}), clean[1])
    assert wrong.adequacy > 5.0


def test_a_simulation_that_runs_away_is_said_to(clean):
    model = baseline_model(SIZES, 1.0, False, {"load_bias": {"acceleration": 1e5}})
    assert wholes(model, model.searched(TRUTH), clean[1])[2]


def test_nrmse_takes_the_mean_of_each_window_away():
    y = np.array([0.0, 2.0, 10.0, 12.0])
    every = np.ones(2, np.bool_)
    assert nrmse([(y[:2], y[:2] + 1.0, every), (y[2:], y[2:], every)]) == pytest.approx(np.sqrt(2.0 / 4.0))


@pytest.mark.slow
def test_sizes_are_those_of_the_movement(clean, begun):
    near, found, whole, *_ = begun
    sizes = scales(near, clean[0])
    speed = linear(multisine(8000), speed=True)
    assert sizes.speed == pytest.approx(np.std(speed), rel=0.1)
    assert sizes.volts == pytest.approx(2.0, rel=0.1)
    for one in (found, whole):
        assert one.model.values(one.x)["omega_n"] == pytest.approx(OMEGA_N, rel=0.05)


@pytest.mark.parametrize("name", searched_causes(replace(SIZES, warmer=True, pressed=True, force=1.0)))
def test_every_start_is_a_plant_and_survives_the_way_there_and_back(name):
    searched = group(name, SIZES)
    model = baseline_model(SIZES, 1.0, False, {}).with_effect(name)
    starts = searched.starts or ({c.place: min(max(1.0, c.low), c.high) for c in searched.coordinates},)
    for start in starts:
        x = model.searched(TRUTH | start)
        for place, value in start.items() - {p for p in start.items() if p[0][0] == "*"}:
            assert model.values(x)[place] == pytest.approx(value, rel=1e-9)
        assert model.kernel_parameters(x)["K_L"][0] == pytest.approx(K_L)
    assert set(grouped(model.values(x))) == {name}
    low, high = model.bounds
    for end in (low, high):
        model.kernel_parameters(end)


def test_all_causes_that_act_on_the_plant_are_searched():
    told = {e.name for e in EFFECTS.values() if e.cause and e.enters != "record"}
    every = replace(SIZES, warmer=True, pressed=True, force=1.0)
    assert set(searched_causes(every)) == told - {"sensor_quantization", "held_readings", "null_shift"}
    assert "pressure_dependent_stiffness" not in searched_causes(SIZES)


def test_a_wave_has_amplitude_and_phase():
    values = {"position_ripple.cosine": 0.3, "position_ripple.sine": 0.4, "position_ripple.wavenumber": 7.0}
    found = grouped(values)["position_ripple"]
    assert found["amplitude"] == pytest.approx(0.5)
    assert 0.5 * np.sin(7.0 * 0.2 + found["phase"]) == pytest.approx(0.3 * np.cos(1.4) + 0.4 * np.sin(1.4))


def test_a_coordinate_stays_within_its_bounds():
    one = Coordinate("valve_lag.time", 1.0, 1e-5, 0.1)
    assert one.value(one.bounds[1]) <= 0.1
    assert one.value(99.0) == 0.1
    assert one.searched(1.0) == one.bounds[1]


@pytest.mark.parametrize("swing", [0.3, 0.6])
def test_from_the_truth_a_fit_of_coarse_readings_leads_nowhere_worse(swing):
    """Rounding taken as white noise leads from there to where it looks less: away, if steps are large."""
    u = multisine(4000)
    y = linear(u)
    step = swing * np.ptp(y)
    to_fit, _ = cut([series(recording(u, step * np.round(y / step)), step=step)])
    model = baseline_model(SIZES, 1.0, False, {})
    x = model.searched(TRUTH)
    start = settle(model, to_fit, x, simulated_states(model, x, to_fit), to_fit.good)
    begun, ended = (fit(model, to_fit, x, start, most) for most in (0, 15))
    assert to_fit.slack[0] > 0.0
    assert ended.cost <= begun.cost
