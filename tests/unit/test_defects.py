"""Defects of recordings: their statistics, and that null values do nothing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.defects import jittered, missing_samples, outliers

N = 200_000


def seeded(seed=1):
    return np.random.default_rng(seed)


def gaps(missing):
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missing, [False]))))
    return edges[1::2] - edges[::2]


@pytest.mark.parametrize(("rate", "length"), [(0.02, 1.0), (0.1, 5.0), (0.5, 50.0), (0.4, 1.0)])
def test_missing_samples_have_their_rate_and_length(rate, length):
    missing = missing_samples(N, rate, length, seeded())
    found = gaps(missing)
    assert missing.mean() == pytest.approx(rate, rel=5.0 * math.sqrt(2.0 * length / (N * rate)))
    assert found.mean() == pytest.approx(length, rel=5.0 / math.sqrt(len(found)))
    if length > 1.0:
        assert found.std() == pytest.approx(length, rel=0.2)


def test_more_than_short_gaps_can_hold_makes_them_longer():
    missing = missing_samples(N, 0.9, 1.0, seeded())
    assert missing.mean() == pytest.approx(0.9, rel=0.01)
    assert gaps(missing).mean() == pytest.approx(9.0, rel=0.05)
    assert missing_samples(5, 1.0, 1.0, seeded()).all()
    assert not missing_samples(5, 0.0, 1.0, seeded()).any()


@given(st.floats(0.0, 1.0), st.floats(1.0, 1e6), st.integers(0, 300))
def test_any_rate_and_length_end(rate, length, n):
    assert len(missing_samples(n, rate, length, seeded())) == n


def test_outliers_have_their_rate_and_size():
    errors = outliers(N, 0.03, 0.5, seeded())
    there = errors[errors != 0.0]
    assert len(there) / N == pytest.approx(0.03, rel=0.05)
    assert there.std() == pytest.approx(0.5, rel=0.05)
    assert not outliers(N, 0.0, 0.5, seeded()).any()
    assert not outliers(N, 0.5, 0.0, seeded()).any()


def test_jitter_moves_samples_but_not_past_each_other():
    t = np.arange(N) * 5e-4
    small = jittered(t, 2e-5, seeded())
    assert (small - t)[1:].std() == pytest.approx(2e-5, rel=0.02)
    large = jittered(t, 1e-3, seeded())
    assert np.all(np.diff(large) >= 0.0)
    assert large[0] >= 0.0
    assert (large - t).std() > 2e-4
    assert jittered(t, 0.0, seeded()) is t
