"""The picture of an identification: it shows what it says it shows."""

from __future__ import annotations

import numpy as np
import pytest

from seod.identify.plot import CLOSE, close_views, period_s
from seod.identify.record import Record

RATE_HZ = 1000.0


def recorded(hertz):
    """A record of 20 s whose y swings at these frequencies [Hz], one of each sample."""
    t = np.arange(0.0, 20.0, 1.0 / RATE_HZ)
    y = np.sin(2.0 * np.pi * np.cumsum(np.broadcast_to(hertz, t.shape)) / RATE_HZ)
    return Record("made", t, np.sign(y + 1e-9), y)


def length_s(record, look):
    return np.ptp(record.t[look.rows])


def test_the_close_views_are_where_the_error_is_largest_and_usual():
    record = recorded(10.0)
    left = np.where((record.t > 7.0) & (record.t < 7.2), 0.5, 0.01)
    worst, usual = close_views(record, left)
    assert record.t[worst.rows][0] <= 7.0 < record.t[worst.rows][-1]
    assert length_s(record, worst) == pytest.approx(CLOSE * 0.1, rel=0.05)
    assert length_s(record, usual) == pytest.approx(0.1, rel=0.05)
    assert np.all(left[usual.rows] == 0.01)
    assert "rms 0.01" in usual.title


def test_in_a_sweep_the_period_is_the_one_at_that_place():
    record = recorded(np.linspace(0.5, 20.0, 20_000))
    left = np.where(record.t > 19.0, 0.5, 0.01)
    worst, _ = close_views(record, left)
    assert record.t[worst.rows][0] > 18.5
    assert length_s(record, worst) == pytest.approx(CLOSE / 20.0, rel=0.2)


def test_a_short_recording_is_shown_as_it_is():
    t = np.arange(0.0, 0.05, 1.0 / RATE_HZ)
    record = Record("short", t, np.sign(t - 0.02), np.sin(2.0 * np.pi * 10.0 * t))
    for look in close_views(record, np.zeros(len(t))):
        assert 0 < len(t[look.rows]) <= len(t)


def test_the_period_is_the_largest_line_of_what_drifts():
    t = np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    assert period_s(t, np.sin(2.0 * np.pi * 4.0 * t) + 10.0 * t) == pytest.approx(0.25, rel=0.01)
