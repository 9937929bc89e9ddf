"""A load that a further channel shows. The truth is integrated here."""

from __future__ import annotations

import json

import numpy as np
import pytest
from diagnose_truth import multisine, recording
from scipy.signal import lfilter

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.search.budget import EFFORTS

RATE, N = 1000.0, 12000
K_L, OMEGA_N, ZETA = 17.0, 60.0, 0.35
GAIN = 3.0
"""Acceleration for each unit of the channel [unit/s^2]."""
ZERO = 5.0
"""Of the channel above its mean, where it does nothing."""


def channel(seed, mean=40.0):
    """A force that wanders, in hundreds."""
    return mean + 25.0 * lfilter([1.0], [1.0, -0.99], np.random.default_rng(seed).normal(size=N))


def moved(u, force, gain=GAIN):
    """Position of Eq. 1 with a force that runs straight on between samples, by Heun's method."""
    parts = 4
    h = 1.0 / RATE / parts
    p = v = y = 0.0
    out = np.empty(N)
    ends, volts = np.r_[force[1:], force[-1]].tolist(), u.tolist()

    def slope(p, v, u, push):
        return OMEGA_N**2 * (K_L * u - v) - 2.0 * ZETA * OMEGA_N * p, p + gain * push, v

    for k, begin in enumerate(force.tolist()):
        out[k] = y
        for i in range(parts):
            push = begin + (ends[k] - begin) * i / parts, begin + (ends[k] - begin) * (i + 1) / parts
            dp, dv, dy = slope(p, v, volts[k], push[0])
            ep, ev, ey = slope(p + h * dp, v + h * dv, volts[k], push[1])
            p, v, y = p + 0.5 * h * (dp + ep), v + 0.5 * h * (dv + ev), y + 0.5 * h * (dy + ey)
    return out


@pytest.fixture(scope="module")
def shaken():
    u, force = multisine(N), channel(7)
    return u, force, moved(u, force - force.mean() - ZERO)


@pytest.mark.slow
def test_what_the_channel_does_is_named_with_its_gain(shaken):
    u, force, y = shaken
    told = diagnose([recording(u, y, f=force)], options=Options(effort="quick"))
    assert [each.name for each in told.effects] == ["measured_disturbance"]
    assert told.verdict == "effects"
    low, high = told.effects[0].parameters["gain"].ci95
    assert low <= GAIN <= high
    assert high - low < 0.1 * GAIN
    low, high = told.effects[0].parameters["zero"].ci95
    assert low <= ZERO <= high
    assert high - low < 0.1 * ZERO
    assert abs(told.extended.K_L - K_L) < 2e-3 * K_L
    json.dumps(told.as_json(), allow_nan=False)


@pytest.mark.slow
def test_without_the_channel_it_is_not_named(shaken, monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", 0.05)  # nothing is to be found: longer searches end alike
    u, _, y = shaken
    told = diagnose([recording(u, y)], options=Options(effort="quick"))
    assert "measured_disturbance" not in [each.name for each in told.effects]
    assert told.extended.holdout_nrmse > 0.05


@pytest.mark.slow
def test_a_channel_that_does_nothing_is_not_named(shaken):
    u, force, _ = shaken
    told = diagnose([recording(u, moved(u, force, gain=0.0), f=channel(8))], options=Options(effort="quick"))
    assert not told.effects


@pytest.mark.slow
def test_a_force_that_moves_the_load_more_than_all_commands_hides_no_plant():
    rng = np.random.default_rng(3)
    u, force = np.repeat(rng.uniform(-3.0, 3.0, N // 1000), 1000), channel(7)
    clean = moved(u, force - force.mean(), gain=30.0 * GAIN)
    y = clean + rng.normal(size=N) * 0.003 * np.std(clean)
    told = diagnose([recording(-u, y, f=force)], options=Options(effort="quick"))
    assert told.baseline.holdout_nrmse > 1.0  # Eq. 1 alone is worse than a mean
    assert [each.name for each in told.effects] == ["measured_disturbance"]
    assert told.verdict == "effects"
    low, high = told.effects[0].parameters["gain"].ci95
    assert low <= 30.0 * GAIN <= high
    assert abs(told.extended.K_L + K_L) < 0.1 * K_L


def test_fewer_samples_see_the_mean_of_the_channel(shaken):
    u, force, y = shaken
    every = series(recording(u, y, f=force), nominal_f=40.0)
    sparse = every.sparser(4)
    rows = np.arange(0, N, 4)
    assert sparse.force[5] == pytest.approx(np.mean(every.force[rows[4] + 1 : rows[5] + 1]))
    assert len(sparse.force) == len(sparse.t)
    assert len(series(recording(u, y)).sparser(4).force) == 0


def test_its_column_is_read(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,u,y,load [N]\n" + "".join(f"{k / 1000},{k % 3},{k},{2 * k}\n" for k in range(9)))
    found = read(path, "f=load")
    np.testing.assert_allclose(found.f, 2.0 * np.arange(9))
    assert found.units["f"] == "N"
    assert read(path).f is None
