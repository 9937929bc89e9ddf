"""What the best plant of Eq. 1 leaves of a record: how visible a hidden effect is.

Windows of ten dominant periods, at least 1 s, each with a state of its own; K_L, omega_n, zeta and, if
wanted, a constant bias are common. Linear filters and projections, nothing of `seod`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

THIN = 4
"""Every so many samples count: what is to be seen lasts longer."""


@dataclass(frozen=True)
class Baseline:
    K_L: float
    omega_n: float
    zeta: float
    rms: float


def dominant_period(y, tick) -> float:
    """Of the strongest line of the record's slope [s]."""
    spectrum = np.abs(np.fft.rfft(np.diff(y) * np.hanning(len(y) - 1)))
    strongest = max(int(np.argmax(spectrum[1:])) + 1, 1)
    return len(y) * tick / strongest


def window_length(y, tick) -> int:
    wanted = max(10.0 * dominant_period(y, tick), 1.0)
    return int(min(round(wanted / tick), len(y) // 4))


def poles_of(omega_n, zeta):
    zeta = zeta if abs(zeta - 1.0) > 1e-6 else 1.0 + 1e-6
    return -omega_n * (zeta + np.array([1.0, -1.0]) * np.emath.sqrt(zeta * zeta - 1.0))


def discrete(omega_n, zeta, tick, sees_speed):
    """Numerator for a held input, denominator; of gain 1, from the step's answer at the first ticks."""
    a, b = poles_of(omega_n, zeta)
    t = np.arange(4) * tick
    step = (1.0 + (b * np.exp(a * t) - a * np.exp(b * t)) / (a - b)).real
    roots = [np.exp(a * tick), np.exp(b * tick)]
    if not sees_speed:
        rest = (b / a * np.expm1(a * t) - a / b * np.expm1(b * t)) / (a - b)
        step, roots = (t + rest).real, [*roots, 1.0]
    den = np.poly(roots).real
    return np.convolve(den, np.diff(step, prepend=0.0))[: len(den)], den


def free_modes(omega_n, zeta, count, tick, sees_speed):
    t = np.arange(count) * tick
    poles = poles_of(omega_n, zeta)
    if zeta < 1.0:
        wave = np.exp(poles[0] * t)
        modes = [wave.real, wave.imag]
    else:
        modes = [np.exp(pole.real * t) for pole in poles]
    return np.linalg.qr(np.column_stack(modes if sees_speed else [*modes, np.ones(count)]))[0]


class Windows:
    def __init__(self, y, u, tick, *, sees_speed, bias):
        self.tick, self.sees_speed, self.u = tick, sees_speed, u
        self.size = window_length(y, tick)
        self.count = len(y) // self.size
        self.y = self.cut(y)
        self.inputs = [u, np.ones_like(u)] if bias else [u]

    def cut(self, x):
        rows = x[: self.count * self.size].reshape(self.count, self.size)
        return rows[:, ::THIN]

    def fit(self, theta):
        """Gain and bias, and the residual of all windows."""
        omega_n, zeta = np.exp(theta)
        num, den = discrete(omega_n, zeta, self.tick, self.sees_speed)
        modes = free_modes(omega_n, zeta, self.y.shape[1], THIN * self.tick, self.sees_speed)

        def freed(x):
            return (x - (x @ modes) @ modes.T).ravel()

        columns = np.column_stack([freed(self.cut(lfilter(num, den, each))) for each in self.inputs])
        target = freed(self.y)
        gains = np.linalg.solve(columns.T @ columns, columns.T @ target)
        return gains, target - columns @ gains


def best_baseline(y, u, tick, start, *, sees_speed=False, bias=True) -> Baseline:
    """Refit of Eq. 1 from `start` (K_L, omega_n, zeta) and a place beside it."""
    windows = Windows(y, u, tick, sees_speed=sees_speed, bias=bias)
    scale = float(np.std(windows.y)) or 1.0
    best = None
    for omega, zeta in ((1.0, 1.0), (0.8, 3.0)):
        theta = np.log([start[1] * omega, start[2] * zeta])
        answer = least_squares(
            lambda x: windows.fit(np.clip(x, -5.0, 8.0))[1] / scale, theta, x_scale=0.1, max_nfev=12
        )
        if best is None or answer.cost < best.cost:
            best = answer
    gains, residual = windows.fit(best.x)
    omega_n, zeta = (math.exp(x) for x in best.x)
    return Baseline(float(gains[0]), omega_n, zeta, float(np.sqrt(np.mean(residual**2))))
