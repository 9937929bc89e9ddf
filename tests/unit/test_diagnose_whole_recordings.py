"""Sets fitted to whole recordings: what grows there, what is plain enough, which waves are none."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from plant_truth import PLACE, Plant

from seod.config.load import load_rig
from seod.data import Recording
from seod.diagnose.causes.sensor import OVER_PLACE
from seod.diagnose.extend.rig_baseline import rated
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.simulate import inside, simulate
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, cut, segments, undivided
from seod.diagnose.result import DiagnoseError
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.prune import alike, best_alike, plainer
from seod.diagnose.search.race import imitates
from seod.diagnose.search.screen import screen
from seod.diagnose.search.whole_recordings import widened
from seod.diagnose.starts.baseline import baseline, unchanged
from seod.diagnose.starts.sizes import scales
from sim.parameters import parameters

pytestmark = pytest.mark.slow

RATE = 500.0
T = np.arange(9000) / RATE
GAIN, VISCOUS, LEVEL, OFFSET = 0.36, 2.1, 0.2, 0.03
"""A motor: speed' = gain u - viscous speed - level sign(speed) - offset."""


def recorded(t, u, y):
    """A recording of these."""
    rows = np.arange(1, len(t) + 1)
    return Recording((Path("strokes.csv"),), t, u, y, None, None, None, rows, {}, {}, ())


def motor(u):
    """Places of the motor under held commands, by small steps that stop where the speed passes zero."""
    fine, v, x, out = 20, 0.0, 0.0, []
    h = 1.0 / RATE / fine
    for volts in u.tolist():
        out.append(x)
        for _ in range(fine):
            push = GAIN * volts - VISCOUS * v - OFFSET
            if v == 0.0 and abs(push) <= LEVEL:
                continue
            direction = math.copysign(1.0, v if v != 0.0 else push)
            new = v + h * (push - LEVEL * direction)
            v = 0.0 if v * new < 0.0 else new
            x += h * v
    return np.array(out)


@pytest.fixture(scope="module")
def strokes():
    """Strokes of the motor, cut."""
    t = T[:5000]
    u = 1.6 * np.sign(np.sin(2.0 * np.pi * 0.37 * t)) + 0.5 * np.sin(2.0 * np.pi * 1.3 * t) + 0.09
    y = motor(u) + np.random.default_rng(1).normal(0.0, 1e-4, len(t))
    to_fit, aside = cut([series(recorded(t, u, y))])
    return segments(to_fit), aside


@pytest.fixture(scope="module")
def searched(strokes):
    """Where the search begins: the baseline with sizes on whole recordings, and the screen."""
    small, _ = strokes
    screened = screen(small, map, Budget(seconds=1e6))
    begun = baseline(screened.cut, False, {})
    sized = replace(begun.best.model, scales=scales(begun.near, screened.cut))
    return unchanged(sized, begun.best.x, undivided(small)), screened


def test_whole_recordings_count_the_same_rows(strokes):
    small, _ = strokes
    wide = undivided(small)
    assert len(wide.windows) == 1
    assert np.count_nonzero(wide.good) == np.count_nonzero(small.good)
    assert np.array_equal(wide.gathered("t")[wide.good], small.gathered("t")[small.good])


def test_friction_grows_on_a_whole_recording(searched):
    begun, screened = searched
    grown = widened(begun, screened, lambda: False)
    assert "coulomb_friction" in grown[-1].model.names or "stribeck_friction" in grown[-1].model.names
    assert [len(one.model.names) for one in grown] == list(range(len(grown)))
    assert all(after.cost < before.cost for before, after in pairwise(grown))


