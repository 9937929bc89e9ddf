"""Fits in a loop that acts on what disturbs the load: by prediction errors they come to the plant.

The plant is stepped by the exponential of its matrix, apart from `sim`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose.account.loop import beside_commands
from seod.diagnose.account.prediction_errors import Predictions, in_closed_loop
from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.fitting.uncertainty import covariance
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.memory import has_past, unforeseen
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows

TRUTH = {"K_L": 20.0, "omega_n": 100.0, "zeta": 0.5}
DAMPED = {**TRUTH, "zeta": 0.8}
RATE, N = 1000.0, 12000
T = np.arange(N) / RATE
GUSTS = 60.0
STRONG = 400.0
"""They make half of what the relay makes of the movement."""


def stepped(command, seed=1, truth=TRUTH, gusts=GUSTS):
    """Readings and commands of Eq. 1 as a position, under random forces; `command(y, k)` gives the volts."""
    K_L, omega_n, zeta = truth.values()
    a = np.zeros((5, 5))  # position, speed, acceleration by the oil, command, force
    a[0, 1] = a[1, 2] = 1.0
    a[1, 4] = 1.0
    a[2, 1], a[2, 2], a[2, 3] = -(omega_n**2), -2.0 * zeta * omega_n, K_L * omega_n**2
    step = expm(a / RATE)
    random = np.random.default_rng(seed)
    state, keep = np.zeros(5), np.exp(-omega_n / RATE)
    y, u = np.empty(N), np.empty(N)
    for k in range(N):
        y[k] = state[0] + 1e-3 * random.normal()
        u[k] = state[3] = command(y[k], k)
        state[4] = keep * state[4] + gusts * np.sqrt(1.0 - keep**2) * random.normal()
        state = step @ state
    return y, u


def relay():
    last = [1.0]

    def command(y, _):
        last[0] = -1.0 if y > 0.02 else 1.0 if y < -0.02 else last[0]
        return last[0]

    return command


def multisine(_, k):
    lines = np.arange(1, 16)
    return 0.4 * float(np.sum(np.sin(2.0 * np.pi * lines * T[k] + lines**2)))


def servo(y, k):
    return 4.0 * (0.5 * np.sin(2.0 * np.pi * 0.7 * T[k]) - y)


def recorded(y, u):
    rows = np.arange(1, N + 1)
    return Recording((Path("loop.csv"),), T, u, y, None, None, None, rows, {}, {}, ())


def found(command, **how):
    """Fitted by its simulation, and by prediction errors."""
    y, u = stepped(command, **how)
    one = series(recorded(y, u))
    halves = cut([one])
    to_fit = fitted_windows(halves[0])
    size = float(np.std(y))
    sizes = Scales(1.0, 100.0 * size, 1e4 * size, 0.0, size, size, 100.0, 12.0, 1.0 / RATE)
    model = baseline_model(sizes, 1.0, False, {})
    x = model.searched({"K_L": 18.0, "omega_n": 90.0, "zeta": 0.4})
    plain = fit(model, to_fit, x, simulated_states(model, x, to_fit), 40, enough=1e-7)
    how = Predictions(plain, halves, map, lambda: lambda: False)
    return plain, how.predicted(plain)


def off(fitted, truth=TRUTH):
    values = fitted.model.values(fitted.x)
    return np.array([np.log(values[name] / true) for name, true in truth.items()])


@pytest.mark.slow
def test_under_a_relay_that_answers_to_gusts_the_plant_is_found():
    plain, predicted = found(relay())
    assert predicted is not None
    sd = np.sqrt(np.diag(covariance(predicted.fitted)))
    assert np.max(np.abs(off(predicted.fitted)) / sd) < 4.0
    assert np.max(sd) < 0.02
    assert np.max(np.abs(off(plain))) > 1.0
    assert predicted.told is predicted.fitted
    assert predicted.fitted.cut.memory


@pytest.mark.slow
def test_under_gusts_that_move_the_load_half_as_much_as_the_relay_does_the_plant_is_found():
    """The simulation's fit is a plant of little damping then, and what it leaves is far from the gusts."""
    plain, predicted = found(relay(), truth=DAMPED, gusts=STRONG)
    assert predicted is not None
    sd = np.sqrt(np.diag(covariance(predicted.fitted)))
    assert np.max(np.abs(off(predicted.fitted, DAMPED)) / sd) < 4.0
    assert np.max(sd) < 0.1
    assert np.max(np.abs(off(plain, DAMPED))) > 1.0


