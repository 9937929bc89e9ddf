"""`wave` while the rig changes: supply pressure with its gain, speed, plant."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from relay_truth import E_A, K_L, PLANTS, TICK, amplitude_of, settings
from scipy.linalg import expm

from seod.estimate import make_estimator
from seod.estimate.base import Estimate, Row
from seod.estimate.wave.answer import DRIFTS, Answer
from seod.estimate.wave.gain_course import under_one_gain

pytestmark = pytest.mark.slow

ZETA, OMEGA_N = PLANTS[1]
PARTS = 5


def always(value):
    return lambda _: value


def gain_by_pressure(t):
    """Eq. 9's kind of polynomial, the supply going from 5 to 10 MPa in two seconds."""
    ps = 5.0 + 2.5 * t
    return 6.2 + 2.4 * ps - 0.08 * ps**2


def changing(gain=None, speed=None, omega_n=None, noise=0.003, seconds=1.0, zeta=ZETA) -> list[Row]:
    """A relay about the set point, or about a `speed` [rad/s] by Fig. 6b; all are functions of time."""
    gain, omega_n, rng = gain or always(K_L), omega_n or always(OMEGA_N), np.random.default_rng(5)
    scale = amplitude_of(zeta, OMEGA_N)
    sigma = noise * scale * (OMEGA_N if speed else 1.0)
    state, signal, before, sign, acts, feed = np.zeros(3), 0.0, None, 1.0, 0.0, []
    state[1] = speed(0.0) if speed else 0.0
    for k in range(int(seconds / TICK)):
        t = k * TICK
        if k % 10 == 0:
            moves = step_of(zeta, omega_n(t))
        measured = state[1 if speed else 0] + sigma * rng.standard_normal()
        if speed:
            error = speed(t) - measured
            signal += 0.5 * (error + before) * TICK if before is not None else 0.0
            before = error
        else:
            signal = -measured
        sign = 1.0 if signal > 0.02 * scale else -1.0 if signal < -0.02 * scale else sign
        bias = speed(t) / gain(t) if speed else 0.0
        u = bias + sign * E_A
        about = 0.0, E_A, bias
        feed.append(Row(t, -signal, u, t + TICK, *about, exciting=True, K_L=gain(t), speed=measured))
        for part in range(PARTS):
            state = moves[:, :3] @ state + moves[:, 3] * gain(t + (part + 0.5) * TICK / PARTS) * acts
        acts = u
    return feed


def step_of(zeta, omega_n):
    a = np.zeros((4, 4))
    a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(omega_n**2), -2 * zeta * omega_n, omega_n**2]]
    return expm(a * TICK / PARTS)[:3]


def answers(feed: list[Row], **known) -> list[Estimate]:
    estimator = make_estimator(settings("wave", **known))
    return [a for row in feed if (a := estimator.update(row)) and a.t > 0.35]


def assert_followed(found: list[Estimate], omega_n=None, zeta=None) -> None:
    """All are good, and say what was true in the middle of their windows, as surely as they claim."""
    assert len(found) > 15
    assert {a.quality for a in found} == {"ok"}
    for name, truth in (("omega_n", omega_n or always(OMEGA_N)), ("zeta", zeta or always(ZETA))):
        z = [(getattr(a, name) - truth(a.t - a.lag_s)) / getattr(a, f"{name}_sd") for a in found]
        assert np.max(np.abs(z)) < 4.5
        assert math.sqrt(np.mean(np.square(z))) < 2.0


def test_the_gain_follows_a_supply_pressure_that_keeps_changing():
    found = answers(changing(gain=gain_by_pressure))
    assert_followed(found)
    for a in found:
        assert pytest.approx(gain_by_pressure(a.t - a.lag_s), rel=2e-3) == a.K_L
    assert found[-1].K_L > 1.1 * found[0].K_L


def test_a_speed_that_keeps_changing_is_no_other_plant():
    still, moving = (
        answers(changing(speed=speed), integrated=True) for speed in (always(32.5), lambda t: 20.0 + 60.0 * t)
    )
    assert_followed(still)
    assert_followed(moving)
    assert moving[-1].lag_s == pytest.approx(still[-1].lag_s, rel=0.1)
    assert moving[-1].mean_speed == pytest.approx(20.0 + 60.0 * (moving[-1].t - 0.02), rel=0.05)
    assert moving[-1].amplitude == pytest.approx(still[-1].amplitude, rel=0.03)


def test_a_plant_that_changes_with_speed_is_followed_in_velocity_mode():
    def omega_n(t):
        return OMEGA_N * (1.0 + 0.1 * t)

    assert_followed(
        answers(changing(speed=lambda t: 20.0 + 30.0 * t, omega_n=omega_n), integrated=True), omega_n
    )


def test_a_drift_shortens_the_window_and_lag_s_says_what_it_lags():
    def omega_n(t):
        return OMEGA_N * (1.0 + 0.25 * t)

    steady, drifting = answers(changing()), answers(changing(omega_n=omega_n))
    assert_followed(drifting, omega_n)
    assert np.mean([a.lag_s for a in drifting]) < 0.7 * np.mean([a.lag_s for a in steady])
    behind = np.mean([omega_n(a.t) - a.omega_n for a in drifting])
    assert behind == pytest.approx(0.25 * OMEGA_N * np.mean([a.lag_s for a in drifting]), rel=0.15)


def test_a_window_in_which_the_plant_may_drift_is_less_sure():
    estimator = make_estimator(settings("wave"))
    for row in changing(seconds=0.4):
        estimator.update(row)
    answer = estimator._newest
    fits = (replace(answer.fit, changed=c * DRIFTS * answer.widened**2) for c in (0.9, 2.0))
    sure, doubtful = (Answer.of(answer.window, each, estimator._period()) for each in fits)
    assert sure.widened == answer.widened
    assert sure.sd("zeta") == pytest.approx(answer.widened * answer.fit.sd("zeta"))
    assert doubtful.sd("zeta") == pytest.approx(math.sqrt(2.0) * sure.sd("zeta"))


class TestGainCourse:
    t_u = np.array([0.0, 0.1, 0.2, 0.3])
    u = np.array([1.0, -1.0, 1.0, -1.0])

    def test_one_gain_changes_nothing(self):
        t_u, u, K_L = under_one_gain(self.t_u, self.u, np.full(4, 17.0), 0.15)
        assert (t_u is self.t_u, u is self.u, K_L) == (True, True, 17.0)

    def test_voltages_carry_what_the_gain_does(self):
        t_u, u, K_L = under_one_gain(self.t_u, self.u, 10.0 + 10.0 * self.t_u, 0.2)
        assert pytest.approx(12.0) == K_L
        assert set(self.t_u) <= set(t_u)
        travelled = float(np.sum(np.diff(t_u) * u[:-1]) * K_L)
        assert travelled == pytest.approx(0.1 * (10.5 - 11.5 + 12.5), rel=1e-6)
