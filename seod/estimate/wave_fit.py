"""Maximum likelihood of the plant's parameters, given the voltages applied and the positions measured.

Variable projection (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973): position is linear in the gain, in the free
initial state and in the ramp of a load bias or a drifting sensor; what is left to search are omega_n, zeta and,
where it is unknown, the delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import lstsq, qr, solve_triangular

from seod.estimate.noise import Noise, seen_in, white
from seod.estimate.plant_response import Dynamics, free_motion

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array
    from seod.estimate.plant_response import StepwiseVoltage

ITERATIONS = 30
CONVERGED = 1e-3
"""The search ends where a step is this small a part of the deviation that is left by the noise."""
LONGEST_STEP = 0.5
"""In the logarithms of omega_n and zeta."""
DELAY_STEP = 1e-7
"""Of the numerical derivative [s]; that of the logarithms is 1e-6."""


class Known(NamedTuple):
    """A value known beforehand, with its standard deviation: 0 is certain, inf is not known at all."""

    value: float
    sd: float = 0.0

    @property
    def certain(self) -> bool:
        return self.sd == 0.0


@dataclass(frozen=True, slots=True)
class Window:
    """What is measured and what is known.

    Attributes:
        t: Sample times [s], rising, shape (n,).
        y: Positions [unit], shape (n,).
        voltage: What was applied, seen from `t`.
        K_L: Gain [unit/s/V].
        delay: Beyond the times of `voltage` [s].
        lag: Time constant of the sensor [s].
        resolution: Step of the sensor [unit]; 0: unknown or fine.
    """

    t: Array
    y: Array
    voltage: StepwiseVoltage
    K_L: Known
    delay: Known = Known(0.0)
    lag: float = 0.0
    resolution: float = 0.0


NAMES = ("omega_n", "zeta", "K_L", "delay")


@dataclass(frozen=True, slots=True)
class Fit:
    """The answer.

    Attributes:
        omega_n: [rad/s].
        zeta: Damping ratio.
        K_L: [unit/s/V].
        delay: [s].
        covariance: Of omega_n, zeta, K_L and delay in this order and these units; what is certain has zeros.
        noise: Standard deviation of the measurement's noise [unit].
        colour: By how much the noise's correlation widened the deviations.
        rejected: Samples that were left out as outliers.
        residual: Measured minus fitted [unit], shape (n,).
        converged: The search came to its end.
    """

    omega_n: float
    zeta: float
    K_L: float
    delay: float
    covariance: Array
    noise: float
    colour: float
    rejected: int
    residual: Array
    converged: bool

    def sd(self, name: str) -> float:
        """Standard deviation of one of `NAMES`."""
        k = NAMES.index(name)
        return math.sqrt(self.covariance[k, k])

    @property
    def correlation(self) -> Array:
        """Of the same four; 0 where one is certain."""
        sd = np.sqrt(np.diag(self.covariance))
        sd[sd == 0.0] = np.inf
        return self.covariance / np.outer(sd, sd)


def fit(window: Window, omega_n: float, zeta: float) -> Fit | None:
    """The most likely plant, searched for from `omega_n` [rad/s] and `zeta`.

    None where the data determine none: too few samples, or a search that runs away.
    """
    unknowns = 3 + (not window.K_L.certain) + (not window.delay.certain) + 4
    if len(window.t) < 2 * unknowns:
        return None
    start = np.array([math.log(omega_n), math.log(zeta), window.delay.value])
    try:
        search = _Search(window, white(len(window.t)))
        search.run(start)
        noise = seen_in(search.residual)
        if len(noise.memory) or not noise.good.all():
            search = _Search(window, noise)
            search.run(start)
        return search.answer()
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError):
        return None


class _Search:
    """Gauss-Newton in (log omega_n, log zeta, delay), the linear unknowns solved for at each point."""

    def __init__(self, window: Window, noise: Noise) -> None:
        self.window, self.noise = window, noise
        self.since = window.t - window.t[0]
        self.course = np.column_stack([np.ones_like(self.since), self.since / self.since[-1]])
        self.searched = [0, 1] if window.delay.certain else [0, 1, 2]
        self.first = 1 if window.K_L.certain else 0
        self.sigma = 0.0
        self.converged = False

    def run(self, start: Array) -> None:
        """Go downhill until nothing is gained that the noise would not hide."""
        self.at(start)
        damping = 0.0
        for _ in range(ITERATIONS):
            here = self.theta, self.cost
            jacobian = self.jacobian()
            step, relative = self.step(jacobian, damping)
            self.at(here[0] + step)
            if self.cost > here[1] * (1.0 + 1e-12):
                self.at(here[0])
                damping = max(10.0 * damping, 1e-3)
                continue
            damping *= 0.1
            if relative < CONVERGED:
                self.converged = True
                break

    def at(self, theta: Array) -> None:
        """Stand at these unknowns: the linear ones, the residual, the cost."""
        self.theta = theta
        self.columns = self.model(theta)
        y = self.window.y - self.window.K_L.value * self.columns[:, 0] if self.first else self.window.y
        a, b = self.noise.whiten(self.columns[:, self.first :]), self.noise.whiten(y)
        a, b = self.with_prior(a, b)
        free = lstsq(a, b, check_finite=False, lapack_driver="gelsy")[0]
        self.weights = np.concatenate(([self.window.K_L.value], free)) if self.first else free
        self.residual = self.window.y - self.columns @ self.weights
        self.white_residual = self.noise.whiten(self.residual)
        self.sigma = math.sqrt(float(self.white_residual @ self.white_residual) / max(len(b) - 7, 1))
        self.cost = float(np.sum((b - a @ free) ** 2)) + self.delay_surprise() ** 2

    def model(self, theta: Array) -> Array:
        """Columns of the position: what a gain of 1 gives, constant, ramp, free motions of plant and sensor."""
        plant = Dynamics(math.exp(theta[0]), math.exp(theta[1]), float(theta[2]), self.window.lag)
        cosine, sine = free_motion(plant, self.since)
        columns = [self.window.voltage.position(plant), *self.course.T, cosine, sine * plant.omega_n]
        if plant.lag > 0.0:
            columns.append(np.exp(-self.since / plant.lag))
        return np.column_stack(columns)

    def with_prior(self, a: Array, b: Array) -> tuple[Array, Array]:
        """What is known of K_L beforehand as one more row, in the noise's measure."""
        K_L = self.window.K_L
        if K_L.certain or math.isinf(K_L.sd) or self.sigma == 0.0:
            return a, b
        row = np.zeros((1, a.shape[1]))
        row[0, 0] = self.sigma / K_L.sd
        return np.vstack([a, row]), np.append(b, self.sigma / K_L.sd * K_L.value)

    def delay_surprise(self) -> float:
        """How far the delay is from what is known of it, in the noise's measure."""
        delay = self.window.delay
        return 0.0 if delay.certain or math.isinf(delay.sd) else self.sigma * (self.theta[2] - delay.value) / delay.sd

    def jacobian(self) -> Array:
        """Derivatives by the searched unknowns and the free linear ones, white, with the priors' rows."""
        slopes = [self.slope(k) for k in self.searched]
        whole = np.column_stack([*slopes, self.columns[:, self.first :]])
        rows = self.noise.whiten(whole)
        priors = []
        if not self.window.K_L.certain and not math.isinf(self.window.K_L.sd):
            priors.append((len(self.searched), self.sigma / self.window.K_L.sd))
        if 2 in self.searched and not math.isinf(self.window.delay.sd):
            priors.append((2, self.sigma / self.window.delay.sd))
        extra = np.zeros((len(priors), rows.shape[1]))
        for row, (place, value) in enumerate(priors):
            extra[row, place] = value
        return np.vstack([rows, extra])

    def slope(self, k: int) -> Array:
        """Central difference of the position by one searched unknown."""
        h = np.zeros(3)
        h[k] = DELAY_STEP if k == 2 else 1e-6
        return np.asarray((self.model(self.theta + h) - self.model(self.theta - h)) @ self.weights / (2.0 * h[k]))

    def surprise(self, rows: int) -> Array:
        """White residual and what the priors leave, `rows` long."""
        K_L, rest = self.window.K_L, []
        if not K_L.certain and not math.isinf(K_L.sd):
            rest.append(self.sigma * (K_L.value - self.weights[0]) / K_L.sd)
        if 2 in self.searched and not math.isinf(self.window.delay.sd):
            rest.append(-self.delay_surprise())
        return np.concatenate([self.white_residual, rest])[:rows]

    def step(self, jacobian: Array, damping: float) -> tuple[Array, float]:
        """Where to go, and how far that is in standard deviations of what is left."""
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        a, b = jacobian / scale, self.surprise(len(jacobian))
        count = len(self.searched)
        if damping > 0.0:
            a = np.vstack([a, math.sqrt(damping) * np.eye(count, a.shape[1])])
            b = np.concatenate([b, np.zeros(count)])
        found = lstsq(a, b, check_finite=False, lapack_driver="gelsy")[0]
        gained = math.sqrt(float(np.sum((a @ found) ** 2))) / max(self.sigma, 1e-300)
        step = np.zeros(3)
        step[self.searched] = (found / scale)[:count]
        longest = float(np.max(np.abs(step[:2])))
        return step * min(1.0, LONGEST_STEP / max(longest, 1e-300)), min(gained, longest / 1e-9)

    def answer(self) -> Fit:
        """With the covariance that the white residual tells."""
        jacobian = self.jacobian()
        (r,) = qr(jacobian, mode="r", check_finite=False)
        p = jacobian.shape[1]
        inverse = solve_triangular(r[:p], np.eye(p), check_finite=False)
        full = self.sigma**2 * inverse @ inverse.T
        omega_n, zeta = math.exp(self.theta[0]), math.exp(self.theta[1])
        place = [0, 1, *([3] if 2 in self.searched else []), *([] if self.first else [2])]
        covariance = np.zeros((4, 4))
        covariance[np.ix_(place, place)] = full[: len(place), : len(place)]
        units = np.array([omega_n, zeta, 1.0, 1.0])
        plain = float(np.std(self.residual[self.noise.good]))
        return Fit(
            omega_n=omega_n,
            zeta=zeta,
            K_L=float(self.weights[0]),
            delay=float(self.theta[2]),
            covariance=covariance * np.outer(units, units),
            noise=plain,
            colour=self.sigma / max(plain, 1e-300),
            rejected=int(np.sum(~self.noise.good)),
            residual=self.residual,
            converged=self.converged,
        )