@pytest.mark.slow
def test_such_a_recording_is_clean_and_tells_the_plant():
    told = diagnose([recorded(*stepped(relay(), truth=DAMPED, gusts=STRONG))], (), Options(effort="quick"))
    assert (told.verdict, told.effects) == ("clean", ())
    for name, true in DAMPED.items():
        assert getattr(told.extended, name) == pytest.approx(true, rel=0.1)


def test_what_disturbs_readings_beside_commands_is_foretold_by_its_own_past():
    """Of any plant that is linear, in a loop: none is fitted."""
    random = np.random.default_rng(5)
    y, u, memory = np.zeros(N), np.zeros(N), np.array([1.2, -0.5])
    disturbance = np.zeros(N)
    for k in range(2, N):
        disturbance[k] = memory @ disturbance[[k - 1, k - 2]] + random.normal()
        y[k] = disturbance[k] + 3.0 * u[k - 1]
        u[k] = -1.0 if y[k] > 1.0 else 1.0 if y[k] < -1.0 else u[k - 1]
    one = series(recorded(y, u), sees_speed=True)
    found_memory = beside_commands(cut([one]))
    np.testing.assert_allclose(found_memory[:2], memory, atol=0.05)
    np.testing.assert_allclose(found_memory[2:], 0.0, atol=0.06)


def test_few_rows_tell_nothing_of_what_disturbs_them():
    y, u = stepped(relay())
    one = series(recorded(y, u))
    few = [
        replace(half, windows=tuple((k, first, first + 40) for k, first, _ in half.windows[:1]))
        for half in cut([one])
    ]
    assert beside_commands(few) == ()


@pytest.mark.slow
@pytest.mark.parametrize(("command", "loop"), [(servo, True), (multisine, False)])
def test_whether_commands_answer_to_what_disturbs_the_load_is_seen(command, loop):
    _, predicted = found(command)
    assert predicted is not None
    assert in_closed_loop(predicted.fitted) is loop
    assert (predicted.told is predicted.fitted) is loop


def test_what_an_autoregression_does_not_foretell_is_the_noise_that_drives_it():
    white = np.random.default_rng(2).normal(size=500)
    noise = np.zeros(500)
    for k in range(500):
        noise[k] = white[k] + 1.5 * noise[k - 1] * (k > 0) - 0.6 * noise[k - 2] * (k > 1)
    np.testing.assert_allclose(unforeseen(noise, (1.5, -0.6)), white, atol=1e-9)
    assert unforeseen(noise, ()) is noise


def test_a_row_counts_where_all_before_it_do_by_which_it_is_foretold():
    counts = np.array([True, True, True, False, True, True, True])
    assert has_past(counts, 2).tolist() == [False, False, True, False, False, False, True]
    assert has_past(counts, 0).tolist() == counts.tolist()


def test_a_set_that_leaves_something_systematic_is_not_taken_apart(monkeypatch):
    """Fits of all its parts would take most of a diagnosis whose cause is on no list."""
    left = SimpleNamespace(cut=SimpleNamespace(memory=(0.9,)), model=SimpleNamespace(names=("drag",)))
    taken = []
    monkeypatch.setattr(Predictions, "with_own_noise", lambda _, found: found)
    monkeypatch.setattr(Predictions, "without", lambda *_: taken.append(1))
    how = Predictions(left, (), map, lambda: lambda: False, lambda _: False)
    assert how.predicted(left) is None
    assert not taken
