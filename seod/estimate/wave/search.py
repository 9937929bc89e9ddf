"""The search for the most likely plant: Gauss and Newton's, with analytic derivatives.

The unknowns that the position is linear in are solved for at each point (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973, in Kaufman's form). All systems are small: scaled normal equations.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.estimate.plant.free_motion import Dynamics

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.noise import Noise
    from seod.estimate.plant.response import Response
    from seod.estimate.wave.window import Window

OMEGA_N, ZETA, DELAY = 0, 1, 2
"""Places of the searched unknowns: the logarithms of omega_n and zeta, and the delay [s]."""
ITERATIONS: Final = 20
CONVERGED: Final = 1e-2
"""The search ends where a step is this small a part of the deviation that is left by the noise."""
LONGEST_STEP: Final = 0.5
"""In the logarithms of omega_n and zeta; a fifth of it, in radians at omega_n, for the delay."""
EXACT: Final = 1e-10
"""Relative step below which rounding is all that is left."""
ROUNDING: Final = 1e-12
"""Size, as a part of the largest, of a column that whitening took away, as that of a constant."""
SPLITS: Final = (0.5, 0.75)
"""Parts of the window after which the plant may have changed."""


class Point(NamedTuple):
    """Everything at one place of the search.

    Attributes:
        theta: The searched unknowns, shape (3,).
        weights: The linear unknowns that are not certain: K_L if free, constant, ramp, free motions.
        gain: K_L [unit/s/V].
        residual: Measured minus model [unit], shape (n,).
        white: The same, whitened.
        jacobian: White derivatives of the model by all unknowns, searched ones first, shape (p, rows).
        gram: `jacobian` times its transpose, with the priors.
        pull: What the priors add to the gradient, shape (p,).
        cost: Sum of squares, with the priors'.
    """

    theta: Array
    weights: Array
    gain: float
    residual: Array
    white: Array
    jacobian: Array
    gram: Array
    pull: Array
    cost: float


class Lateness(NamedTuple):
    """Voltages that come earlier or later than told, each by itself.

    Attributes:
        sd: Standard deviation [s].
        changes: Which changes of the voltage, among those that the window knows.
        gain: About K_L [unit/s/V].
    """

    sd: float
    changes: slice
    gain: float

    @property
    def number(self) -> int:
        """Of the changes."""
        return int(self.changes.stop - self.changes.start)


class Information(NamedTuple):
    """What tells the unknowns of a search.

    Attributes:
        gram: White derivatives of the model by all unknowns, times their transpose, shape (p, p).
        sigma: Standard deviation of the white noise [unit].
        precision: That of the priors, shape (p,).
    """

    gram: Array
    sigma: float
    precision: Array

    def covariance(self, widened: float) -> Array:
        """Of all unknowns, shape (p, p), if the noise tells as little as one `widened` times as large."""
        scale = (widened * max(self.sigma, 1e-300)) ** 2
        return np.asarray(scale * _inverse(self.gram + scale * np.diag(self.precision)))


class Search:
    """Goes downhill from a start; `here` is where it stands.

    Args:
        window: What is measured and known.
        noise: How to whiten it.
        sigma: Standard deviation of the white noise [unit], in which priors are measured; None: unknown yet.
        late: By how much single voltages come earlier or later than told; None: by nothing.
    """

    def __init__(
        self, window: Window, noise: Noise, sigma: float | None = None, late: Lateness | None = None
    ) -> None:
        self.window, self.noise, self.late = window, noise, late
        self.since = window.t - window.t[0]
        ones, ramp = np.ones_like(self.since), self.since / self.since[-1]
        self.course = np.stack([ones] if window.voltage.speed else [ones, ramp])
        self.searched = [OMEGA_N, ZETA] if window.delay.certain else [OMEGA_N, ZETA, DELAY]
        self.sigma_before = _roughness(noise.whiten(window.y)) if sigma is None else sigma
        self.converged = False
        self.here: Point

    @property
    def sigma(self) -> float:
        """Standard deviation of the white noise that is left [unit]."""
        white = self.here.white
        freedom = max(len(white) - len(self.here.gram), 1)
        return math.sqrt(float(white @ white) / freedom)

    def run(self, start: Array) -> None:
        """Go downhill until nothing is gained that the noise would not hide."""
        self.here = self.at(start)
        damping = 0.0
        for _ in range(ITERATIONS):
            step, relative = self.step(damping)
            if relative < CONVERGED:
                self.converged = True
                return
            there = self.at(self.here.theta + step)
            if there.cost <= self.here.cost:
                self.here = there
                damping *= 0.1
            else:
                damping = max(10.0 * damping, 1e-3)

    def at(self, theta: Array) -> Point:
        """The linear unknowns solved for, the residual, the derivatives."""
        window = self.window
        plant = Dynamics(math.exp(theta[OMEGA_N]), math.exp(theta[ZETA]), float(theta[DELAY]), window.lag)
        response = window.voltage.response(plant)
        free, free_slopes = window.voltage.free(plant, self.since)
        columns = self.columns(plant, response, free)
        target = window.y - window.K_L.value * response.output if window.K_L.certain else window.y
        white_columns, white_target = self.noise.whiten(columns), self.noise.whiten(target)
        weights, white = self.linear(white_columns, white_target)
        gain = window.K_L.value if window.K_L.certain else float(weights[0])
        slopes = self.slopes(plant, response, free_slopes, gain, weights)
        jacobian = np.concatenate([self.noise.whiten(slopes), white_columns])
        precision, pull = self.priors(theta, weights)
        return Point(
            theta=theta,
            weights=weights,
            gain=gain,
            residual=target - weights @ columns,
            white=white,
            jacobian=jacobian,
            gram=jacobian @ jacobian.T + np.diag(precision),
            pull=pull,
            cost=float(white @ white) + self.surprise(theta, weights),
        )

    def columns(self, plant: Dynamics, response: Response, free: tuple[Array, ...]) -> Array:
        """What a position is linear in: gain if free, constant, ramp, free motions of plant and sensor.

        A speed has no ramp.
        """
        rows = [*self.course, free[0], free[1] * plant.omega_n]
        if plant.lag > 0.0:
            rows.append(np.exp(-self.since / plant.lag))
        if not self.window.K_L.certain:
            rows.insert(0, response.output)
        if self.late:
            rows.extend(self.late.gain * self.window.voltage.by_times(plant, self.late.changes))
        return np.stack(rows)

    def linear(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Least squares of `b` by the rows of `a`, refined once: the weights, and what is left of `b`."""
        gram, known = a @ a.T, np.zeros(len(a))
        prior = self.sigma_before**2 * self.precision(len(a))
        if not self.window.K_L.certain:
            known[0] = self.window.K_L.value
        inverse = _inverse(gram + np.diag(prior))
        weights, rest = np.zeros(len(a)), b
        for _ in range(2):
            weights = weights + inverse @ (a @ rest + prior * (known - weights))
            rest = b - weights @ a
        return weights, rest

    def precision(self, count: int) -> Array:
        """What is known beforehand of the `count` linear unknowns: 1 / variance."""
        precision = np.zeros(count)
        precision[0] = self.window.K_L.precision
        if self.late:
            precision[count - self.late.number :] = self.late.sd**-2
        return precision

    def slopes(
        self, plant: Dynamics, response: Response, by: tuple[Array, ...], gain: float, weights: Array
    ) -> Array:
        """Derivatives of what is measured by the searched unknowns, but for what the linear ones take up."""
        place = len(self.course) + (not self.window.K_L.certain)
        c, s = weights[place], weights[place + 1] * plant.omega_n
        rows = [
            gain * response.by_omega_n + c * by[0] + s * by[2],
            gain * response.by_zeta + c * by[1] + s * by[3],
            gain * response.by_delay,
        ]
        return np.stack(rows[: len(self.searched)])

    def priors(self, theta: Array, weights: Array) -> tuple[Array, Array]:
        """What is known beforehand: added to the diagonal of the Gram matrix, and to the gradient."""
        known, delay = np.zeros(len(self.searched) + len(weights)), self.window.delay
        precision, place = np.zeros(len(known)), len(self.searched)
        precision[place:] = self.precision(len(weights))
        known[place] = self.window.K_L.value
        if DELAY in self.searched:
            precision[DELAY], known[DELAY] = delay.precision, delay.value
        precision *= self.sigma_before**2
        return precision, precision * (known - np.concatenate([theta[self.searched], weights]))

    def surprise(self, theta: Array, weights: Array) -> float:
        """How far the unknowns are from what is known of them, in the noise's measure."""
        precision, pull = self.priors(theta, weights)
        counts = precision > 0.0
        return float(np.sum(pull[counts] ** 2 / precision[counts]))

    def step(self, damping: float) -> tuple[Array, float]:
        """Where to go, and how far that is in standard deviations of what is left."""
        here, count = self.here, len(self.searched)
        gradient = here.jacobian @ here.white + here.pull
        diagonal = np.zeros(len(here.gram))
        diagonal[:count] = damping * here.gram.diagonal()[:count]
        whole = _inverse(here.gram + np.diag(diagonal)) @ gradient
        gained = math.sqrt(max(float(whole @ here.gram @ whole), 0.0)) / max(self.sigma, 1e-300)
        step = np.zeros(3)
        step[self.searched] = whole[:count]
        omega_n = math.exp(here.theta[OMEGA_N])
        longest = max(abs(step[OMEGA_N]), abs(step[ZETA]), 5.0 * omega_n * abs(step[DELAY]), 1e-300)
        return step * min(1.0, LONGEST_STEP / longest), min(gained, longest / EXACT * CONVERGED)

    @property
    def information(self) -> Information:
        """What samples and priors tell of all unknowns."""
        here = self.here
        weighed, _ = self.priors(here.theta, here.weights)
        return Information(
            here.gram - np.diag(weighed), self.sigma, weighed / max(self.sigma_before, 1e-300) ** 2
        )

    def change(self) -> tuple[float, float]:
        """The most significant change of omega_n and zeta within the window.

        Returns:
            Chi-square of two degrees of freedom, and the part of the window before the change.
        """
        jacobian, white = self.here.jacobian, self.here.white
        inverse, variance = _inverse(self.here.gram), max(self.sigma**2, 1e-300)
        best = 0.0, 0.0
        for part in SPLITS:
            newer = slice(int(part * len(white)), None)
            across = jacobian[:2, newer] @ jacobian[:, newer].T
            own = across[:, :2] - across @ inverse @ across.T
            score = jacobian[:2, newer] @ white[newer] - across @ inverse @ (jacobian @ white)
            best = max(best, (float(score @ _inverse(own) @ score) / variance, part))
        return best


def _inverse(gram: Array) -> Array:
    """Of a positive semidefinite matrix, scaled to ones on its diagonal; what it does not tell stays at 0."""
    scale = np.sqrt(gram.diagonal())
    identified = scale > ROUNDING * scale.max()
    factors = 1.0 / np.where(identified, scale, np.inf)
    both = np.outer(factors, factors)
    return np.asarray(np.linalg.inv(gram * both + np.diag(np.where(identified, 1e-14, 1.0))) * both)


def _roughness(y: Array) -> float:
    """Standard deviation of white noise in `y`, by third differences, which a smooth motion hardly has."""
    return float(np.median(np.abs(np.diff(y, 3)))) / (0.6745 * math.sqrt(20.0))
