"""Maximum likelihood of the plant, given the voltages applied and the positions, or speeds, measured.

Both are linear in the gain, in the free initial state and in the ramp of a load bias or a drifting sensor;
what is left to search are omega_n, zeta and, where it is unknown, the delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.estimate.noise import WHITE, seen_in
from seod.estimate.wave_search import DELAY, OMEGA_N, ZETA, Search

if TYPE_CHECKING:
    from seod.estimate.limit_cycle import Array
    from seod.estimate.plant_response import StepwiseVoltage


class Known(NamedTuple):
    """A value known beforehand, with its standard deviation: 0 is certain, inf is not known at all."""

    value: float
    sd: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether nothing is left to estimate."""
        return self.sd == 0.0

    @property
    def precision(self) -> float:
        """1 / variance; 0 where certain, for then it is no unknown, and where not known at all."""
        return 0.0 if self.certain else self.sd**-2


EXACTLY_ZERO: Final = Known(0.0)


@dataclass(frozen=True, slots=True)
class Window:
    """What is measured and what is known.

    Attributes:
        t: Sample times [s], rising, shape (n,).
        y: Positions [unit] or speeds [unit/s], shape (n,).
        voltage: What was applied, seen from `t`; it knows which of both `y` is.
        K_L: Gain [unit/s/V].
        delay: Beyond the times of `voltage` [s].
        lag: Time constant of the sensor [s].
        resolution: Step of the sensor, in the unit of `y`; 0: unknown or fine.
    """

    t: Array
    y: Array
    voltage: StepwiseVoltage
    K_L: Known
    delay: Known = EXACTLY_ZERO
    lag: float = 0.0
    resolution: float = 0.0


NAMES: Final = ("omega_n", "zeta", "K_L", "delay")


@dataclass(frozen=True, slots=True)
class Fit:
    """The answer.

    Attributes:
        omega_n: [rad/s].
        zeta: Damping ratio.
        K_L: [unit/s/V].
        delay: [s].
        covariance: Of omega_n, zeta, K_L and delay in this order and these units; what is certain has zeros.
        noise: Standard deviation of the measurement's noise, in the unit of `Window.y`.
        colour: By how much the noise's correlation narrowed what is left of it, 1 for white noise.
        rejected: Samples that were left out as outliers.
        residual: Measured minus fitted, shape (n,).
        converged: The search came to its end.
        changed: How significantly omega_n and zeta changed within the window: chi-square of two degrees.
        changed_at: Part of the window before that change.
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
    changed: float = 0.0
    changed_at: float = 0.0

    def sd(self, name: str) -> float:
        """Standard deviation of one of `NAMES`."""
        k = NAMES.index(name)
        return math.sqrt(self.covariance[k, k])

    @property
    def correlation(self) -> Array:
        """Of the same four; 0 where one is certain."""
        sd = np.sqrt(np.diag(self.covariance))
        sd[sd == 0.0] = np.inf
        return np.asarray(self.covariance / np.outer(sd, sd))


def fit(window: Window, omega_n: float, zeta: float, delay: float | None = None) -> Fit | None:
    """The most likely plant, searched for from `omega_n` [rad/s], `zeta` and `delay` [s].

    None where the data determine none: too few samples, or a search that runs away.
    """
    unknowns = 7 + (not window.K_L.certain) + (not window.delay.certain)
    if len(window.t) < 2 * unknowns or not math.isfinite(omega_n * zeta):
        return None
    start = np.array([math.log(omega_n), math.log(zeta), window.delay.value if delay is None else delay])
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return _answer(_searched(window, start))
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError, ValueError):
        return None


def _searched(window: Window, start: Array) -> Search:
    """The end of the search, made again where its residual shows colour, outliers or what priors count."""
    search = Search(window, WHITE)
    search.run(start)
    noise = seen_in(search.here.residual)
    priors = window.K_L.precision + window.delay.precision > 0.0
    if not noise.memory and not noise.rejected and not priors:
        return search
    again = Search(window, noise, search.sigma)
    again.run(search.here.theta if search.converged else start)
    return again


def _answer(search: Search) -> Fit | None:
    """In the field's units; None where it is none."""
    here = search.here
    omega_n, zeta = math.exp(here.theta[OMEGA_N]), math.exp(here.theta[ZETA])
    covariance = _covariance(search) * np.outer(*[np.array([omega_n, zeta, 1.0, 1.0])] * 2)
    plain = float(np.std(here.residual))
    if not np.all(np.isfinite(covariance)) or np.any(covariance.diagonal() < 0.0) or not math.isfinite(plain):
        return None
    changed, changed_at = search.change()
    return Fit(
        omega_n=omega_n,
        zeta=zeta,
        K_L=here.gain,
        delay=float(here.theta[DELAY]),
        covariance=covariance,
        noise=plain,
        colour=search.sigma / max(plain, 1e-300),
        rejected=search.noise.rejected,
        residual=here.residual,
        converged=search.converged,
        changed=changed,
        changed_at=changed_at,
    )


def _covariance(search: Search) -> Array:
    """Of the logarithms of omega_n and zeta, of K_L and of the delay."""
    places = {"omega_n": OMEGA_N, "zeta": ZETA}
    if not search.window.delay.certain:
        places["delay"] = DELAY
    if not search.window.K_L.certain:
        places["K_L"] = len(search.searched)
    to, of = [NAMES.index(name) for name in places], list(places.values())
    covariance = np.zeros((4, 4))
    covariance[np.ix_(to, to)] = search.covariance()[np.ix_(of, of)]
    return covariance
