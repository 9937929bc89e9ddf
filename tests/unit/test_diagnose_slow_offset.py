"""Numbers beside an offset of the sensor that moves slowly: their intervals hold the truth.

The plant is stepped by the exponential of its matrix, apart from `sim`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from seod.data import Recording
from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting import beside
from seod.diagnose.fitting.beside import beside_slow_offset, part_beside_slow_offset
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.noise_colour import WHITE, NoiseColour
from seod.diagnose.fitting.slow_offset import slow_part
from seod.diagnose.fitting.uncertainty import covariance
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, one_window_each

K_L, OMEGA_N, ZETA, HALF_WIDTH = 20.0, 100.0, 0.5, 0.08
RATE, N = 500.0, 6000
T = np.arange(N) / RATE
COLOUR = 0.95
PERIODS = (0.4, 0.7, 1.0, 1.3)
"""Of the offset, in the recording."""


def moved():
    """Positions and commands: Eq. 1 behind a valve with overlap, under a multisine."""
    a = np.zeros((4, 4))  # position, speed, acceleration by the oil, what the valve lets through
    a[0, 1] = a[1, 2] = 1.0
    a[2, 1], a[2, 2], a[2, 3] = -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N, K_L * OMEGA_N**2
    step = expm(a / RATE)
    lines = np.arange(1, 16)
    u = 0.4 * np.sin(np.outer(2.0 * np.pi * T, lines) + lines**2).sum(axis=1)
    through = np.sign(u) * np.maximum(np.abs(u) - HALF_WIDTH, 0.0)
    state, y = np.zeros(4), np.empty(N)
    for k in range(N):
        y[k], state[3] = state[0], through[k]
        state = step @ state
    return y, u


Y, U = moved()


def disturbed(periods, seed):
    """Noise that remembers, and as much of a slow wave."""
    random = np.random.default_rng(seed)
    noise = lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], random.normal(size=N + 500))[500:]
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * periods * T / T[-1] + random.uniform(0.0, 2.0 * np.pi))
    return Y + 0.01 * np.std(Y) * (noise + wave) / np.sqrt(2.0)


def off(y, slow):
    """Error of the overlap by a fit to the whole recording, over its deviation, and the deviation [V]."""
    rows = np.arange(1, N + 1)
    one = series(Recording((Path("run.csv"),), T, U, y, None, None, None, rows, {}, {}, ()))
    size = float(np.std(y))
    sizes = Scales(1.0, 100.0 * size, 1e4 * size, 0.0, size, size, 100.0, 12.0, 1.0 / RATE)
    model = baseline_model(sizes, 1.0, False, {}).with_effect("valve_deadband")
    x = model.searched(
        {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA, "valve_deadband.half_width": HALF_WIDTH}
    )
    cut = Cut([one], one_window_each([one])).remembering((COLOUR,), 0.01 * size if slow else 0.0)
    fitted = fit(model, cut, x, simulated_states(model, x, cut))
    fitted = beside_slow_offset(fitted, map)
    sd = float(np.sqrt(covariance(fitted)[-1, -1])) * model.coordinates[-1].scale
    return (model.values(fitted.x)["valve_deadband.half_width"] - HALF_WIDTH) / sd, sd


def test_an_offset_that_moves_slowly_is_in_the_intervals():
    every = [off(disturbed(periods, seed), slow=True) for seed, periods in enumerate(PERIODS * 3)]
    z, sd = np.array(every).T
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert np.max(sd) < 0.05 * HALF_WIDTH


def test_without_it_numbers_are_bent_by_many_deviations():
    z = [off(disturbed(periods, seed), slow=False)[0] for seed, periods in enumerate(PERIODS * 3)]
    assert np.sqrt(np.mean(np.square(z))) > 3.0


def test_a_step_that_a_simulation_does_not_follow_in_proportion_is_not_taken(monkeypatch):
    y = disturbed(0.7, 3)
    taken = off(y, slow=True)
    monkeypatch.setattr(beside, "SLOW_OFFSET", replace(beside.SLOW_OFFSET, astray=0.0))
    left = off(y, slow=True)
    assert left[0] * left[1] == pytest.approx(off(y, slow=False)[0] * off(y, slow=False)[1])
    assert left[0] != taken[0]
    assert left[1] == pytest.approx(taken[1], rel=0.1)


def kept_beside_slow_offset(y, name, omega=1.0):
    """Of what an effect saves of the log squared error, in quarters, the part saved beside such an offset."""
    rows = np.arange(1, N + 1)
    one = series(Recording((Path("run.csv"),), T, U, y, None, None, None, rows, {}, {}, ()))
    size = float(np.std(y))
    sizes = Scales(1.0, 100.0 * size, 1e4 * size, 0.0, size, size, 100.0, 12.0, 1.0 / RATE)
    begin = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA, "valve_deadband.half_width": HALF_WIDTH}
    begin |= {"periodic_disturbance.omega": omega}
    cut = Cut([one], tuple((0, k, k + N // 4) for k in range(0, N, N // 4)))
    without = baseline_model(sizes, 1.0, False, {}).with_effect("valve_deadband")
    sets = []
    for model in (without.with_effect(name), without):
        places = model.values(np.zeros(len(model.coordinates)))
        x = model.searched({place: begin.get(place, 0.0) for place in places})
        sets.append(fit(model, cut, x, simulated_states(model, x, cut)))
    own, fewer = sets
    return part_beside_slow_offset(own, fewer, map)


def test_beside_an_offset_that_moves_slowly_a_load_counts_and_a_wave_that_stood_for_it_does_not():
    """A constant load moves an integrating plant farther than the error of a window is large."""
    random = np.random.default_rng(5)
    noise, size = 5e-3 * np.std(Y) * random.normal(size=N), float(np.std(Y))
    omega = 2.0 * np.pi * 1.3 / T[-1]
    wave, drift = 0.02 * size * np.sin(omega * T + 1.0), 0.02 * size * T
    of_wave = kept_beside_slow_offset(Y + noise + wave, "periodic_disturbance", omega)
    of_load = kept_beside_slow_offset(Y + noise + drift, "load_bias")
    assert of_wave < 0.2
    assert of_load > 0.6


def test_white_noise_has_no_such_part_nor_have_errors_that_rounding_hides():
    rows = np.arange(1, N + 1)
    one = series(Recording((Path("run.csv"),), T, U, Y, None, None, None, rows, {}, {}, ()))
    cut = Cut([one], one_window_each([one]))
    coarse = Cut([replace(one, slack=0.1)], one_window_each([one]))
    noise = NoiseColour((COLOUR,), 0.3, 39.0)
    assert slow_part(WHITE, cut) == 0.0
    assert slow_part(noise, coarse) == 0.0
    assert slow_part(noise, cut) == pytest.approx(0.3)
