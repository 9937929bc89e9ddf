"""A load that something pulls back: its plant in closed form, and what is found from there."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose_truth import RATE, recording
from scipy.signal import cont2discrete

from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import Cut, cut
from seod.diagnose.starts.pulled_back import pulled_back

N = 8000
K_L, OMEGA_N, ZETA, CENTRE = 0.02, 80.0, 0.2, 0.01


def steps(seed=1):
    """Of random size, 50 to 400 rows long [V]."""
    random = np.random.default_rng(seed)
    lengths = random.integers(50, 400, N)
    return np.repeat(random.uniform(-5.0, 5.0, N), lengths)[:N]


def held(u, stiffness):
    """Position and speed of Eq. 1 against a spring, by its exact discrete form; u holds between rows."""
    oil = OMEGA_N**2
    A = np.array(
        [
            [0.0, 1.0, 0.0],
            [-stiffness, 0.0, 1.0],
            [0.0, -oil, -2.0 * ZETA * OMEGA_N],
        ]
    )
    B = np.array([[0.0], [0.0], [oil * K_L]])
    A, B, *_ = cont2discrete((A, B, np.eye(3), np.zeros((3, 1))), 1.0 / RATE)
    x, out = np.zeros(3), []
    for volts in u:
        out.append(x)
        x = A @ x + B[:, 0] * volts
    position, speed, _ = np.array(out).T
    return position + CENTRE, speed


@pytest.mark.parametrize("part", [0.3, 2.0, 6.0])
@pytest.mark.parametrize("sees_speed", [False, True])
def test_the_plant_is_that_of_the_exact_discrete_form(part, sees_speed):
    u = steps()
    y = held(u, part * OMEGA_N**2)[sees_speed]
    windows, _ = cut([series(recording(u, y, noise=0.01), sees_speed=sees_speed)])
    told = [
        (one.omega_n / OMEGA_N, one.zeta / ZETA, one.K_L / K_L, one.stiffness / OMEGA_N**2 / part)
        for one in pulled_back(windows)
    ]
    assert min(np.max(np.abs(np.log(one))) for one in told) < 0.1
    if not sees_speed:
        assert min(abs(one.centre - CENTRE) for one in pulled_back(windows)) < 1e-4


def test_constants_tell_no_plant():
    one = series(recording(steps(), np.linspace(0.0, 1e-3, N), noise=0.0))
    assert pulled_back(Cut((one,), ((0, 0, 6),))) == []


@pytest.mark.slow
@pytest.mark.computes
def test_against_a_stiff_specimen_a_deadband_is_found():
    """Eq. 1 alone runs away: nothing had been named, with errors of the movement's size and more."""
    u = steps()
    y, _ = held(np.sign(u) * np.maximum(np.abs(u) - 0.6, 0.0), 2.0 * OMEGA_N**2)
    found = diagnose([recording(u, y, noise=0.01)], (), Options(effort="quick"))
    assert {each.name for each in found.effects} == {"load_spring", "valve_deadband"}
    assert found.effects[0].parameters["stiffness"].value == pytest.approx(2.0 * OMEGA_N**2, rel=0.02)
    assert (found.extended.omega_n, found.extended.zeta) == pytest.approx((OMEGA_N, ZETA), rel=0.02)
    assert found.extended.holdout_nrmse < 0.015
