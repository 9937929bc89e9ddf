"""Maximum likelihood of the plant, given the voltages applied and the positions, or speeds, measured.

Both are linear in the gain, in the free initial state and in the ramp of a load bias or a drifting sensor;
what is left to search are omega_n, zeta and, where it is unknown, the delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.estimate.noise import WHITE, seen_in
from seod.estimate.wave.late_commands import search_late
from seod.estimate.wave.search import DELAY, OMEGA_N, ZETA, Information, Search

if TYPE_CHECKING:
    from seod.estimate.arrays import Array
    from seod.estimate.wave.window import Window


NAMES: Final = ("omega_n", "zeta", "K_L", "delay")


@dataclass(frozen=True, slots=True)
class Fit:
    """The answer.

    Attributes:
        omega_n: [rad/s].
        zeta: Damping ratio.
        K_L: [unit/s/V].
        delay: [s].
        information: What samples and priors tell of the search's unknowns.
        places: Of each of `NAMES` among them; None: it is certain.
        noise: Standard deviation of the measurement's noise, in the unit of `Window.y`.
        colour: By how much the noise's correlation narrowed what is left of it, 1 for white noise.
        rejected: Samples that were left out as outliers.
        coloured: The noise has a memory.
        residual: Measured minus fitted, shape (n,).
        converged: The search came to its end.
        changed: How significantly omega_n and zeta changed within the window: chi-square of two degrees.
        changed_at: Part of the window before that change.
    """

    omega_n: float
    zeta: float
    K_L: float
    delay: float
    information: Information
    places: tuple[int | None, ...]
    noise: float
    colour: float
    rejected: int
    coloured: bool
    residual: Array
    converged: bool
    changed: float = 0.0
    changed_at: float = 0.0

    def covariance(self, widened: float = 1.0) -> Array:
        """Of `NAMES` in their units, shape (4, 4); zeros where one is certain.

        Args:
            widened: By how much the noise counts for larger than it is: what is known beforehand does not.
        """
        to = [k for k, place in enumerate(self.places) if place is not None]
        of = [place for place in self.places if place is not None]
        units = np.array([self.omega_n, self.zeta, 1.0, 1.0])
        covariance = np.zeros((4, 4))
        covariance[np.ix_(to, to)] = self.information.covariance(widened)[np.ix_(of, of)]
        return np.asarray(covariance * np.outer(units, units))

    def sd(self, name: str) -> float:
        """Standard deviation of one of `NAMES`."""
        k = NAMES.index(name)
        return math.sqrt(self.covariance()[k, k])


def fit(
    window: Window, omega_n: float, zeta: float, delay: float | None = None, noise: float | None = None
) -> Fit | None:
    """The most likely plant, searched for from `omega_n` [rad/s], `zeta` and `delay` [s].

    `noise` is the size of the white noise by which priors are weighed [unit]; None: found by a search more.

    None where the data determine none: too few samples, or a search that runs away.
    """
    unknowns = 7 + (not window.K_L.certain) + (not window.delay.certain)
    if len(window.t) < 2 * unknowns or not math.isfinite(omega_n * zeta):
        return None
    start = np.array([math.log(omega_n), math.log(zeta), window.delay.value if delay is None else delay])
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return _answer(_searched(window, start, noise))
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError, ValueError):
        return None


def fit_late(window: Window, before: Fit) -> Fit | None:
    """The most likely plant where single voltages come earlier or later than told; None where none does.

    Args:
        window: What is measured and known.
        before: The fit without that.
    """
    theta = np.array([math.log(before.omega_n), math.log(before.zeta), before.delay])
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            search = search_late(window, theta, before.K_L, before.noise * before.colour)
            return None if search is None else _answer(search)
    except (np.linalg.LinAlgError, OverflowError, FloatingPointError, ValueError):
        return None


def _searched(window: Window, start: Array, sigma: float | None) -> Search:
    """The end of the search, made again where its residual shows colour, outliers or what priors count."""
    search = Search(window, WHITE, sigma)
    search.run(start)
    noise = seen_in(search.here.residual)
    priors = sigma is None and window.K_L.precision + window.delay.precision > 0.0
    if not noise.memory and not noise.rejected and not priors:
        return search
    again = Search(window, noise, sigma or search.sigma)
    again.run(search.here.theta if search.converged else start)
    return again


def _answer(search: Search) -> Fit | None:
    """In the field's units; None where it is none."""
    here = search.here
    plain = float(np.std(here.residual))
    changed, changed_at = search.change()
    found = Fit(
        omega_n=math.exp(here.theta[OMEGA_N]),
        zeta=math.exp(here.theta[ZETA]),
        K_L=here.gain,
        delay=float(here.theta[DELAY]),
        information=search.information,
        places=_places(search),
        noise=plain,
        colour=search.sigma / max(plain, 1e-300),
        rejected=search.noise.rejected,
        coloured=bool(search.noise.memory),
        residual=here.residual,
        converged=search.converged,
        changed=changed,
        changed_at=changed_at,
    )
    covariance = found.covariance()
    possible = np.all(np.isfinite(covariance)) and not np.any(covariance.diagonal() < 0.0)
    return found if possible and math.isfinite(plain) else None


def _places(search: Search) -> tuple[int | None, ...]:
    """Of `NAMES` among the search's unknowns."""
    K_L = None if search.window.K_L.certain else len(search.searched)
    return OMEGA_N, ZETA, K_L, None if search.window.delay.certain else DELAY
