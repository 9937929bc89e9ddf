"""Exact steps by a matrix, for plants with a second inertia, a spring or a sensor's lag.

Oil, load and sensor are dz/dt = A z + c then, as those of `sim.exact` are, but with three states more and no
closed form worth writing out. After a step z has grown by M (A z + c), where M is the integral of exp(A t)
over its length. M depends on plant and length alone: the state keeps that of the last few lengths, since rows
come in step. Where they do not, steps are integrated (`sim.kernel`).
"""

from __future__ import annotations

import math

import numpy as np

from sim import exact, physics
from sim.compiled import Record, compiled, inlined

Array = np.ndarray

STATES = 6
"""Pressure [unit/s^2], velocity [unit/s], position [unit], those two of the second inertia, and what is
behind the sensor's lag [unit, or unit/s]."""

KEPT = 4
"""Lengths of which a matrix is kept: of two kinds of rows, each cut in two by a delay. Chosen."""

SAME = 1e-9
"""Part by which two steps may differ in length and have the same matrix: a recording's rows, cut in pieces,
differ by the rounding of their times."""

COST = 0.4
"""Of a step, over a Runge-Kutta step. Measured: 32 ns in place of 77."""

WORTH = 60.0
"""Steps by a matrix that save what it took to have it. Measured: 2.6 us, and 45 ns each."""

TERMS = 14
"""Of the power series of a matrix, over a quarter of a substep: the next is less than a double's rounding."""


@inlined
def step(p: Record, s: Record, z: tuple[float, ...], opened: float, k: int) -> tuple[float, ...]:
    """The state after `z`, by the `k`-th matrix that is kept; no event is within.

    Args:
        p: Parameters.
        s: State at the beginning.
        z: As `physics.rates` takes it, in its order and units.
        opened: Opening, in volts of an ideal symmetric valve.
        k: From `kept`.
    """
    a, v, x, v2, x2, bristle, lagged = z
    d = _rates(p, s, z, opened)
    return (
        a + _row(s, k, 0, d),
        v + _row(s, k, 1, d),
        x + _row(s, k, 2, d),
        v2 + _row(s, k, 3, d),
        x2 + _row(s, k, 4, d),
        bristle,
        lagged + _row(s, k, 5, d),
    )


@inlined
def _rates(p: Record, s: Record, z: tuple[float, ...], opened: float) -> tuple[float, ...]:
    """What `physics.rates` are of such a plant, in the matrix's order: half the time."""
    a, v, x, v2, x2, _, lagged = z
    leaks, rubs, _ = exact.damped(p)
    pressure = p.omega_n * p.omega_n * (p.K_L * opened - v) - leaks * a
    push = physics.steady_drive(p, s, s.t, a, x) - s.motion * physics.friction_level(p, v) - rubs * v
    ratio, coupled, goes = p.load_resonance_inertia, push, v
    if ratio > 0.0:
        coupled, goes = physics.coupling(p, v, x, v2, x2), v2
        push = (1.0 + ratio) * push - ratio * coupled
    follows = 0.0
    if p.sensor_lag_time > 0.0:
        follows = ((v if p.measures_speed != 0.0 else x) - lagged) / p.sensor_lag_time
    return pressure, push, v, coupled, goes, follows


@inlined
def _row(s: Record, k: int, i: int, d: tuple[float, ...]) -> float:
    m = s.matrices
    grows: float = m[k, i, 0] * d[0] + m[k, i, 1] * d[1] + m[k, i, 2] * d[2]
    grows += m[k, i, 3] * d[3] + m[k, i, 4] * d[4] + m[k, i, 5] * d[5]
    return grows


@inlined
def kept(p: Record, s: Record, h: float) -> int:
    """Which matrix is that of a step of `h` [s]; -1: there is none, and it is not worth while."""
    if s.matrices_of == p.by_matrix:
        for k in range(KEPT):
            if abs(h - s.lengths[k]) <= SAME * h:
                s.owed -= 1.0
                return k
    return _another(p, s, h)


@compiled
def _another(p: Record, s: Record, h: float) -> int:
    """Have one more, in place of the oldest, where the last ones have been worth while; else -1."""
    if s.matrices_of != p.by_matrix:
        s.matrices_of, s.owed = p.by_matrix, 0.0
        s.lengths[:] = 0.0
    if s.owed > (KEPT - 1.0) * WORTH:
        return -1
    k = int(s.oldest)
    s.oldest = (s.oldest + 1.0) % KEPT
    s.lengths[k] = h
    s.owed = max(s.owed, 0.0) + WORTH
    _integral(p, h, s.matrices[k])
    return k


@compiled
def _integral(p: Record, h: float, m: Array) -> None:
    """Have `m` be the integral of exp(A t) to `h` [s], shape (6, 6): a series over a part of it, doubled."""
    doublings = max(0, math.ceil(math.log2(4.0 * h / p.substep)))
    part = h / 2.0**doublings
    A, term = np.zeros((STATES, STATES)), part * np.eye(STATES)
    _coefficients(p, A)
    m[:] = term
    for n in range(2, TERMS + 1):
        term = _product(A, term, part / n)
        m += term
    for _ in range(doublings):  # M(2 h) = 2 M + M A M
        m += m + _product(m, _product(A, m, 1.0), 1.0)


@compiled
def _product(a: Array, b: Array, factor: float) -> Array:
    """Of two matrices, times `factor`; too small for a library."""
    out = np.zeros((STATES, STATES))
    for i in range(STATES):
        for k in range(STATES):
            for j in range(STATES):
                out[i, j] += factor * a[i, k] * b[k, j]
    return out


@compiled
def _coefficients(p: Record, A: Array) -> None:
    """Fill `A`, shape (6, 6), zeros until now: what `physics.rates` are by each state, in motion."""
    leaks, rubs, _ = exact.damped(p)
    ratio, omega = p.load_resonance_inertia, p.load_resonance_omega
    A[0, 0], A[0, 1] = -leaks, -p.omega_n * p.omega_n
    A[1, 0], A[1, 1], A[1, 2] = 1.0 + ratio, -(1.0 + ratio) * rubs, -(1.0 + ratio) * p.load_spring_stiffness
    A[2, 1] = 1.0
    if ratio > 0.0:
        springs, damps = omega * omega, 2.0 * p.load_resonance_zeta * omega
        A[3, 1], A[3, 2], A[3, 3], A[3, 4] = damps, springs, -damps, -springs
        A[4, 3] = 1.0
        for j in range(1, 5):
            A[1, j] -= ratio * A[3, j]
    else:  # the second inertia goes with the first
        A[3, :] = A[1, :]
        A[4, 1] = 1.0
    if p.sensor_lag_time > 0.0:
        A[5, 1 if p.measures_speed != 0.0 else 2] = 1.0 / p.sensor_lag_time
        A[5, 5] = -1.0 / p.sensor_lag_time
