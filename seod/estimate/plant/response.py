"""The plant of Eq. 1 under a stepwise voltage, in closed form: its position or speed, and derivatives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.estimate.plant.free_motion import Dynamics, free_motion, free_slopes, rate_slopes, rates

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

_STEP = 1e-5
"""Of the numerical derivatives of what changes only with the voltage, in the logarithms of both unknowns."""


class Response(NamedTuple):
    """Position, or speed, of a plant of gain 1 [unit/K_L], and its derivatives, each of shape (n,)."""

    output: Array
    by_omega_n: Array
    """By the logarithm of omega_n; likewise `by_zeta`."""
    by_zeta: Array
    by_delay: Array
    """[unit/K_L/s]"""


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

    def by_times(self, plant: Dynamics, changes: slice) -> Array:
        """What is measured, by the times of some changes: shape (changes, samples) [unit/K_L/s].

        A sensor's lag counts as a delay here.
        """
        since = self.t - (self.t_u[changes, None] + plant.delay + plant.lag)
        cosine, sine = free_motion(plant, np.maximum(since, 0.0))
        after = plant.omega_n**2 * sine if self.speed else 1.0 - cosine - plant.sigma * sine
        return np.asarray(np.where(since > 0.0, after, 0.0) * -np.diff(self.u, prepend=0.0)[changes, None])

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
