"""How much of what a model leaves acts on the load: noise with a memory before the plant and behind it.

What acts on the load goes through the exponential of the plant's matrix, apart from `sim` and from spectra.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from seod.diagnose.account import load_noise
from seod.diagnose.account.load_noise import on_load
from seod.diagnose.account.residual import Plant, WindowResidual

RATE, N, WINDOWS = 1000.0, 12000, 8


def shaken(plant, corner=1.0, seed=1):
    """The load under random torques with this corner frequency, over the plant's."""
    omega_n, keep = plant.omega_n, np.exp(-corner * plant.omega_n / RATE)
    a = np.zeros((4, 4))  # position, speed, acceleration by the oil, by the torque
    a[0, 1] = a[1, 2] = a[1, 3] = 1.0
    a[2, 1], a[2, 2], a[3, 3] = -(omega_n**2), -2.0 * plant.zeta * omega_n, -corner * omega_n
    step, random = expm(a / RATE), np.random.default_rng(seed)
    state, out = np.zeros(4), np.empty(N)
    for k in range(N):
        out[k] = state[int(plant.sees_speed)]
        state = step @ state
        state[3] += np.sqrt(1.0 - keep**2) * random.normal()
    return out


def coloured(memory, seed=2):
    """AR(1) noise of a sensor."""
    noise = np.random.default_rng(seed).normal(size=N + 2000)
    return lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], noise)[2000:]


def windows(error):
    """Each from an initial state of its own."""
    out = []
    for k, each in enumerate(np.split(error, WINDOWS)):
        t = np.arange(len(each)) / RATE
        left, nothing = each - np.polynomial.Polynomial.fit(t, each, 1)(t), np.zeros(len(each))
        counts = np.ones(len(each), np.bool_)
        out.append(WindowResidual(0, t, nothing, left, counts, nothing, nothing, nothing, k % 2 == 1))
    return out


def alike(error):
    """With a mean square of 1 over its windows."""
    return error / np.sqrt(np.mean([np.var(each.error) for each in windows(error)]))


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("memory", [0.0, 0.95])
@pytest.mark.parametrize("corner", [1.0, 10.0])
@pytest.mark.parametrize(
    "plant", [Plant(100.0, 0.3, False), Plant(30.0, 0.1, False), Plant(100.0, 0.3, True)]
)
def test_the_share_that_acts_on_the_load(plant, corner, memory, share):
    error = np.sqrt(share) * alike(shaken(plant, corner)) + np.sqrt(1.0 - share) * alike(coloured(memory))
    found = on_load(windows(error), plant)
    assert 0.0 <= found.least <= found.share <= found.most <= 1.0
    assert found.least - 0.05 <= share <= found.most + 0.05
    if share == 1.0:
        assert found.least > 0.9
    elif not memory and not share:
        assert found.most < 0.1


def test_an_overdamped_plant_is_as_a_sensor_with_a_memory_and_it_says_so():
    plant = Plant(100.0, 1.5, True)
    found = on_load(windows(coloured(0.99)), plant)
    assert found.least < 0.1
    assert found.most > 0.9


def test_a_hum_is_neither():
    plant = Plant(100.0, 0.3, False)
    error = alike(shaken(plant)) + alike(np.sin(2.0 * np.pi * 50.0 * np.arange(N) / RATE))
    assert on_load(windows(error), plant).least > 0.9


def test_what_shows_one_side_of_the_plant_tells_nothing():
    parts = windows(coloured(0.5))
    assert on_load(parts, Plant(100.0, 0.3, False)) is not None
    assert on_load(parts, Plant(3000.0, 0.3, False)) is None
    assert on_load(parts, Plant(1.0, 0.3, False)) is None
    short = [replace(one, t=one.t[:40], error=one.error[:40], scored=one.scored[:40]) for one in parts]
    assert on_load(short, Plant(100.0, 0.3, False)) is None


def test_least_squares_that_do_not_end_leave_what_there_is(monkeypatch):
    def endless(*_):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(load_noise, "nnls", endless)
    found = on_load(windows(coloured(0.5)), Plant(100.0, 0.3, False))
    assert 0.0 <= found.least <= found.share <= found.most <= 1.0


def test_rows_that_do_not_count_are_bridged():
    plant = Plant(100.0, 0.3, False)
    parts = windows(alike(shaken(plant)) + 0.1 * coloured(0.0))
    holes = []
    for one in parts:
        counts, error = one.scored.copy(), one.error.copy()
        counts[300:310], error[300:310] = False, 1e6
        holes.append(replace(one, error=error, scored=counts))
    whole, bridged = (on_load(some, plant).share for some in (parts, holes))
    assert bridged == pytest.approx(whole, abs=0.05)
