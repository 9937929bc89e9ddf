"""The plant of Eq. 1 in closed form: its free motion, and its position or speed under a stepwise voltage."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.estimate.motion_rates import rate_slopes, rates

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array

_NEAR = 0.03
"""|omega_d^2| tau^2 below which a difference of two nearly equal motions is taken from its series."""
_STEP = 1e-5
"""Of the numerical derivatives of what changes only with the voltage, in the logarithms of both unknowns."""


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


class Response(NamedTuple):
    """Position, or speed, of a plant of gain 1 [unit/K_L], and its derivatives, each of shape (n,)."""

    output: Array
    by_omega_n: Array
    """By the logarithm of omega_n; likewise `by_zeta`."""
    by_zeta: Array
    by_delay: Array
    """[unit/K_L/s]"""


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


class _Course(NamedTuple):
    """After each change, shape (m,): position = steady + u tau + alpha C + beta S + left E."""

    steady: Array
    alpha: Array
    beta: Array
    left: Array


class StepwiseVoltage:
    """A voltage that holds between changes, as seen from sample times.

    Args:
        t_u: When each voltage began [s], rising; the first not after the first sample.
        u: Voltages [V].
        t: Sample times [s], rising.
        speed: Speed is measured, not position.
    """

    def __init__(self, t_u: Array, u: Array, t: Array, speed: bool = False) -> None:
        self.speed = speed
        changed = np.flatnonzero(np.diff(u, prepend=np.nan) != 0.0)
        self.t_u, self.u, self.t = t_u[changed], u[changed], t
        self.held = np.diff(self.t_u)
        self.jumps = np.diff(self.u).tolist()
        self.travelled = np.concatenate(([0.0], np.cumsum(self.u[:-1] * self.held)))

    def output(self, plant: Dynamics) -> Array:
        """Position of a plant of gain 1 at the sample times [unit/K_L], or its speed [unit/s/K_L].

        It is right but for a constant, a ramp and free motion: what a free initial state takes up.
        """
        place, tau = self._place(plant.delay)
        motions, u = self._motions(plant, tau), self.u[place]
        course = self._course(plant)
        if self.speed:
            return self._sum(course, place, u, rates(plant, motions))
        return self._sum(course, place, u * tau, motions)

    def free(self, plant: Dynamics, tau: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """What is measured of the plant's two free motions at the times `tau` [s], and its `free_slopes`."""
        free = free_motion(plant, tau)
        slopes = free_slopes(plant, tau, free)
        return (rates(plant, free), rate_slopes(plant, free, slopes)) if self.speed else (free, slopes)

    def response(self, plant: Dynamics) -> Response:
        """What is measured, with its derivatives; right but for what a free initial state takes up."""
        place, tau = self._place(plant.delay)
        course = self._course(plant)
        motions = self._motions(plant, tau)
        slopes = free_slopes(plant, tau, (motions[0], motions[1]))
        changes = rates(plant, motions)
        u, rest = self.u[place], self.u[place] * tau
        if self.speed:
            slopes = rate_slopes(plant, (motions[0], motions[1]), slopes)
            motions, changes = changes, rates(plant, changes)
            u, rest = np.zeros_like(u), u
        alpha, beta = course.alpha[place], course.beta[place]
        omega_n = self._difference(plant, _STEP, 0.0)
        zeta = self._difference(plant, 0.0, _STEP)
        return Response(
            output=self._sum(course, place, rest, motions),
            by_omega_n=self._sum(omega_n, place, alpha * slopes[0] + beta * slopes[2], motions),
            by_zeta=self._sum(zeta, place, alpha * slopes[1] + beta * slopes[3], motions),
            by_delay=-u - _motion(course, place, changes),
        )

    def _place(self, delay: float) -> tuple[Array, Array]:
        """The voltage in force at each sample, and since when [s]."""
        at = self.t_u + delay
        place = np.maximum(np.searchsorted(at, self.t, side="right") - 1, 0)
        return place, np.maximum(self.t - at[place], 0.0)

    def _motions(self, plant: Dynamics, tau: Array) -> tuple[Array, ...]:
        free = free_motion(plant, tau)
        return (*free, np.exp(-tau / plant.lag)) if plant.lag > 0.0 else free

    def _sum(self, course: _Course, place: Array, rest: Array, motions: tuple[Array, ...]) -> Array:
        steady = 0.0 if self.speed else course.steady[place]
        return np.asarray(steady + rest + _motion(course, place, motions))

    def _difference(self, plant: Dynamics, omega_n: float, zeta: float) -> _Course:
        """Derivative of the course by a logarithm: these steps forth and back, divided by their sum."""
        forth, back = (
            self._course(
                plant._replace(
                    omega_n=plant.omega_n * math.exp(s * omega_n), zeta=plant.zeta * math.exp(s * zeta)
                )
            )
            for s in (1.0, -1.0)
        )
        scale = 0.5 / (omega_n + zeta)
        return _Course(*((a - b) * scale for a, b in zip(forth, back, strict=True)))

    def _course(self, plant: Dynamics) -> _Course:
        steady = self.travelled - (2.0 * plant.zeta / plant.omega_n + plant.lag) * self.u
        free = free_motion(plant, self.held)
        alpha, beta = self._deviations(plant, free)
        if plant.lag == 0.0:
            return _Course(steady, alpha, beta, np.zeros(0))
        return _Course(steady, alpha, beta, self._left_behind(plant, steady, alpha, beta, free))

    def _deviations(self, plant: Dynamics, free: tuple[Array, Array]) -> tuple[Array, Array]:
        """After each change, the free motions alpha C + beta S about the position's steady course."""
        sigma, squared = plant.sigma, plant.omega_d_squared
        start = 2.0 * plant.zeta / plant.omega_n
        alpha, beta = [0.0], [0.0]
        a = b = 0.0
        for c, s, jump in zip(free[0].tolist(), free[1].tolist(), self.jumps, strict=True):
            slope = a * (-sigma * c - squared * s) + b * (c - sigma * s) - jump
            a = a * c + b * s + jump * start
            b = slope + sigma * a
            alpha.append(a)
            beta.append(b)
        return _lagged(plant, np.array(alpha), np.array(beta))

    def _left_behind(
        self, plant: Dynamics, steady: Array, alpha: Array, beta: Array, free: tuple[Array, Array]
    ) -> Array:
        """After each change, the sensor's own free motion that keeps its reading continuous."""
        before = steady[:-1] + self.u[:-1] * self.held + alpha[:-1] * free[0] + beta[:-1] * free[1]
        jumps = before - steady[1:] - alpha[1:]
        left = [0.0]
        for decay, jump in zip(np.exp(-self.held / plant.lag).tolist(), jumps.tolist(), strict=True):
            left.append(left[-1] * decay + jump)
        return np.array(left)


def _motion(course: _Course, place: Array, motions: tuple[Array, ...]) -> Array:
    """What a course has of the free motions, or of their time derivatives, at the samples."""
    parts = (factors[place] * motion for factors, motion in zip(course[1:], motions, strict=False))
    return np.asarray(sum(parts))


def _lagged(plant: Dynamics, alpha: Array, beta: Array) -> tuple[Array, Array]:
    """The motion alpha C + beta S as the sensor follows it for good: (1 + lag d/dt)^-1 of it."""
    if plant.lag == 0.0:
        return alpha, beta
    near = 1.0 - plant.lag * plant.sigma
    cross = plant.lag * plant.omega_d_squared
    scale = near * near + plant.lag * cross
    return (near * alpha - plant.lag * beta) / scale, (cross * alpha + near * beta) / scale
