"""Readings that repeat on a clock, and what repeats for other reasons."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seod.diagnose.record.held_readings import held_readings

TICK = 1e-3
T = np.arange(20000) * TICK


def movement(t):
    return np.sin(8.2 * t) + 0.3 * np.sin(25.0 * t)


def shown(hold, phase=4e-4, noise=0.01, step=0.0):
    """When each row's reading was taken, and it."""
    looked = np.floor((T - phase) / hold + 1e-6) * hold + phase
    times, which = np.unique(looked, return_inverse=True)
    y = movement(times) + np.random.default_rng(1).normal(0.0, noise, len(times))
    y = np.round(y / step) * step if step else y
    return looked, y[which]


@pytest.mark.parametrize("step", [0.0, 0.002])
@pytest.mark.parametrize("rows", [1.5, 2.7, 7.77, 33.3])
def test_the_clock_and_the_times_of_readings_are_found(rows, step):
    looked, y = shown(rows * TICK, step=step)
    found = held_readings(T, y)
    assert found is not None
    assert found.time == pytest.approx(rows * TICK, rel=1e-5)
    late = (found.taken - looked)[~found.repeated]
    assert np.max(np.abs(late)) < 0.11 * TICK


@given(st.one_of(st.floats(1.22, 1.9), st.floats(2.1, 40.0)), st.floats(0.0, 1.0))
def test_any_clock_is_found(rows, part):
    """Near two rows a clock looks like the one that is as much above as it is below."""
    _, y = shown(rows * TICK, phase=part * rows * TICK)
    found = held_readings(T, y)
    assert found is not None
    assert found.time == pytest.approx(rows * TICK, rel=1e-3)


@given(st.floats(0.2, 0.8), st.integers(0, 1000))
def test_readings_that_are_lost_at_random_have_no_clock(part, seed):
    lost = np.random.default_rng(seed).random(len(T)) < part
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(T))))
    assert held_readings(T, movement(T)[last]) is None


@pytest.mark.parametrize("rows", [2, 5, 10])
def test_a_clock_in_step_with_the_rows_reads_at_them(rows):
    _, y = shown(rows * TICK, phase=0.0)
    found = held_readings(T, y)
    assert found is not None
    np.testing.assert_allclose(found.taken, T, atol=1e-5 * TICK)
    np.testing.assert_array_equal(np.flatnonzero(~found.repeated) % rows, 0)


@pytest.mark.parametrize(
    "y",
    [
        movement(T),
        np.round(movement(T) / 0.01) * 0.01,
        np.round((T % 2.0 - 1.0) / 0.01) * 0.01,
        np.maximum(movement(T), 0.0),
        np.where(np.sin(5.0 * T) > 0.0, 1.0, -1.0),
        np.round(np.cumsum(np.random.default_rng(1).normal(size=len(T)))),
        np.zeros(len(T)),
    ],
    ids=["smooth", "coarse", "even ramps", "at an end", "square", "wandering", "at rest"],
)
def test_what_repeats_for_other_reasons_has_no_clock(y):
    assert held_readings(T, y) is None


@pytest.mark.parametrize("rest", [70000, 100])
def test_a_load_that_is_at_rest_first_has_a_clock_where_enough_follows(rest):
    _, y = shown(2.7 * TICK)
    y = np.append(np.full(rest, y[0]), y)
    assert held_readings(np.arange(len(y)) * TICK, y).time == pytest.approx(2.7 * TICK, rel=1e-4)


def test_readings_that_hardly_ever_change_have_none():
    y = np.repeat(np.random.default_rng(5).normal(size=50), 3000)
    assert held_readings(np.arange(len(y)) * TICK, y) is None
