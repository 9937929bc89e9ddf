"""Time derivatives of the free motions of the plant of Eq. 1: what a sensor of speed sees of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array
    from seod.estimate.plant_response import Dynamics


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
