"""Rows left out of figures where recordings have outliers: far off the noise, and off their window's rest."""

from types import SimpleNamespace

import numpy as np
import pytest

from seod.diagnose.verdict.answer import _without_outliers

ROWS = 1000
FAR = (17, 400, 1203)


def judged(left, far, floor=1.0):
    """Two windows of which so much is left [noise by differences], with a few rows as far off."""
    error = left * np.random.default_rng(4).normal(size=2 * ROWS)
    error[list(FAR)] = far
    slices = [slice(0, ROWS), slice(ROWS, 2 * ROWS)]
    cut = SimpleNamespace(y=error, slices=slices, floor=np.full(2, floor))
    return SimpleNamespace(cut=cut, simulated=np.zeros(2 * ROWS), scored=np.ones(2 * ROWS, np.bool_))


@pytest.mark.parametrize("left", [1.0, 4.0], ids=["white noise", "noise that remembers"])
def test_rows_far_off_the_rest_of_their_window_do_not_count(left):
    near = _without_outliers(judged(left, 8.0 * left))
    assert not near[list(FAR)].any()
    assert np.mean(near) > 0.99


def test_what_is_no_farther_off_than_the_rest_counts():
    assert np.mean(_without_outliers(judged(20.0, 40.0))) > 0.999


def test_where_many_rows_are_far_off_they_are_no_outliers():
    held = judged(1.0, 8.0)
    held.cut.y[::20] = 50.0
    assert _without_outliers(held).all()
