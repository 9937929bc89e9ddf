"""Fits in a loop that acts on what disturbs the load: by prediction errors they come to the plant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gusty_loop import DAMPED, N, by_simulation, multisine, off, recorded, relay, servo, stepped

from seod.diagnose.account.loop import beside_commands
from seod.diagnose.account.prediction_errors import Predictions, in_closed_loop
from seod.diagnose.fitting.uncertainty import covariance
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.memory import has_past, unforeseen
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut

STRONG = 400.0
"""They make half of what the relay makes of the movement."""


def found(command, **how):
    """Fitted by its simulation, and by prediction errors."""
    plain, halves = by_simulation(*stepped(command, **how))
    return plain, Predictions(plain, halves, map, lambda: lambda: False).predicted(plain)


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
@pytest.mark.parametrize(("stiffness", "likelier"), [(0.0, False), (3000.0, True)])
def test_a_cause_is_asked_for_prediction_errors_too(stiffness, likelier):
    """A spring makes up for what gusts have moved; of a load that has one it saves both."""
    plain, halves = by_simulation(*stepped(relay(), truth=DAMPED, spring=stiffness))
    how = Predictions(plain, halves, map, lambda: lambda: False)
    sprung = plain.model.with_effect("load_spring")
    begun = plain.model.values(plain.x) | {"load_spring.stiffness": 1000.0, "load_spring.centre": 0.0}
    other = replace(plain, model=sprung, x=sprung.searched(begun))
    assert how.saves(other, how.with_own_noise(plain)) is likelier


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
