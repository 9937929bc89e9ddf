"""Eq. 1 in closed form, against a linear plant of its own equations."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, RATE, ZETA, linear, multisine, recording

from seod.diagnose.record import closed_form as module
from seod.diagnose.record.closed_form import UserValues, closed_form

ROWS = 4000


@pytest.fixture
def searched(monkeypatch):
    monkeypatch.setattr(module, "BLOCKS", replace(module.BLOCKS, searched_rows=ROWS))


def near(found, tolerance=0.02):
    plant = {"K_L": K_L, "omega_n": OMEGA_N, "zeta": ZETA}
    assert {name: found.values[name] for name in plant} == pytest.approx(plant, rel=tolerance)


def test_the_plant_of_a_short_recording_is_found():
    u = multisine(ROWS)
    near(closed_form([recording(u, linear(u))], "position", UserValues()))


def test_a_long_recording_is_asked_where_its_command_moves_most(searched):
    """Elsewhere something else moves the load."""
    u = np.concatenate([0.01 * multisine(ROWS), multisine(ROWS), 0.02 * multisine(ROWS), [0.0]])
    y = linear(u)
    other = np.arange(len(u)) // ROWS != 1
    y[other] += np.std(y) * np.sin(2.0 * np.pi * 7.0 * np.arange(len(u)) / RATE)[other]
    found = closed_form([recording(u, y)], "position", UserValues())
    near(found)
    assert found.nrmse < 0.01


def test_the_end_of_a_recording_is_looked_at_too(searched):
    u = np.concatenate([np.zeros(ROWS), multisine(ROWS // 2)])
    near(closed_form([recording(u, linear(u))], "position", UserValues()))


def test_rows_without_a_reading_do_not_count_as_movement(searched):
    u = np.concatenate([10.0 * multisine(ROWS), multisine(ROWS)])
    one = recording(u, linear(u))
    one.y[:ROWS] = np.nan
    near(closed_form([one], "position", UserValues()))


def test_a_recording_without_any_reading_has_no_plant(searched):
    u = multisine(3 * ROWS)
    found = closed_form([recording(u, np.full(len(u), np.nan))], "position", UserValues())
    assert found.values == {}
    assert found.nrmse == np.inf
