"""The plant of Eq. 1 left to itself, in closed form: its free motions and their derivatives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

_NEAR = 0.03
"""|omega_d^2| tau^2 below which a difference of two nearly equal motions is taken from its series."""


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

    @property
    def sigma(self) -> float:
        """Decay of the free motion, zeta omega_n [rad/s]."""
        return self.zeta * self.omega_n

    @property
    def omega_d_squared(self) -> float:
        """Square of the free motion's frequency [rad^2/s^2]; negative above zeta = 1."""
        return (1.0 - self.zeta) * (1.0 + self.zeta) * self.omega_n * self.omega_n


def free_motion(plant: Dynamics, tau: Array) -> tuple[Array, Array]:
    """The two free motions of s^2 + 2 zeta omega_n s + omega_n^2, C and S; smooth through zeta = 1.

    Args:
        plant: Delay and lag play no part.
        tau: Times since the start [s], >= 0.

    Returns:
        e^(-sigma tau) cos(omega_d tau) and e^(-sigma tau) sin(omega_d tau) / omega_d, sigma = zeta omega_n.
    """
    omega_n, sigma, squared = plant.omega_n, plant.sigma, plant.omega_d_squared
    if squared > 0.0:
        omega_d = math.sqrt(squared)
        decay = np.exp(-sigma * tau)
        return decay * np.cos(omega_d * tau), decay * np.sin(omega_d * tau) / omega_d
    beta = math.sqrt(-squared)
    slow = np.exp(-omega_n * omega_n / (sigma + beta) * tau)
    spread = -0.5 * np.expm1(-2.0 * beta * tau)
    return slow * (1.0 - spread), slow * (spread / beta if beta > 0.0 else tau)


def free_slopes(plant: Dynamics, tau: Array, free: tuple[Array, Array]) -> tuple[Array, Array, Array, Array]:
    """C by the logarithm of omega_n and of zeta, then S likewise; `free` are C and S at `tau`."""
    cosine, sine = free
    sigma, squared = plant.sigma, plant.omega_d_squared
    by_zeta = -2.0 * (plant.zeta * plant.omega_n) ** 2  # of omega_d^2; that by omega_n is twice itself
    near = abs(squared) * tau * tau < _NEAR
    if near.all():
        across = _difference_series(plant, tau)
    else:
        across = (tau * cosine - sine) / (2.0 * squared)
        if near.any():
            across[near] = _difference_series(plant, tau[near])
    faded_c, faded_s, turned = -sigma * tau * cosine, -sigma * tau * sine, -0.5 * tau * sine
    return (
        faded_c + 2.0 * squared * turned,
        faded_c + by_zeta * turned,
        faded_s + 2.0 * squared * across,
        faded_s + by_zeta * across,
    )


def _difference_series(plant: Dynamics, tau: Array) -> Array:
    """(tau C - S) / (2 omega_d^2) where its parts nearly cancel."""
    x = plant.omega_d_squared * tau * tau
    return np.asarray(
        np.exp(-plant.sigma * tau) * tau**3 * (-1 / 6 + x * (1 / 60 - x * (1 / 1680 - x / 90720)))
    )


def rates(plant: Dynamics, motions: tuple[Array, ...]) -> tuple[Array, ...]:
    """Time derivatives of C, S and, where it is given, the sensor's own free motion; or of derivatives."""
    cosine, sine, *own = motions
    slopes = -plant.sigma * cosine - plant.omega_d_squared * sine, cosine - plant.sigma * sine
    return (*slopes, *(-motion / plant.lag for motion in own))


def rate_slopes(
    plant: Dynamics, free: tuple[Array, Array], slopes: tuple[Array, Array, Array, Array]
) -> tuple[Array, Array, Array, Array]:
    """`free_slopes` of the time derivatives of C and S, given those of C and S themselves."""
    cosine, sine = free
    sigma, squared = plant.sigma, plant.omega_d_squared
    (c_omega, c_zeta, s_omega, s_zeta), by_zeta = slopes, -2.0 * sigma * sigma
    return (
        -sigma * (cosine + c_omega) - squared * (2.0 * sine + s_omega),
        -sigma * (cosine + c_zeta) - by_zeta * sine - squared * s_zeta,
        c_omega - sigma * (sine + s_omega),
        c_zeta - sigma * (sine + s_zeta),
    )
