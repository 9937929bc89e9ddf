"""A file whose y follows u itself, taken for a position: `identify` says what would be nearer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

import seod

TICK, N, FINE = 0.01, 1500, 10
K_L, OMEGA_N, ZETA = 2.0, 30.0, 0.4


def recorded(*, speed):
    """Steps of random size through Eq. 1, by scipy at a tenth of the interval."""
    random = np.random.default_rng(1)
    u = np.repeat(random.uniform(-1.0, 1.0, N // 25), 25)
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N]])
    B, C = np.array([[0.0], [0.0], [K_L * OMEGA_N**2]]), np.array([[1.0, 0.0, 0.0]])
    if speed:
        A, B, C = A[1:, 1:], B[1:], C[:, :2]
    fine = np.arange(N * FINE) * TICK / FINE
    y = lsim(StateSpace(A, B, C, np.zeros((1, 1))), np.repeat(u, FINE), fine, interp=False)[1][::FINE]
    return {"t": np.arange(N) * TICK, "u": u, "y": y + 0.01 * np.std(y) * random.normal(size=N)}


def hints(**how):
    return [each for each in seod.identify(**how).result.cannot_tell if "--output velocity" in each]


def test_what_is_nearer_to_a_speed_is_told():
    (said,) = hints(**recorded(speed=True))
    left = float(said.split(" %")[0].split()[-1])
    assert left == pytest.approx(1.0, abs=0.2)


def test_who_tells_what_y_is_is_not_told_otherwise():
    assert hints(**recorded(speed=True), output="position") == []
    assert hints(**recorded(speed=True), output="velocity") == []


def test_a_position_is_none():
    assert hints(**recorded(speed=False)) == []
