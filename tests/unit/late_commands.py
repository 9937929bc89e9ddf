"""A plant whose commands run on between the rows of a recording.

It is stepped by the exponential of its matrix, sixteen times in each row, apart from `sim`.
"""

from pathlib import Path

import numpy as np
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose.record.series import series

K_L, OMEGA_N, ZETA, RATE = 20.0, 90.0, 0.2, 500.0
N, FINER = 6000, 16
T = np.arange(N) / RATE


def volts(t):
    """A multisine up to 20 Hz."""
    lines = np.arange(1, 41)
    return 0.2 * np.sin(2.0 * np.pi * 0.5 * t[:, None] * lines + lines**2).sum(axis=1)


def moved(stiff=0.0, at=volts):
    """Positions at the rows under commands that run on between them, with a spring beside the oil's.

    `at` gives the commands at times.
    """
    a = np.zeros((4, 4))  # position, speed, acceleration by the oil, command
    a[0, 1] = a[1, 2] = 1.0
    a[1, 0] = -stiff * OMEGA_N**2
    a[2, 1], a[2, 2], a[2, 3] = -(OMEGA_N**2), -2.0 * ZETA * OMEGA_N, K_L * OMEGA_N**2
    step = expm(a / (RATE * FINER))
    u = at((np.arange(N * FINER) + 0.5) / (RATE * FINER))
    state, y = np.zeros(4), np.empty(N)
    for k in range(N * FINER):
        if k % FINER == 0:
            y[k // FINER] = state[0]
        state[3] = u[k]
        state = step @ state
    return y + np.random.default_rng(1).normal(0.0, 0.002 * np.std(y), N)


def recorded(u, y=None, hold="zero"):
    y = np.cumsum(u) if y is None else y
    empty = Recording((Path("r.csv"),), T, u, y, None, None, None, np.arange(1, N + 1), {}, {}, ())
    return empty, series(empty, hold=hold)
