"""Where a search ends: where no cause promises to save more of the noise than chance would.

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
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows
from seod.diagnose.search import final_choice
from seod.diagnose.search.beam import Grown, grow
from seod.diagnose.search.budget import Budget
from seod.diagnose.search.noise_alone import noise_alone, nothing_promised
from seod.diagnose.search.screen import screen
from seod.diagnose.starts.search_roots import Roots
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.search import NOISE_ALONE

K_L, OMEGA_N, ZETA = 20.0, 60.0, 0.5
RATE, N = 500.0, 6000
T = np.arange(N) / RATE
NOISE = 0.01
"""[-] Of the movement's deviation."""


def moved(spring: float) -> tuple[np.ndarray, np.ndarray]:
    """Commands and positions of Eq. 1 with a spring [of the oil's stiffness] to the middle."""
    lines = np.arange(1, 13)
    u = 0.5 * np.sin(2.0 * np.pi * 0.5 * T[:, None] * lines + lines**2).sum(axis=1)
    a = np.zeros((4, 4))  # position, speed, acceleration by the oil, command
    a[0, 1] = a[1, 2] = 1.0
    a[1, 0] = -spring * OMEGA_N**2
    a[2, 1], a[2, 2], a[2, 3] = -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N, K_L * OMEGA_N**2
    step = expm(a / RATE)
    state, y = np.zeros(4), np.empty(N)
    for k in range(N):
        y[k] = state[0]
        state[3] = u[k]
        state = step @ state
    return u, y


def halves(memory: float, spring: float, seed: int = 1, line: float = 0.0):
    """Windows to fit and windows held out of readings with such noise, and the readings' deviation.

    And with a line of 28 Hz, as large as told over the noise.
    """
    u, y = moved(spring)
    noise = lfilter([1.0], [1.0, -memory], np.random.default_rng(seed).normal(size=2 * N))[N:]
    wave = line * np.sqrt(2.0) * np.sin(2.0 * np.pi * 28.0 * T)
    y = y + NOISE * np.std(y) * (noise / np.std(noise) + wave)
    one = series(Recording((Path("r.csv"),), T, u, y, None, None, None, np.arange(1, N + 1), {}, {}, ()))
    to_fit, held_out = cut([one])
    return fitted_windows(to_fit), held_out, float(np.std(y))


def fitted(memory: float, spring: float, seed: int = 1, line: float = 0.0):
    """Eq. 1 fitted to such readings, and the screen of its search."""
    to_fit, _, size = halves(memory, spring, seed, line)
    screened = screen(to_fit, map, Budget())
    sizes = Scales(1.0, 60.0 * size, 3600.0 * size, 0.0, size, size, 60.0, 12.0, 1.0 / RATE)
    model = baseline_model(sizes, 1.0, False, {})
    x = model.searched({"K_L": 18.0, "omega_n": 50.0, "zeta": 0.4})
    found = fit(model, screened.cut, x, simulated_states(model, x, screened.cut), 40)
    return found, screened


@pytest.mark.parametrize("memory", [0.0, 0.95, 0.99])
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_that_remembers_is_noise_alone(memory, seed):
    found, screened = fitted(memory, 0.0, seed)
    assert found.excess > 3.0 or memory == 0.0
    assert noise_alone(found, screened)


def test_a_spring_that_hardly_adds_to_white_noise_is_not():
    """The noise is known to some percent: a search ended there with a friction still to be found."""
    found, screened = fitted(0.0, 1e-4)
    assert found.excess < 1.03
    assert not noise_alone(found, screened)


@pytest.mark.parametrize("memory", [0.0, 0.95, 0.99])
def test_a_spring_beneath_such_noise_is_not(memory):
    assert not noise_alone(*fitted(memory, 0.02))


@pytest.mark.parametrize("memory", [0.95, 0.99])
@pytest.mark.parametrize("line", [2.5, 3.5])
def test_a_line_that_is_nearly_all_that_is_left_is_none_of_a_noise(memory, line):
    """A past of 64 rows foretells it, and the noise beneath it no worse."""
    assert not noise_alone(*fitted(memory, 0.0, line=line))


def test_rounding_that_hides_the_error_of_most_rows_tells_nothing():
    found, screened = fitted(0.95, 0.0)
    slack = float(np.sqrt(np.mean(found.error)))
    rounded = [replace(each, slack=slack) for each in found.cut.series]
    assert nothing_promised(found, screened)
    assert not nothing_promised(replace(found, cut=replace(found.cut, series=rounded)), screened)


def one_window(found):
    return replace(found, cut=found.cut.only([0]), start=found.start[:1], error=found.error[:1])


def test_what_few_windows_do_not_show_is_asked_of_all(monkeypatch):
    loose = replace(NOISE_ALONE, most=np.inf)
    monkeypatch.setattr("seod.diagnose.search.noise_alone.NOISE_ALONE", loose)
    found, screened = fitted(0.99, 0.005)
    less = one_window(found)
    assert nothing_promised(less, screened)
    assert not noise_alone(less, screened)


def test_no_memory_decides_where_much_of_the_movement_is_left(monkeypatch):
    """A slow spring left 5 % in two windows, and the search ended before it."""
    found, screened = fitted(0.95, 0.0)
    assert noise_alone(found, screened)
    strict = replace(NOISE_ALONE, much=0.5 * NOISE)
    monkeypatch.setattr("seod.diagnose.search.noise_alone.NOISE_ALONE", strict)
    assert not noise_alone(found, screened)


def test_a_memory_of_all_that_is_left_does_not_hide_what_makes_most_of_it():
    found, screened = fitted(0.99, 0.005)
    assert not nothing_promised(one_window(found), screened)
    alone, screened = fitted(0.99, 0.0)
    assert nothing_promised(one_window(alone), screened)


def test_nothing_is_tried_beside_noise_that_remembers():
    found, screened = fitted(0.99, 0.0)
    grown = grow(screened, Roots(found, [found]), lambda _: None)
    assert grown == Grown([found], {})


def test_where_no_row_counts_nobody_can_tell():
    found, screened = fitted(0.95, 0.0)
    none = [replace(each, good=np.zeros(len(each.t), np.bool_)) for each in found.cut.series]
    assert not nothing_promised(replace(found, cut=replace(found.cut, series=none)), screened)


@pytest.mark.parametrize(("spring", "looks"), [(0.0, False), (0.02, True)])
def test_whole_recordings_are_searched_where_something_is_promised(spring, looks, monkeypatch):
    found, screened = fitted(0.99, spring)
    to_fit, held_out, _ = halves(0.99, spring)
    base, asked = Judged.of(found, held_out), []

    def over_whole(*_):
        asked.append(True)
        return base, []

    monkeypatch.setattr(final_choice, "_over_whole", over_whole)
    choice = final_choice.choose(base, Grown([found]), to_fit, held_out, screened)
    assert base.held.adequacy > HELD_OUT.adequate
    assert bool(asked) is looks
    assert not choice.best.found.model.names
