"""Commands, noise and a drag, integrated here, and what is left of windows: for tests of what is left."""

import numpy as np
from diagnose_truth import RATE, linear, recording
from scipy.signal import lfilter

from seod.diagnose.account.residual import WindowResidual
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.starts.baseline import _rough

K_L, OMEGA_N, ZETA = 17.0, 60.0, 0.4
PERIOD = 1000
"""Of the multisine [samples]."""
N = 8 * PERIOD


def multisine(seed=1):
    t, random = np.arange(N) / RATE, np.random.default_rng(seed)
    lines = np.arange(1, 40) * RATE / PERIOD
    u = np.cos(2.0 * np.pi * np.outer(t, lines) + random.uniform(0.0, 6.3, len(lines))).sum(axis=1)
    return u / np.max(np.abs(u))


def noise_command(seed=2):
    u = lfilter([1.0], [1.0, -0.97], np.random.default_rng(seed).normal(size=N))
    return u / np.max(np.abs(u))


def coloured(memory, sd, seed=3):
    white = np.random.default_rng(seed).normal(size=N + 3000)
    return sd * np.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], white)[3000:]


def by_heun(slope, u):
    """States from rest, shape (3, n), by Heun's method, four steps to a row; `slope` of state and volts."""
    h, w = 1.0 / RATE / 4.0, np.zeros(3)
    out = np.empty((len(u), 3))
    for k, volts in enumerate(u):
        out[k] = w
        for _ in range(4):
            first = slope(w, volts)
            w = w + 0.5 * h * (first + slope(w + h * first, volts))
    return out.T


def moved(u, drag=0.0):
    """Pressure, velocity and position of Eq. 1 with a force against the square of speed."""

    def slope(w, volts):
        p, v, _ = w
        brakes = drag * v * abs(v)
        return np.array([OMEGA_N**2 * (K_L * volts - v) - 2.0 * ZETA * OMEGA_N * p, p - brakes, v])

    return by_heun(slope, u)


def parts_of(u, error, states, count=8):
    """Windows of what is left; every other one is held out, the first fifth is not scored."""
    t, n = np.arange(N) / RATE, N // count
    scored = np.arange(n) >= n // 5
    return [
        WindowResidual(
            0, t[a : a + n], u[a : a + n], error[a : a + n], scored, *states[:, a : a + n], bool(k % 2)
        )
        for k, a in enumerate(range(0, N, n))
    ]


def fitted_lag():
    """A fit of a plant whose valve lags, by its true numbers; the lag's standard deviation is [s]."""
    u = multisine()
    to_fit, _ = cut([series(recording(u, linear(u, lag=0.004), noise=0.001))])
    model = baseline_model(_rough(to_fit, 117.0), 1.0, False, {}).with_effect("valve_lag")
    x = model.searched({"K_L": 17.0, "omega_n": 117.0, "zeta": 0.3, "valve_lag.time": 0.004})
    return fit(model, to_fit, x, simulated_states(model, x, to_fit))
