"""What has no derivative: contacts of a play in a speed, coarse sensors, a load that sticks; bristles."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from diagnose_models import sized_model
from plant_truth import PLACE, Plant

from seod.data import Recording
from seod.diagnose.causes.friction import STIFFEST_LUGRE
from seod.diagnose.causes.scales import Scales
from seod.diagnose.causes.table import further_causes
from seod.diagnose.fitting.backlash_jumps import contacts, smooth
from seod.diagnose.fitting.held_out import simulate_held_out
from seod.diagnose.fitting.initial_states import begun_states, simulated_states
from seod.diagnose.fitting.least_squares import fit, settle, weighted
from seod.diagnose.fitting.simulate import LOOSE, inside, simulate
from seod.diagnose.fitting.uncertainty import covariance, effect_parameters
from seod.diagnose.record.coarse_sensor import beyond, noise_beneath, readings
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, cut, segments
from sim.parameters import parameters

pytestmark = pytest.mark.slow

RATE, N = 1000.0, 4000
T = np.arange(N) / RATE
TRUTH = {"K_L": 17.0, "omega_n": 60.0, "zeta": 0.4}
NOISE = 1e-3
GAP = {"backlash": {"gap": 0.03}}
STICKS = {"stribeck_friction": {"level": 400.0, "speed": 1.0}}
BRISTLES = {"coulomb_friction": {"level": 200.0}, "lugre_friction": {"stiffness": 4e4, "damping": 100.0}}


def command():
    return 0.5 * np.sin(2.0 * np.pi * 3.1 * T) + 0.3 * np.sin(2.0 * np.pi * 1.7 * T + 1.0)


@cache
def truth(kind, speed):
    """Readings without noise of the plant written apart, and where its load is."""
    plant = Plant(
        *TRUTH.values(), {"gap": GAP, "sticks": STICKS, "bristles": BRISTLES}[kind], sees_speed=speed
    )
    y, places, u = np.empty(N), np.empty(N), command()
    for k in range(N):
        plant.advance(T[k])
        plant.command(u[k])
        y[k], places[k] = plant.reading(plant.w), plant.w[PLACE]
    return y, places


def recorded(kind, *, speed=False, noise=NOISE, step=0.0):
    y = truth(kind, speed)[0]
    y = y + np.random.default_rng(2).normal(0.0, noise * np.std(y), N)
    y = step * np.floor(y / step + 0.5) if step else y
    one = Recording((Path("run.csv"),), T, command(), y, None, None, None, np.arange(N), {}, {}, ())
    return series(one, sees_speed=speed, step=step)


def model_of(one, *names, speed=False):
    """A model with these effects, in sizes of the recording."""
    rough = Scales(0.8, 10.0, 600.0, 0.0, 1.0, 0.5, 60.0, 4.0, 1.0 / RATE)
    return sized_model(one, rough, TRUTH, names, speed=speed)


@pytest.mark.parametrize("part", [0.05, 0.3, 0.6, 0.9])
def test_a_window_may_begin_anywhere_within_the_play(part):
    one, record = recorded("gap"), parameters(*TRUTH.values(), GAP)
    whole = Cut([one], ((0, 0, N),))
    seen, states = inside(record, whole, np.array([[0.0, 0, 0, 0, 0, 0, 0.015]]))
    loose = 0.015 - np.sign(states[:, 1]) * (states[:, 2] - seen)
    first = 300 + int(np.argmin(np.abs(loose[300:-300] / 0.03 - part)))
    assert loose[first] / 0.03 == pytest.approx(part, abs=0.05)
    start = np.zeros((1, 7))
    start[0, :3], start[0, 6] = states[first, :3], loose[first]
    window = simulate(record, Cut([one], ((0, first, N),)), start)
    assert np.max(np.abs(window - seen[first:])) < 1e-6


@pytest.mark.parametrize("begin", [0.3, 0.7, 1.5, 3.0])
def test_a_play_is_found_from_jumps_of_the_speed(begin):
    one = recorded("gap", speed=True)
    model, (windows, aside) = model_of(one, "backlash", speed=True), cut([one])
    x = model.searched(TRUTH | {"zeta": 0.6, "backlash.gap": begin * 0.03})
    found = fit(model, windows, x, simulated_states(model, x, windows), most=30)
    assert model.values(found.x)["backlash.gap"] == pytest.approx(0.03, rel=0.03)
    assert simulate_held_out(model, found.x, aside).adequacy < 1.15


def test_a_jump_is_a_ramp_whose_place_moves_with_the_contact():
    one = recorded("gap", speed=True)
    whole, start = Cut([one], ((0, 0, N),)), np.zeros((1, 7))
    seen = [
        smooth(
            parameters(*TRUTH.values(), {"backlash": {"gap": gap}}, measures_speed=1.0), whole, start, 1.0
        )[0]
        for gap in (0.03, 0.03001)
    ]
    record = parameters(*TRUTH.values(), GAP, measures_speed=1.0)
    told = contacts(whole, *inside(record, whole, start))
    assert 10 < len(told.rows) < 100
    moved = np.abs(seen[1] - seen[0]).reshape(-1)
    near = [moved[max(0, row - 1) : row + 1].max() for row in told.rows]
    assert np.quantile(near, 0.1) > 0.5 * 1e-5 * RATE  # in each: the gap's change over the interval
    assert np.max(moved) < 3.0 * 1e-5 * RATE


def test_beside_a_jump_an_error_counts_less_and_elsewhere_in_full():
    one = recorded("gap", speed=True)
    model = model_of(one, "backlash", speed=True)
    whole, start = Cut([one], ((0, 0, N),)), np.zeros((1, 7))
    x = model.searched(TRUTH | {"backlash.gap": 0.03})
    record = model.kernel_parameters(x)
    seen, more = smooth(record, whole, start, 1.0)
    error = weighted(model, whole, x, start)
    plain = one.y - seen
    assert np.array_equal(error[more == 0.0], plain[more == 0.0])
    beside = more > 0.0
    assert np.sqrt(np.mean(plain[beside] ** 2)) > 20.0 * one.noise
    assert np.sqrt(np.mean(error[beside] ** 2)) < 2.0 * one.noise


def test_a_window_that_begins_at_rest_finds_its_place():
    one = recorded("sticks", noise=0.02)
    model = model_of(one, "stribeck_friction")
    x = model.searched(TRUTH | {"stribeck_friction.level": 400.0, "stribeck_friction.speed": 1.0})
    record, whole = model.kernel_parameters(x), Cut([one], ((0, 0, N),))
    states = inside(record, whole, np.zeros((1, 7)))[1]
    still = 300 + int(np.flatnonzero(states[300:, 1] == 0.0)[0])
    window = Cut([one], ((0, still, N),))
    start = np.zeros((1, 7))
    start[0, :3] = states[still, :3]
    start[0, 2] += 3.0 * one.noise  # a noisy sample
    found = settle(model, window, x, start, window.good)
    error = one.y[still:] - simulate(record, window, found)
    assert np.sqrt(np.mean(error**2)) < 1.05 * one.noise
    assert abs(found[0, 2] - states[still, 2]) < one.noise


@pytest.mark.parametrize("part", [0.02, 0.05, 0.1])
def test_noise_beneath_a_step_is_told_by_changes_to_and_fro(part):
    t = np.arange(40000) / 1000.0
    x = 8.0 * np.sin(0.5 * t) + 5.0 * np.sin(0.31 * t + 1.0)
    counts = np.floor(x + np.random.default_rng(3).normal(0.0, part, len(t)) + 0.5)
    assert noise_beneath(counts) == pytest.approx(part, rel=0.35)
    assert noise_beneath(np.floor(x + 0.5)) < 1e-3


def test_a_reading_says_nothing_within_its_step():
    y = 0.1 * np.floor(5.0 * np.sin(np.arange(2000) / 100.0) + 0.5)
    told = readings(y, np.ones(len(y), np.bool_), 0.1, 1e-3)
    assert told.y == pytest.approx(y)
    assert told.slack == pytest.approx(0.05)
    assert told.level < told.allowed < told.noise == pytest.approx(0.1 / np.sqrt(12.0))
    error = beyond(np.array([0.04, -0.04, 0.06, -0.07]), np.full(4, 0.05))
    assert error == pytest.approx([0.0, 0.0, 0.01, -0.02])


def test_noise_as_large_as_the_step_makes_it_white():
    random = np.random.default_rng(4)
    y = 0.1 * np.floor(random.normal(0.0, 0.1, 4000) / 0.1 + 0.5)
    told = readings(y, np.ones(len(y), np.bool_), 0.1, float(np.std(y)))
    assert (told.slack, told.level) == (0.0, pytest.approx(np.std(y)))


def test_a_play_far_smaller_than_the_step_of_its_sensor_is_found():
    one = recorded("gap", step=0.1)
    model, (windows, _) = model_of(one, "backlash"), cut([one])
    x = model.searched(TRUTH | {"zeta": 0.5, "backlash.gap": 0.01})
    found = fit(model, windows, x, simulated_states(model, x, windows), most=40)
    assert model.values(found.x)["backlash.gap"] == pytest.approx(0.03, rel=0.1)
    assert model.values(found.x)["zeta"] == pytest.approx(0.4, rel=0.1)


def test_friction_that_gives_way_is_found_with_its_bristles():
    one = recorded("bristles")
    model, (windows, aside) = model_of(one, "coulomb_friction"), cut([one])
    x = model.searched(TRUTH | {"coulomb_friction.level": 150.0})
    dry = fit(model, windows, x, simulated_states(model, x, windows), most=30)
    assert simulate_held_out(model, dry.x, aside).adequacy > 3.0
    more = model.with_effect("lugre_friction")
    x = more.searched(model.values(dry.x) | {"lugre_friction.stiffness": 1e4, "lugre_friction.damping": 50.0})
    found = fit(more, windows, x, simulated_states(more, x, windows), most=40)
    values = more.values(found.x)
    assert values["coulomb_friction.level"] == pytest.approx(200.0, rel=0.01)
    assert values["lugre_friction.stiffness"] == pytest.approx(4e4, rel=0.05)
    assert simulate_held_out(more, found.x, aside).adequacy < 1.15


@pytest.mark.parametrize("part", [0.2, 0.5, 1.0, 1.8])
def test_a_window_may_begin_with_bristles_bent_anyhow(part):
    one, bent = recorded("bristles"), 200.0 / 4e4
    record, whole = parameters(*TRUTH.values(), BRISTLES), Cut([one], ((0, 0, N),))
    seen, states = inside(record, whole, np.zeros((1, 7)))
    first = 300 + int(np.argmin(np.abs(states[300:-300, 4] / bent - part)))
    assert states[first, 4] == pytest.approx(part * bent, abs=0.1 * bent)
    start = np.zeros((1, 7))
    start[0, :3], start[0, 6] = states[first, :3], states[first, 4]
    window = Cut([one], ((0, first, N),))
    assert np.max(np.abs(simulate(record, window, start) - seen[first:])) < 1e-5 * np.ptp(seen)
    start[0, 6] = 0.0
    assert np.max(np.abs(simulate(record, window, start) - seen[first:])) > 1e-3 * np.ptp(seen)


def test_windows_that_begin_in_motion_keep_their_bristles_within_what_they_bend():
    """Begun at plain friction, whose bristles would not bend, a fit does not end above it."""
    random = np.random.default_rng(3)
    u = np.repeat(random.uniform(-1.0, 1.0, 16), 500)
    size = {"K_L": 22.4, "omega_n": 40.7, "zeta": 0.184, "coulomb_friction.level": 379.0}
    stiff = {"coulomb_friction": {"level": 379.0}, "lugre_friction": {"stiffness": 1.3e5, "damping": 176.0}}
    t, y = np.arange(len(u)) / RATE, np.empty(len(u))
    plant = Plant(22.4, 40.7, 0.184, stiff)
    for k in range(len(u)):
        plant.advance(t[k])
        y[k] = plant.reading(plant.w)
        plant.command(u[k])
    y += random.normal(0.0, 0.01 * np.std(y), len(y))
    one = series(Recording((Path("steps.csv"),), t, u, y, None, None, None, np.arange(len(u)), {}, {}, ()))
    few = segments(cut([one])[0])
    rough = Scales(1.0, 10.0, 600.0, 0.0, 1.0, 0.5, 40.7, 8.0, 1.0 / RATE)
    plain, model = (
        sized_model(one, rough, size, names)
        for names in (["coulomb_friction"], ["coulomb_friction", "lugre_friction"])
    )
    x = plain.searched(size)
    dry = fit(plain, few, x, simulated_states(plain, x, few), most=25)
    begun = {"lugre_friction.stiffness": 1e4, "lugre_friction.damping": 10.0}
    x = model.searched(plain.values(dry.x) | begun)
    found = fit(model, few, x, begun_states(model, x, few, dry.start), most=40)
    assert found.cost < dry.cost + 0.003
    bends = 2.0 * model.values(found.x)["coulomb_friction.level"]
    bends /= model.kernel_parameters(found.x)["lugre_friction_stiffness"][0]
    assert np.all((found.start[:, LOOSE] >= 0.0) & (found.start[:, LOOSE] <= bends * 1.001))


def test_bristles_come_and_go_with_the_friction_that_they_bear():
    model = model_of(recorded("bristles"), "load_bias")
    assert "lugre_friction" not in further_causes(model.scales, model.names)
    with_friction = model.with_effect("coulomb_friction")
    assert "lugre_friction" in further_causes(model.scales, with_friction.names)
    both = with_friction.with_effect("lugre_friction")
    assert both.without("coulomb_friction").names == ("load_bias",)
    assert both.without("lugre_friction").names == with_friction.names
    stiff = both.searched(
        TRUTH
        | {"load_bias.acceleration": 0.0, "coulomb_friction.level": 0.0}
        | {"lugre_friction.stiffness": 1e9, "lugre_friction.damping": 1.0}
    )
    record = both.kernel_parameters(stiff)  # no stiffer than the level there is
    stiffest = STIFFEST_LUGRE / model.scales.peak_to_peak * record["coulomb_friction_level"][0]
    assert record["lugre_friction_stiffness"][0] == pytest.approx(min(stiffest, 1e9))
    assert stiffest < 1e3
    dull = both.kernel_parameters(both.searched(TRUTH | both.values(stiff) | {"lugre_friction.damping": 1e6}))
    assert dull["lugre_friction_damping"][0] == pytest.approx(4.0 * np.sqrt(stiffest))


def test_a_play_in_a_speed_is_told_no_better_than_a_sample_allows():
    one = recorded("gap", speed=True)
    model, (windows, _) = model_of(one, "backlash", speed=True), cut([one])
    x = model.searched(TRUTH | {"backlash.gap": 0.03})
    found = fit(model, windows, x, simulated_states(model, x, windows), most=30)
    told = effect_parameters(found, "backlash", covariance(found))["gap"]
    assert told.ci95[0] < 0.03 < told.ci95[1]
    assert 1e-4 < told.ci95[1] - told.ci95[0] < 6e-3  # some 3 unit/s for a millisecond, over sqrt(12)
