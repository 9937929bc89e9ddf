"""Where the search for a disturbance, or a ripple, begins, and what it is not."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plant_truth import Plant

from seod.data import Recording
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, segments
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.race import extended, imitates
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.baseline import baseline
from seod.diagnose.starts.effect_starts import effect_starts
from seod.diagnose.starts.sizes import scales
from seod.diagnose.tuning.starts import EFFECT_STARTS

pytestmark = pytest.mark.slow

T = np.arange(6000) / 500.0


def searched(plant, u, *, sees_speed=False):
    """A screen of what the plant does with these commands and noise, and Eq. 1 fitted to it."""
    y = np.empty(len(T))
    for k in range(len(T)):
        plant.advance(T[k])
        plant.command(u[k])
        y[k] = plant.reading(plant.w)
    y += np.random.default_rng(6).normal(0.0, 0.01 * np.std(y), len(T))
    read = Recording((Path("run.csv"),), T, u, y, None, None, None, np.arange(len(T)), {}, {}, ())
    small = segments(cut([series(read, sees_speed=sees_speed)])[0])
    screened = screen(small, map, Budget(time.process_time, 1e6))
    begun = baseline(screened.cut, sees_speed, {}).best
    return screened, replace(begun, model=replace(begun.model, scales=scales(begun, screened.cut)))


def steps():
    return np.random.default_rng(5).uniform(-0.4, 0.4, 24)[(T / 0.5).astype(int)]


def test_a_disturbance_that_was_taken_for_the_plant_s_own_swinging_is_found():
    shaken = {"periodic_disturbance": {"amplitude": 440.0, "omega": 34.2, "phase": 0.1}}
    screened, parent = searched(Plant(29.0, 42.7, 0.16, shaken), steps())
    assert abs(parent.model.values(parent.x)["omega_n"] - 34.2) < 0.2  # not 42.7
    best = extended(screened, [parent])[0]
    assert best.model.names == ("periodic_disturbance",)
    assert best.excess < 1.1


@pytest.mark.parametrize("gain", [1.0, 0.8])  # what a wrong gain leaves is slow, and the most
def test_a_disturbance_is_looked_for_beside_where_the_plant_swings(gain):
    shaken = {"periodic_disturbance": {"amplitude": 440.0, "omega": 34.2, "phase": 0.1}}
    screened, root = searched(Plant(29.0, 42.7, 0.16, shaken), steps())
    x = root.model.searched({"K_L": gain * 29.0, "omega_n": 36.0, "zeta": 0.06})
    begun = effect_starts(replace(root, x=x), "periodic_disturbance", screened.every)
    damped = [
        one["periodic_disturbance.omega"] for one in begun if one.get("zeta") == EFFECT_STARTS.little_damped
    ]
    assert damped[0] == pytest.approx(36.0)
    assert damped[1] == pytest.approx(34.2, abs=0.02)


def test_a_ripple_of_a_speed_is_looked_for_where_the_readings_say_that_the_load_is():
    rippled = {"position_ripple": {"amplitude": 0.004, "wavenumber": 19.0, "phase": 0.3}}
    screened, root = searched(Plant(29.0, 42.7, 0.16, rippled, sees_speed=True), steps(), sees_speed=True)
    model, values = root.model, root.model.values(root.x)
    other = replace(root, x=model.searched(values | {"K_L": 1.3 * values["K_L"]}))
    found = [
        one["position_ripple.wavenumber"] for one in effect_starts(other, "position_ripple", screened.every)
    ]
    assert min(abs(one - 19.0) for one in found) < 0.5


def test_a_disturbance_in_step_with_the_command_is_none_where_it_is_not_all():
    omega = 2.0 * np.pi * 3.0 / 1.5
    shaken = {"periodic_disturbance": {"amplitude": 300.0, "omega": omega, "phase": 0.1}}
    u = np.tile(np.random.default_rng(5).uniform(-0.4, 0.4, 3), 8)[(T / 0.5).astype(int)]
    screened, root = searched(Plant(29.0, 42.7, 0.5, shaken), u)
    model = root.model.with_effect("periodic_disturbance")
    best = next(one for one in extended(screened, [root]) if one.model.names == model.names)
    assert best.model.values(best.x)["periodic_disturbance.omega"] == pytest.approx(omega, rel=1e-2)
    assert not imitates(best, screened.every)
    assert imitates(replace(best, cost=best.cost + 0.2), screened.every)
