"""The asymmetric relay of Berner, Hagglund and Astrom, and the fit of the whole response to it.

Berner, Hagglund and Astrom, Asymmetric relay autotuning: practical features for industrial use, Control
Engineering Practice 54, 2016, 231-245; Berner and Soltesz, Short and robust experiments in relay autotuners,
ETFA 2017; Soltesz, Hagglund and Astrom, Transfer function parameter identification by modified relay
feedback, ACC 2010.

The equations of the first give a first-order model with dead time, or gain and dead time of an integrator:
neither has a zeta. For second order with dead time the authors minimise the squared output error over the
record, with initial states as unknowns that begin anywhere. So it is done here: omega_n, zeta and dead time
are searched for, the gain, the initial state and what balances the load (the authors' u_0) are linear.
Nothing is told.

- `asymmetric`: the authors' form.
- `asymmetric_told`: the same with K_L and the delay told, as the other methods have them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from league_rivals.base import Found
from league_rivals.integrals import fourier

if TYPE_CHECKING:
    from league_rivals.base import Array, Record, Told

SAME = 1e-4
"""Poles nearer than this part of omega_n are drawn apart: the formulas divide by their distance."""
LONGEST = 3.0
"""Farthest that the dead time may be from the one told, in parts of 1 / omega."""


def asymmetric(record: Record, told: Told) -> Found | None:
    """Nothing is told; `told` is only where the search begins."""
    return _fit(record, told, free=True)


def asymmetric_told(record: Record, told: Told) -> Found | None:
    """K_L and the delay are told."""
    return _fit(record, told, free=False)


def _fit(record: Record, told: Told, *, free: bool) -> Found | None:
    fit = _OutputError(record, None if free else told.K_L)
    w = 2.0 * math.pi / record.period
    begin = fourier(record, told) or Found(w, 0.5)
    start = np.array([math.log(begin.omega_n), math.log(begin.zeta), 0.0])[: 3 if free else 2]
    wide = np.array([2.0, 4.0, LONGEST])[: len(start)]
    found = least_squares(
        fit.residual,
        start,
        bounds=(start - wide, start + wide),
        x_scale=np.array([0.1, 0.1, 0.1])[: len(start)],
    )
    if not found.success:
        return None
    omega_n, zeta = np.exp(found.x[:2])
    return Found(float(omega_n), float(zeta), float(fit.gain(found.x)) if free else None)


class _OutputError:
    """Of the cycles' samples, over the unknowns log(omega_n), log(zeta) and w times the dead time."""

    def __init__(self, record: Record, K_L: float | None) -> None:
        inside = (record.t >= record.ups[0]) & (record.t < record.ups[-1])
        self.t, self.y, self.K_L = record.t[inside], record.y[inside], K_L
        self.w = 2.0 * math.pi / record.period
        changes = np.flatnonzero(np.diff(record.u)) + 1
        self.times, self.steps = record.t_u[changes], np.diff(record.u)[changes - 1]
        before = self.times < self.t[0] - 2.0 * record.period  # long before: in the initial state
        self.base = float(record.u[0] + np.sum(self.steps[before]))
        self.times, self.steps = self.times[~before], self.steps[~before]

    def residual(self, x: Array) -> Array:
        """Measured less simulated, shape (n,)."""
        forced, free = self._columns(x)
        if self.K_L is not None:
            rest = self.y - self.K_L * forced
            return rest - free @ np.linalg.lstsq(free, rest, rcond=None)[0]
        columns = np.column_stack([forced, free])
        return self.y - columns @ np.linalg.lstsq(columns, self.y, rcond=None)[0]

    def gain(self, x: Array) -> float:
        """K_L there [unit/s/V]."""
        columns = np.column_stack(self._columns(x))
        return float(np.linalg.lstsq(columns, self.y, rcond=None)[0][0])

    def _columns(self, x: Array) -> tuple[Array, Array]:
        """The response to the voltages for each unit of gain, and what initial state and load can add."""
        omega_n, zeta = np.exp(x[:2])
        late = x[2] / self.w if len(x) > 2 else 0.0
        slow, fast = _poles(float(omega_n), float(zeta))
        since = self.t[:, None] - self.times - late
        forced = (_step(since, slow, fast) * self.steps).sum(axis=1)
        t = self.t - self.t[0]
        one = np.exp(slow * t)
        other = (np.exp(fast * t) - one) / (fast - slow)
        modes = (one.real, other.real) if slow.imag == 0.0 else (one.real, one.imag)
        forced += self.base * t  # whatever of it is no ramp is in the modes
        return forced, np.column_stack([np.ones_like(t), t * self.w, *modes])


def _poles(omega_n: float, zeta: float) -> tuple[complex, complex]:
    apart = np.sqrt(complex(zeta**2 - 1.0))
    if abs(apart) < SAME:
        apart = complex(SAME, 0.0)
    return omega_n * (-zeta + apart), omega_n * (-zeta - apart)


def _step(t: Array, slow: complex, fast: complex) -> Array:
    """Position after a unit step of voltage at 0, of unit gain; 0 before."""
    late = np.maximum(t, 0.0)
    a, b = fast / (fast - slow), slow / (slow - fast)  # speed: 1 - a exp(slow t) - b exp(fast t)
    moved = late - a * np.expm1(slow * late) / slow - b * np.expm1(fast * late) / fast
    return np.asarray(moved.real)
