"""Eq. 1 fitted to the points of a frequency response, each in the measure of its standard deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import least_squares

from seod.respond.record import RespondError

if TYPE_CHECKING:
    from seod.respond.points import Points
    from seod.respond.record import Array, Complex, Output

NAMES: Final = ("K_L", "omega_n", "zeta", "delay")
_ZETAS: Final = (0.15, 0.6, 1.5)
_FREQUENCIES: Final = 8
_FLOOR: Final = 1e-4
"""No point is believed better than this part of it: images of the stepwise voltage are not exact."""


@dataclass(frozen=True)
class Plant:
    """K_L [unit/s/V], omega_n [rad/s], zeta, delay [s]."""

    K_L: float
    omega_n: float
    zeta: float
    delay: float = 0.0


@dataclass(frozen=True)
class Fit:
    """The plant that fits the points best.

    Attributes:
        plant: It.
        covariance: Of K_L, omega_n, zeta, delay, shape (4, 4); 0 for what was given.
        misfit: Scatter of the points about it in their standard deviations; 1 where it explains them.
        error: RMS of the relative errors of the points, each counting by how well it is known.
    """

    plant: Plant
    covariance: Array
    misfit: float
    error: float

    @property
    def sd(self) -> dict[str, float]:
        """Standard deviations by name."""
        return dict(zip(NAMES, np.sqrt(self.covariance.diagonal()).tolist(), strict=True))


def model(plant: Plant, omega: Array, output: Output, lag: float = 0.0) -> Complex:
    """Eq. 1 at `omega` [rad/s], its integral for a position, with delay, behind a sensor of this lag [s]."""
    s = 1j * omega
    G = plant.K_L * plant.omega_n**2 / (s**2 + 2.0 * plant.zeta * plant.omega_n * s + plant.omega_n**2)
    G = G * np.exp(-s * plant.delay) / (1.0 + lag * s)
    return np.asarray(G / s if output == "position" else G)


def fit(
    points: Points, output: Output, K_L: float | None = None, delay: float | None = None, lag: float = 0.0
) -> Fit:
    """Least squares of the complex differences; the interval is widened where the points scatter more.

    Args:
        points: At least four.
        output: What was measured.
        K_L: Where it is known [unit/s/V]; None: estimated.
        delay: Where it is known [s]; None: estimated.
        lag: Time constant of the sensor, known [s].

    Raises:
        RespondError: Too few points.
    """
    free = np.array([K_L is None, True, True, delay is None])
    if 2 * len(points.omega) <= free.sum():
        raise RespondError(f"{len(points.omega)} points are too few to fit {free.sum()} unknowns")
    sd = np.hypot(points.sd, _FLOOR * np.abs(points.G))

    def residual(theta: Array) -> Array:
        left = (points.G - model(plant_of(theta), points.omega, output, lag)) / sd
        return np.concatenate([left.real, left.imag])

    def plant_of(theta: Array) -> Plant:
        whole = np.array([K_L or 0.0, 0.0, 0.0, 0.0])
        whole[free] = theta
        return _plant(whole, delay)

    starts = [start[free] for start in _starts(points, output, delay)]
    shortlist = sorted(starts, key=lambda theta: float(np.sum(residual(theta) ** 2)))[:4]
    found = min((least_squares(residual, theta, x_scale="jac") for theta in shortlist), key=lambda f: f.cost)
    plant = plant_of(found.x)
    misfit = math.sqrt(2.0 * float(found.cost) / (2 * len(sd) - len(found.x)))
    inner = np.zeros((4, 4))
    jacobian = np.asarray(found.jac)
    inner[np.ix_(free, free)] = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    weight = (np.abs(points.G) / sd) ** 2
    off = np.abs(1.0 - model(plant, points.omega, output, lag) / points.G) ** 2
    error = math.sqrt(float(off @ weight / weight.sum()))
    return Fit(plant, _covariance(plant, inner * max(1.0, misfit) ** 2), misfit, error)


def _plant(theta: Array, delay: float | None) -> Plant:
    """From what is searched: K_L, the logarithms of omega_n and zeta, the delay in parts of 1 / omega_n."""
    omega_n = math.exp(min(theta[1], 50.0))
    later = theta[3] / omega_n if delay is None else delay
    return Plant(float(theta[0]), omega_n, math.exp(min(theta[2], 50.0)), float(later))


def _starts(points: Points, output: Output, delay: float | None) -> list[Array]:
    """Over the band, each with its best gain."""
    size, starts = np.abs(points.G), []
    for omega_n in np.geomspace(points.omega[0], 2.0 * points.omega[-1], _FREQUENCIES).tolist():
        for zeta in _ZETAS:
            shape = model(Plant(1.0, omega_n, zeta, delay or 0.0), points.omega, output) / size
            gain = float((shape.conj() @ (points.G / size)).real / (np.abs(shape) ** 2).sum())
            starts.append(np.array([gain, math.log(omega_n), math.log(zeta), 0.0]))
    return starts


def _covariance(plant: Plant, inner: Array) -> Array:
    """Of the plant's own numbers, from that of what is searched."""
    change = np.diag([1.0, plant.omega_n, plant.zeta, 1.0 / plant.omega_n])
    if inner[3, 3] > 0.0:
        change[3, 1] = -plant.delay
    return np.asarray(change @ inner @ change.T)
