"""Kaya's A-function method: the limit cycle's exact conditions, solved for the plant.

Kaya and Atherton, Parameter estimation from relay autotuning with asymmetric limit cycle data, J. Process
Control 11, 2001, 429-439; Kaya, Parameter estimation for integrating processes using relay feedback control
under static load disturbances, Ind. Eng. Chem. Res. 45, 2006, 4726-4731; Atherton, Early developments in
nonlinear control, IEEE Control Systems Magazine 16, 1996.

Atherton's A locus is the sum of all harmonics of the plant's response to the relay's wave, so that the
conditions hold exactly: the position passes the thresholds when the relay says so, and its extremes are those
measured. From period, pulse width and extremes follow as many numbers as there are conditions. Position
levels are free here (the plant integrates), which leaves the difference of the thresholds, 2 eps, and the
difference of the extremes: two conditions for omega_n and zeta. K_L, the hysteresis and the dead time are
told. The authors assume measurements without error: the extremes are fitted here, the period and the pulse
width are means over the cycles.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import root

from league_rivals.base import Found, fitted_extremes
from league_rivals.describing import describing

if TYPE_CHECKING:
    from league_rivals.base import Array, Record, Told

HARMONICS = 60
"""Their sizes fall as the fourth power of their numbers: what is left out is below 1e-6 of the range."""
ANGLES = 256
"""Points of a period at which the extremes are looked for, before a parabola through three."""
STARTS = (0.0, -0.5, 0.5)
"""Of the search, in the logarithm of zeta, about what the describing function says."""


def a_function(record: Record, told: Told) -> Found | None:
    """The plant whose limit cycle has the period, pulse width and extremes measured."""
    pulse = float(np.mean(record.downs - record.ups[:-1]))
    high, low = fitted_extremes(record)
    conditions = _Conditions(record.period, pulse, float(np.mean(high) - np.mean(low)), told)
    first = describing(record, told)
    guess = np.log([first.omega_n, first.zeta] if first else [2.0 * math.pi / record.period, 0.5])
    for start in STARTS:
        found = root(conditions.missed, guess + np.array([0.0, start]), tol=1e-10)
        if found.success and np.all(np.abs(found.x - guess) < 3.0):
            return Found(*map(float, np.exp(found.x)))
    return None


class _Conditions:
    """What a plant's limit cycle misses."""

    def __init__(self, period: float, pulse: float, range_: float, told: Told) -> None:
        self.range, self.told = range_, told
        self.w = 2.0 * math.pi / period * np.arange(1, HARMONICS + 1)
        # the relay's wave: up at 0, down after the pulse
        self.wave = 2.0 * told.e_a * (1.0 - np.exp(-1j * self.w * pulse)) / (1j * self.w * period)
        at = np.array([pulse - told.lateness, -told.lateness])
        self.crossings = np.exp(1j * np.outer(at, self.w))

    def missed(self, x: Array) -> Array:
        """At the logarithms of omega_n and zeta: by the thresholds and by the extremes, over the range."""
        omega_n, zeta = np.exp(np.clip(x, -20.0, 20.0))
        s = 1j * self.w
        coefficients = self.wave * self.told.K_L / (s * ((s / omega_n) ** 2 + 2.0 * zeta * s / omega_n + 1.0))
        down, up = 2.0 * (self.crossings @ coefficients).real
        high, low = _extremes(2.0 * (_turns() @ coefficients).real)
        return np.array([down - up - 2.0 * self.told.hysteresis, high - low - self.range]) / self.range


@lru_cache
def _turns() -> Array:
    """exp(j n angle), shape (angles, harmonics)."""
    angles = 2.0 * math.pi * np.arange(ANGLES) / ANGLES
    return np.exp(1j * np.outer(angles, np.arange(1, HARMONICS + 1)))


def _extremes(y: Array) -> tuple[float, float]:
    high, low = (_vertex(y, int(k)) for k in (np.argmax(y), np.argmin(y)))
    return high, low


def _vertex(y: Array, k: int) -> float:
    a, b, c = y[k - 1], y[k], y[(k + 1) % len(y)]
    bend = a - 2.0 * b + c
    return float(b - 0.125 * (c - a) ** 2 / bend) if bend else float(b)
