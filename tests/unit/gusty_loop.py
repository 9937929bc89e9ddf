"""A plant of Eq. 1 under random forces on its load, in a loop or none.

It is stepped by the exponential of its matrix, apart from `sim`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import expm

from seod.data import Recording
from seod.diagnose.causes.scales import Scales
from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut, fitted_windows

TRUTH = {"K_L": 20.0, "omega_n": 100.0, "zeta": 0.5}
DAMPED = {**TRUTH, "zeta": 0.8}
RATE, N = 1000.0, 12000
T = np.arange(N) / RATE
GUSTS = 60.0


def stepped(command, seed=1, truth=TRUTH, gusts=GUSTS, spring=0.0):
    """Readings and commands of Eq. 1 as a position, under random forces; `command(y, k)` gives the volts."""
    K_L, omega_n, zeta = truth.values()
    a = np.zeros((5, 5))  # position, speed, acceleration by the oil, command, force
    a[0, 1] = a[1, 2] = 1.0
    a[1, 0] = -spring
    a[1, 4] = 1.0
    a[2, 1], a[2, 2], a[2, 3] = -(omega_n**2), -2.0 * zeta * omega_n, K_L * omega_n**2
    step = expm(a / RATE)
    random = np.random.default_rng(seed)
    state, keep = np.zeros(5), np.exp(-omega_n / RATE)
    y, u = np.empty(N), np.empty(N)
    for k in range(N):
        y[k] = state[0] + 1e-3 * random.normal()
        u[k] = state[3] = command(y[k], k)
        state[4] = keep * state[4] + gusts * np.sqrt(1.0 - keep**2) * random.normal()
        state = step @ state
    return y, u


def relay():
    last = [1.0]

    def command(y, _):
        last[0] = -1.0 if y > 0.02 else 1.0 if y < -0.02 else last[0]
        return last[0]

    return command


def multisine(_, k):
    lines = np.arange(1, 16)
    return 0.4 * float(np.sum(np.sin(2.0 * np.pi * lines * T[k] + lines**2)))


def servo(y, k):
    return 4.0 * (0.5 * np.sin(2.0 * np.pi * 0.7 * T[k]) - y)


def recorded(y, u):
    rows = np.arange(1, N + 1)
    return Recording((Path("loop.csv"),), T, u, y, None, None, None, rows, {}, {}, ())


def by_simulation(y, u):
    """Eq. 1 fitted by its simulation, and both halves of the windows."""
    halves = cut([series(recorded(y, u))])
    to_fit = fitted_windows(halves[0])
    size = float(np.std(y))
    sizes = Scales(1.0, 100.0 * size, 1e4 * size, 0.0, size, size, 100.0, 12.0, 1.0 / RATE)
    model = baseline_model(sizes, 1.0, False, {})
    x = model.searched({"K_L": 18.0, "omega_n": 90.0, "zeta": 0.4})
    return fit(model, to_fit, x, simulated_states(model, x, to_fit), 40, enough=1e-7), halves


def off(fitted, truth=TRUTH):
    """Logarithms of what was found over the truth."""
    values = fitted.model.values(fitted.x)
    return np.array([np.log(values[name] / true) for name, true in truth.items()])