def test_a_load_that_slips_once_shows_no_effect_in_the_windows():
    u = 0.5 * np.sign(np.sin(2.0 * np.pi * 1.1 * T + np.sin(T)))
    truth, y = Plant(17.0, 60.0, 0.3, {}), np.empty(len(T))
    for k in range(len(T)):
        truth.advance(T[k])
        truth.command(u[k])
        y[k] = truth.w[PLACE]
    noise = 0.01 * np.std(y)
    y += np.where(T > 9.0, 4.0 * noise, 0.0) + np.random.default_rng(4).normal(0.0, noise, len(T))
    small = segments(cut([series(recorded(T, u, y))])[0])
    screened = screen(small, map, Budget(seconds=1e6))
    begun = baseline(screened.cut, False, {})
    sized = replace(begun.best.model, scales=scales(begun.near, screened.cut))
    parent = unchanged(sized, begun.best.x, undivided(small))
    assert widened(parent, screened, lambda: False) == [parent]


def test_without_time_nothing_grows(searched):
    begun, screened = searched
    assert widened(begun, screened, lambda: True) == [begun]


def test_friction_that_does_not_fall_is_the_plain_one(searched, strokes):
    begun, screened = searched
    model = begun.model.with_effect("load_bias").with_effect("stribeck_friction")
    truth = {"K_L": GAIN / VISCOUS, "omega_n": 40.0, "zeta": 40.0 / 2.0 / VISCOUS}
    size = {"load_bias.acceleration": -OFFSET, "stribeck_friction.level": LEVEL}
    x = model.searched(truth | size | {"stribeck_friction.speed": 0.05})
    own = Judged.of(fit(model, begun.cut, x, begun.start), strokes[1])
    plain = plainer(own, strokes[1], screened, 0.02)
    if own.found.model.values(own.found.x)["stribeck_friction.level"] < 1.5 * LEVEL:
        assert set(plain.found.model.names) == {"load_bias", "coulomb_friction"}
    found = plain.found.model.values(plain.found.x)
    assert found["coulomb_friction.level"] == pytest.approx(LEVEL, rel=0.1)


def test_which_effect_delays_is_asked_again_where_all_else_is_right():
    u = 0.6 * np.sin(2.0 * np.pi * (0.4 + 0.25 * T) * T) * (T < 8.0)
    truth, y = (
        Plant(17.0, 60.0, 0.3, {"valve_lag": {"time": 0.012}, "backlash": {"gap": 0.05}}),
        np.empty(4000),
    )
    for k in range(4000):
        truth.advance(T[k])
        truth.command(u[k])
        y[k] = truth.reading(truth.w)
    y += np.random.default_rng(7).normal(0.0, 0.01 * np.std(y), 4000)
    to_fit, aside = cut([series(recorded(T[:4000], u[:4000], y))])
    small = segments(to_fit)
    screened = screen(small, map, Budget(seconds=1e6))
    begun = baseline(screened.cut, False, {})
    plain = replace(begun.best.model, scales=scales(begun.near, screened.cut))
    model = plain.with_effect("backlash").with_effect("transport_delay")
    size = {"backlash.gap": 0.05, "transport_delay.time": 0.012}
    x = model.searched({"K_L": 17.0, "omega_n": 60.0, "zeta": 0.3} | size)
    own = Judged.of(fit(model, small, x, simulated_states(model, x, small)), aside)
    others = alike(own.found, "transport_delay", screened)
    assert [one.model.names for one in others] == [("backlash", "sensor_lag"), ("backlash", "valve_lag")]
    best = best_alike(own, aside, screened)
    assert best.found.model.names == ("backlash", "valve_lag")
    assert best_alike(best, aside, screened) is best


