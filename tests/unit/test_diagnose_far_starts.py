"""Causes that lie far from where a search would begin, or small beside an offset.

The rig is a mass on oil in plain small steps, all damping by leakage.
"""

from __future__ import annotations

import numpy as np
import pytest
from diagnose_truth import RATE, recording
from scipy.signal import lfilter

from seod.diagnose.fitting.judged import Judged
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.search import final_choice
from seod.diagnose.starts.baseline import baseline

STEPS = 10
K_L, OMEGA_N = 10.0, 100.0


def rig(u, zeta=0.3, limit=np.inf, more_up=0.0, lag=0.0):
    """Positions and speeds: of a valve with an end, with unequal gains; behind a lag."""
    x = v = a = seen = 0.0
    h = 1.0 / (RATE * STEPS)
    out = []
    for volts in u:
        out.append((seen if lag else x, v))
        opened = min(max(volts, -limit), limit)
        flow = K_L * opened * (1.0 + more_up if opened > 0.0 else 1.0 - more_up)
        for _ in range(STEPS):
            v += h * a
            a += h * (OMEGA_N**2 * (flow - v) - 2.0 * zeta * OMEGA_N * a)
            x += h * v
            seen += h * (x - seen) / lag if lag else 0.0
    return np.array(out).T


def triangle(n, hz, volts=2.0):
    at = (np.arange(n) / RATE * hz + 0.1) % 1.0
    return volts * (1.0 - 4.0 * np.abs(at - 0.5))


def broad_noise(n, volts=2.0):
    """Of a little less than the plant's own frequency."""
    kept = np.exp(-0.7 * OMEGA_N / RATE)
    x = lfilter([1.0 - kept], [1.0, -kept], np.random.default_rng(2).normal(0.0, 1.0, n))
    return volts * x / np.std(x)


def named(found):
    return {each.name: each for each in found.effects}


@pytest.mark.slow
def test_beside_a_plant_that_hardly_is_damped_one_that_is():
    """Slow commands and a valve with an end: Eq. 1 is nearest where it oscillates with a harmonic of them."""
    u = triangle(6000, 1.6)
    windows, _ = cut([series(recording(u, rig(u, limit=1.4)[1]), sees_speed=True)])
    fits = baseline(windows, sees_speed=True, effects={})
    assert fits.best.model.values(fits.best.x)["zeta"] < 0.02
    assert fits.damped.model.values(fits.damped.x)["zeta"] > 0.1
    u = broad_noise(6000)
    windows, _ = cut([series(recording(u, rig(u)[1]), sees_speed=True)])
    assert baseline(windows, sees_speed=True, effects={}).damped is None


@pytest.mark.slow
@pytest.mark.computes
def test_a_valve_with_an_end_is_found_under_slow_commands():
    u = triangle(12000, 1.6)
    found = diagnose([recording(u, rig(u, limit=1.4)[1], noise=4e-3)], (), Options(output="velocity"))
    effects = named(found)
    assert effects.keys() == {"valve_saturation"}
    assert effects["valve_saturation"].parameters["limit"].value == pytest.approx(1.4, rel=0.01)
    assert found.extended.omega_n == pytest.approx(OMEGA_N, rel=0.05)


@pytest.mark.slow
@pytest.mark.computes
def test_a_lag_beside_gains_that_throw_eq_1_off_has_its_share_of_what_is_left_without_them():
    u = broad_noise(12000)
    y, _ = rig(u, more_up=0.09, lag=4e-3)
    found = diagnose([recording(u, y + coloured(len(y), 1.5e-4 * np.std(y)), noise=0.0)], (), Options())
    effects = named(found)
    assert effects.keys() == {"asymmetric_gain", "sensor_lag"}
    assert effects["sensor_lag"].parameters["time"].value == pytest.approx(4e-3, rel=0.1)


def coloured(n, deviation, kept=0.7):
    white = np.random.default_rng(9).normal(0.0, deviation, n)
    return lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], white)


def test_what_effects_share_is_the_error_beside_an_offset(monkeypatch):
    class Held:
        floor = 0.01

        def __init__(self, nrmse):
            self.nrmse = nrmse

    errors = {"loaded": 0.1, "bent": 0.02}
    monkeypatch.setattr(Judged, "of", lambda one, _: Judged(one, Held(errors[one])))
    base, tried = (
        Judged(None, Held(1.2)),
        {frozenset({"load_bias"}): "loaded", frozenset({"backlash"}): "bent"},
    )
    assert final_choice._above_offset(base, tried, None) == pytest.approx(0.1**2 - 0.01**2)
    assert final_choice._above_offset(base, {}, None) == pytest.approx(1.0 - 0.01**2)
