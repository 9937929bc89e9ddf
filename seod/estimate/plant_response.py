"""What the plant of Eq. 1 does, in closed form: its free motion, and its position under a stepwise voltage."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array


class Dynamics(NamedTuple):
    """What is not linear in the data.

    Attributes:
        omega_n: [rad/s].
        zeta: Damping ratio.
        delay: From the voltage to the plant, and from the plant to the sample [s].
        lag: Time constant of the sensor [s]; 0 for none.
    """

    omega_n: float
    zeta: float
    delay: float = 0.0
    lag: float = 0.0


def free_motion(plant: Dynamics, tau: Array) -> tuple[Array, Array]:
    """The two free motions of s^2 + 2 zeta omega_n s + omega_n^2, C and S; smooth through zeta = 1.

    Args:
        plant: Delay and lag play no part.
        tau: Times since the start [s], >= 0.

    Returns:
        e^(-sigma tau) cos(omega_d tau) and e^(-sigma tau) sin(omega_d tau) / omega_d, sigma = zeta omega_n.
    """
    omega_n, zeta = plant.omega_n, plant.zeta
    sigma = zeta * omega_n
    squared = _omega_d_squared(plant)
    if squared > 0.0:
        omega_d = math.sqrt(squared)
        decay = np.exp(-sigma * tau)
        return decay * np.cos(omega_d * tau), decay * np.sin(omega_d * tau) / omega_d
    beta = math.sqrt(-squared)
    slow = np.exp(-omega_n * omega_n / (sigma + beta) * tau)
    spread = -0.5 * np.expm1(-2.0 * beta * tau)
    return slow * (1.0 - spread), slow * (spread / beta if beta > 0.0 else tau)


class StepwiseVoltage:
    """A voltage that holds between changes, as seen from sample times.

    Args:
        t_u: When each voltage began [s], rising; the first not after the first sample.
        u: Voltages [V].
        t: Sample times [s], rising.
    """

    def __init__(self, t_u: Array, u: Array, t: Array) -> None:
        changed = np.flatnonzero(np.diff(u, prepend=np.nan) != 0.0)
        self.t_u, self.u, self.t = t_u[changed], u[changed], t
        self.held = np.diff(self.t_u)
        self.travelled = np.concatenate(([0.0], np.cumsum(self.u[:-1] * self.held)))

    def position(self, plant: Dynamics) -> Array:
        """Position of a plant of gain 1 at the sample times [unit/K_L].

        It is right but for a constant, a ramp and a free motion: what a free initial state takes up.
        """
        at = self.t_u + plant.delay
        place = np.maximum(np.searchsorted(at, self.t, side="right") - 1, 0)
        tau = np.maximum(self.t - at[place], 0.0)
        behind = 2.0 * plant.zeta / plant.omega_n + plant.lag
        steady = self.travelled - behind * self.u
        alpha, beta = self._deviations(plant)
        cosine, sine = free_motion(plant, tau)
        position = steady[place] + self.u[place] * tau + alpha[place] * cosine + beta[place] * sine
        if plant.lag > 0.0:
            left = self._left_behind(plant, steady, alpha, beta)
            position += left[place] * np.exp(-tau / plant.lag)
        return position

    def _deviations(self, plant: Dynamics) -> tuple[Array, Array]:
        """After each change, the free motions alpha C + beta S that the position makes about its steady course."""
        sigma, squared = plant.zeta * plant.omega_n, _omega_d_squared(plant)
        cosines, sines = (values.tolist() for values in free_motion(plant, self.held))
        start = 2.0 * plant.zeta / plant.omega_n
        alpha, beta = [0.0], [0.0]
        a = b = 0.0
        for c, s, jump in zip(cosines, sines, np.diff(self.u).tolist(), strict=True):
            slope = a * (-sigma * c - squared * s) + b * (c - sigma * s) - jump
            a = a * c + b * s + jump * start
            b = slope + sigma * a
            alpha.append(a)
            beta.append(b)
        return _lagged(plant, np.array(alpha), np.array(beta))

    def _left_behind(self, plant: Dynamics, steady: Array, alpha: Array, beta: Array) -> Array:
        """After each change, the sensor's own free motion that keeps its reading continuous."""
        cosines, sines = free_motion(plant, self.held)
        before = steady[:-1] + self.u[:-1] * self.held + alpha[:-1] * cosines + beta[:-1] * sines
        jumps = before - steady[1:] - alpha[1:]
        left = [0.0]
        for decay, jump in zip(np.exp(-self.held / plant.lag).tolist(), jumps.tolist(), strict=True):
            left.append(left[-1] * decay + jump)
        return np.array(left)


def _omega_d_squared(plant: Dynamics) -> float:
    return (1.0 - plant.zeta) * (1.0 + plant.zeta) * plant.omega_n * plant.omega_n


def _lagged(plant: Dynamics, alpha: Array, beta: Array) -> tuple[Array, Array]:
    """The motion alpha C + beta S as the sensor follows it for good: (1 + lag d/dt)^-1 of it."""
    if plant.lag == 0.0:
        return alpha, beta
    near = 1.0 - plant.lag * plant.zeta * plant.omega_n
    cross = plant.lag * _omega_d_squared(plant)
    scale = near * near + plant.lag * cross
    return (near * alpha - plant.lag * beta) / scale, (cross * alpha + near * beta) / scale