@pytest.mark.parametrize(
    ("effect", "other"), [("load_bias", "asymmetric_gain"), ("asymmetric_gain", "load_bias")]
)
def test_two_commands_do_not_tell_a_bias_from_unequal_gains(effect, other):
    truth = Plant(17.0, 60.0, 0.3, {"load_bias": {"acceleration": 200.0}})
    t = np.arange(4000) * 1e-3
    y, u = np.empty(4000), np.empty(4000)
    for k in range(4000):
        truth.advance(t[k])
        y[k] = truth.reading(truth.w)
        u[k] = -1.0 if y[k] > 0.0 else 1.0
        truth.command(u[k])
    y += np.random.default_rng(8).normal(0.0, 0.01 * np.std(y), 4000)
    few = segments(cut([series(recorded(t, u, y))])[0])
    screened = screen(few, map, Budget(seconds=1e6))
    plain = replace(baseline(few, False, {}).best.model, scales=scales(baseline(few, False, {}).near, few))
    model = plain.with_effect(effect)
    full = 60.0 * 17.0 / 0.6
    size = {"load_bias.acceleration": 200.0, "asymmetric_gain.ratio": -200.0 / full}
    x = model.searched({"K_L": 17.0, "omega_n": 60.0, "zeta": 0.3} | size)
    own = fit(model, few, x, simulated_states(model, x, few))
    (rival,) = alike(own, effect, screened)
    assert rival.model.names == (other,)
    assert rival.cost == pytest.approx(own.cost, abs=0.004)
    assert len(rival.x) == len(own.x)


@pytest.mark.parametrize(("waves", "none"), [(OVER_PLACE.fewest, True), (3.0, False)])
def test_the_longest_ripple_is_none(searched, waves, none):
    begun, screened = searched
    model = begun.model.with_effect("position_ripple")
    wavenumber = 2.0 * np.pi * waves / begun.model.scales.travel
    wave = {"cosine": 1e-3, "sine": 0.0, "wavenumber": wavenumber}
    values = begun.model.values(begun.x) | {f"position_ripple.{of}": x for of, x in wave.items()}
    still = np.zeros(len(model.coordinates), np.bool_)
    found = fit(model, begun.cut, model.searched(values), begun.start, free=still)
    assert imitates(found, screened.every) is none


def test_a_window_may_begin_within_the_play():
    effects = {"backlash": {"gap": 0.02}}
    u = 0.5 * np.sin(2.0 * np.pi * 3.0 * T[:400])
    truth = Plant(17.0, 117.0, 0.3, effects)
    y, places = np.empty(400), np.empty(400)
    for k in range(400):
        truth.advance(T[k])
        truth.command(u[k])
        y[k], places[k] = truth.reading(truth.w), truth.w[PLACE]
    one = series(recorded(T[:400], u, y + np.random.default_rng(1).normal(0, 1e-5, 400)))
    flank = np.abs(places - y)
    first = 60 + int(np.argmin(flank[60:300]))  # in the middle of the play
    assert flank[first] < 0.005
    record = parameters(17.0, 117.0, 0.3, effects)
    windows = Cut([one], ((0, first, 400),))
    states = inside(record, Cut([one], ((0, 0, 400),)), np.zeros((1, 7)))[1]
    start = np.zeros((1, 7))
    start[0, :3] = states[first, :3]
    held = np.max(np.abs(simulate(record, windows, start) - y[first:]))
    start[0, 6] = 0.01 - np.sign(states[first, 1]) * (states[first, 2] - y[first])
    assert np.max(np.abs(simulate(record, windows, start) - y[first:])) < 2e-4
    assert held > 5e-3


def test_the_baseline_of_a_rig_is_the_plant_that_its_axis_moves():
    config = load_rig(Path("configs/seat-virtual.yaml"))
    pitch, roll = rated(config, "pitch"), rated(config, "roll")
    assert pitch.K_L != roll.K_L
    assert rated(None, None).K_L is None
    assert dict(rated(None, None).effects) == {}
    plants = config.simulation.plants
    assert sorted([pitch.K_L, roll.K_L]) == pytest.approx(sorted(each.K_L for each in plants.values()))


def test_an_axis_that_no_plant_moves_is_told():
    config = load_rig(Path("configs/seat-virtual.yaml"))
    none = config.simulation.model_copy(update={"plants": {}})
    with pytest.raises(DiagnoseError, match="no simulated plant"):
        rated(config.model_copy(update={"simulation": none}), "pitch")
