"""What a user would write for zeta and omega_n: recursive least squares and an extended Kalman filter.

Both know what `wave` knows: the tick, whole ticks of delay; the filter also K_L and the noise. They are the
textbooks' (Ljung, System Identification, 1999, ch. 11; Gelb, Applied Optimal Estimation, 1974, ch. 6), with
the prefilter and the first guesses that a careful user takes.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from scipy.signal import butter, lfilter

Array = np.ndarray

PASSED = 3.0
"""Corner of the prefilter over the limit cycle's frequency."""
GUESS = (0.2, 0.5)
"""Relative standard deviations of what the filter guesses of omega_n and zeta at first."""
BIAS = 0.1
"""The same of the load's bias, as a part of e_a."""

Answer = tuple[float, float, float, float]
"""omega_n [rad/s], its standard deviation, zeta, its standard deviation."""


def least_squares(y: Array, u: Array, tick: float, delay: int, omega: float) -> Answer | None:
    """Recursive least squares of the sampled transfer function from voltage to the position's increments.

    Args:
        y: Positions, shape (n,).
        u: Voltages computed from them, shape (n,).
        tick: [s].
        delay: Ticks until a voltage leaves.
        omega: Frequency of the limit cycle [rad/s], for the prefilter, which both signals pass.

    Returns:
        The plant that has the poles found; None where no such plant has.
    """
    corner = min(PASSED * omega * tick / math.pi, 0.9)
    b, a = butter(2, corner)
    moves, volts = lfilter(b, a, np.diff(y)), lfilter(b, a, np.concatenate([np.zeros(delay), u])[: len(u)])
    theta, covariance, variance = _least_squares(moves / np.std(moves), volts / np.std(volts))
    found = _poles(theta, tick)
    if found is None:
        return None
    moved = [_poles(theta + step, tick) for step in 1e-7 * np.eye(5)]
    slopes = np.stack([np.zeros(2) if x is None else (x - found) / 1e-7 for x in moved])
    sd = np.sqrt(np.maximum(np.diag(slopes.T @ covariance @ slopes) * variance, 0.0))
    return float(found[0]), float(sd[0]), float(found[1]), float(sd[1])


def _least_squares(moves: Array, volts: Array) -> tuple[Array, Array, float]:
    theta, p, squares = np.zeros(5), np.eye(5) * 1e10, 0.0
    for k in range(3, len(moves)):
        x = np.array([moves[k - 1], moves[k - 2], volts[k], volts[k - 1], volts[k - 2]])
        gain = p @ x / (1.0 + x @ p @ x)
        wrong = moves[k] - x @ theta
        squares += wrong * (moves[k] - x @ (theta + gain * wrong))
        theta = theta + gain * wrong
        p = p - gain[:, None] * (x @ p)
    return theta, p, squares / max(len(moves) - 8, 1)


def _poles(theta: Array, tick: float) -> Array | None:
    """omega_n and zeta of a sampled plant's denominator 1 - theta[0] / z - theta[1] / z^2."""
    root = cmath.sqrt(theta[0] ** 2 + 4.0 * theta[1])
    poles = [0.5 * (theta[0] + root), 0.5 * (theta[0] - root)]
    if min(abs(z) for z in poles) < 1e-9:
        return None
    first, second = (cmath.log(z) / tick for z in poles)
    square, twice = (first * second).real, -(first + second).real
    return np.array([math.sqrt(square), 0.5 * twice / math.sqrt(square)]) if square > 0.0 else None


def kalman(
    y: Array, u: Array, tick: float, delay: int, K_L: float, sigma: float, guess: tuple[float, float]
) -> Answer:
    """Extended Kalman filter: position, speed, acceleration, load bias, logarithms of omega_n and zeta.

    Args:
        y: Positions, shape (n,).
        u: Voltages computed from them, shape (n,).
        tick: [s].
        delay: Ticks until a voltage leaves.
        K_L: Gain [unit/s/V].
        sigma: Standard deviation of the sensor's noise [unit].
        guess: omega_n [rad/s] and zeta to begin with, wrong by `GUESS` or so.
    """
    volts = np.concatenate([np.zeros(delay), u])[: len(u)]
    x, p = _kalman(y, volts, tick, K_L, max(sigma, 1e-5 * float(np.ptp(y))), np.log(np.array(guess)))
    omega_n, zeta = math.exp(min(x[4], 50.0)), math.exp(min(x[5], 50.0))
    sd = np.sqrt(np.maximum(np.diag(p)[4:], 0.0))
    return omega_n, omega_n * float(sd[0]), zeta, zeta * float(sd[1])


def _kalman(
    y: Array, volts: Array, tick: float, K_L: float, sigma: float, guess: Array
) -> tuple[Array, Array]:
    x = np.array([y[0], 0.0, 0.0, 0.0, guess[0], guess[1]])
    speed, omega = K_L * np.max(np.abs(volts)), math.exp(guess[0])
    p = np.diag(
        np.array(
            [
                sigma**2,
                (0.1 * speed) ** 2,
                (0.1 * speed * omega) ** 2,
                (BIAS * np.max(np.abs(volts))) ** 2,
                GUESS[0] ** 2,
                GUESS[1] ** 2,
            ]
        )
    )
    for k in range(len(y)):
        if k > 0:
            x, slopes = _ahead(x, volts[k - 1], K_L, tick)
            p = slopes @ p @ slopes.T
        gain = p[:, 0] / (p[0, 0] + sigma**2)
        x = x + gain * (y[k] - x[0])
        p = p - gain[:, None] * p[0]
    return x, p


def _ahead(x: Array, volts: float, K_L: float, tick: float) -> tuple[Array, Array]:
    """The state a tick later, to fourth order in the tick, and its derivatives by the state."""
    squared, double = math.exp(2.0 * x[4]), 2.0 * math.exp(x[5] + x[4])
    a = np.zeros((6, 6))
    a[0, 1] = a[1, 2] = 1.0
    a[2, 1], a[2, 2], a[2, 3] = -squared, -double, squared * K_L
    forced = squared * (K_L * (volts + x[3]) - x[1])
    a[2, 4], a[2, 5] = 2.0 * forced - double * x[2], -double * x[2]
    slope = np.array([x[1], x[2], forced - double * x[2], 0.0, 0.0, 0.0])
    turn = a * tick
    twice = turn @ turn
    series = np.eye(6) + turn / 2.0 + twice / 6.0 + twice @ turn / 24.0
    return x + series @ slope * tick, np.eye(6) + series @ turn
