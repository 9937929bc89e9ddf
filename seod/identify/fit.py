"""Least squares of the simulated output to recordings, several jointly, each with its own noise.

Searched are the logarithms of omega_n and zeta, the delay, and K_L; what a recording's start and an offset
add is projected out (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.optimize import least_squares

from seod.estimate.noise import outliers
from seod.estimate.plant_response import Dynamics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.limit_cycle import Array
    from seod.identify.record import Record

NAMES: Final = ("omega_n", "zeta", "delay", "K_L")
ZETAS: Final = (0.1, 0.4, 1.2)
"""Where the search begins, with omega_n from `_FREQUENCIES` values."""
ZETA_RANGE: Final = (1e-3, 30.0)
_FREQUENCIES: Final = 12
_BATCHES: Final = 30
"""Pieces of a recording whose scatter tells how the residual is correlated, at least."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The plant that simulates the recordings best.

    Attributes:
        value: omega_n [rad/s], zeta, delay [s], K_L [unit/s/V].
        covariance: Of the four in that order, shape (4, 4); zero where given beforehand.
        nrmse: What the simulation leaves of the recordings (rms error / standard deviation).
        noise: Standard deviation of each recording's residual.
        residual: Of each recording.
        white: Each residual's neighbours are independent: what is left looks like noise.
        cost: Sum of squares in the noise's measure.
        rejected: Samples left out as outliers.
    """

    value: dict[str, float]
    covariance: Array
    nrmse: float
    noise: tuple[float, ...]
    residual: tuple[Array, ...]
    white: bool
    cost: float
    rejected: int

    @property
    def sd(self) -> dict[str, float]:
        """Standard deviations by name; 0 where given beforehand."""
        return dict(zip(NAMES, np.sqrt(self.covariance.diagonal()).tolist(), strict=True))

    @property
    def plant(self) -> Dynamics:
        """What is not linear."""
        return Dynamics(self.value["omega_n"], self.value["zeta"], self.value["delay"])


@dataclass(frozen=True, slots=True)
class Given:
    """What is not estimated: None is free."""

    K_L: float | None = None
    delay: float | None = None
    zeta: float | None = None


class Problem:
    """Recordings, weights and what is given."""

    def __init__(self, records: Sequence[Record], given: Given) -> None:
        self.records, self.given = records, given
        self.weights = [1.0 / max(float(np.std(record.y)), 1e-300) for record in records]
        self.kept = [np.ones(len(record.y), np.bool_) for record in records]
        fixed = {"zeta": given.zeta, "delay": given.delay, "K_L": given.K_L}
        self.free = [name for name in NAMES if fixed.get(name) is None]

    def freed(self, plant: Dynamics) -> tuple[Array, Array]:
        """All weighted responses and samples, outliers as zeros, end to end."""
        pairs = [record.freed(plant) for record in self.records]
        scale = zip(self.weights, self.kept, strict=True)
        scaled = [(w * k * r, w * k * y) for (w, k), (r, y) in zip(scale, pairs, strict=True)]
        return np.concatenate([r for r, _ in scaled]), np.concatenate([y for _, y in scaled])

    def gain(self, plant: Dynamics) -> tuple[float, float]:
        """The best K_L, and the sum of squares that it leaves."""
        response, y = self.freed(plant)
        K_L = self.given.K_L
        if K_L is None:
            K_L = float(response @ y) / max(float(response @ response), 1e-300)
        left = y - K_L * response
        return K_L, float(left @ left)

    def values(self, theta: Array) -> dict[str, float]:
        """By name, of the free unknowns as they are searched: logarithms of omega_n and zeta."""
        found = dict(zip(self.free, theta.tolist(), strict=True))
        given = self.given
        zeta = math.exp(found["zeta"]) if given.zeta is None else given.zeta
        delay = found["delay"] if given.delay is None else given.delay
        K_L = found["K_L"] if given.K_L is None else given.K_L
        return {"omega_n": math.exp(found["omega_n"]), "zeta": zeta, "delay": delay, "K_L": K_L}

    def residual(self, theta: Array) -> Array:
        """Weighted, of all recordings end to end."""
        value = self.values(theta)
        response, y = self.freed(Dynamics(value["omega_n"], value["zeta"], value["delay"]))
        return np.asarray(y - value["K_L"] * response)

    def theta(self, plant: Dynamics) -> Array:
        """The search's own coordinates."""
        every = {
            "omega_n": math.log(plant.omega_n),
            "zeta": math.log(plant.zeta),
            "delay": plant.delay,
            "K_L": self.gain(plant)[0],
        }
        return np.array([every[name] for name in self.free])

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest of the searched unknowns."""
        tick = max(record.tick for record in self.records)
        span = max(float(record.since[-1]) for record in self.records)
        ends = {
            "omega_n": (math.log(0.05 / span), math.log(30.0 / tick)),
            "zeta": (math.log(ZETA_RANGE[0]), math.log(ZETA_RANGE[1])),
            "delay": (-2.0 * tick, 0.1 * span),
            "K_L": (-np.inf, np.inf),
        }
        low, high = zip(*(ends[name] for name in self.free), strict=True)
        return np.array(low), np.array(high)

    def starts(self) -> list[Dynamics]:
        """The two best plants of a coarse grid."""
        tick = max(record.tick for record in self.records)
        span = max(float(record.since[-1]) for record in self.records)
        zetas = ZETAS if self.given.zeta is None else (self.given.zeta,)
        grid = [
            Dynamics(omega_n, zeta, self.given.delay or 0.0)
            for omega_n in np.geomspace(10.0 / span, 1.0 / tick, _FREQUENCIES).tolist()
            for zeta in zetas
        ]
        return sorted(grid, key=lambda plant: self.gain(plant)[1])[:2]


def fit(records: Sequence[Record], given: Given, start: Dynamics | None = None) -> Fit:
    """The most likely plant; noise of each recording estimated, outliers left out.

    Args:
        records: At least one.
        given: What is known for certain.
        start: Where to search from; None: a coarse grid.
    """
    problem = Problem(records, given)
    begins = [start] if start is not None else problem.starts()
    answer = min((_search(problem, problem.theta(each)) for each in begins), key=lambda a: float(a.cost))
    for _ in range(2):
        if not _reweigh(problem, answer.fun):
            break
        answer = _search(problem, answer.x)
    return _judged(problem, answer)


def _search(problem: Problem, theta: Array) -> Any:
    low, high = problem.bounds()
    inside = np.clip(theta, np.nextafter(low, high), np.nextafter(high, low))
    return least_squares(
        problem.residual, inside, jac="3-point", bounds=(low, high), x_scale="jac", xtol=1e-10, ftol=1e-10
    )


def _reweigh(problem: Problem, residual: Array) -> bool:
    """Weigh each recording by its own noise, leave outliers out; whether that changes the answer."""
    changed = len(problem.records) > 1
    at = 0
    for k, record in enumerate(problem.records):
        own = residual[at : at + len(record.y)] / problem.weights[k]
        at += len(record.y)
        far = outliers(own[problem.kept[k]])
        if far.any():
            problem.kept[k][np.flatnonzero(problem.kept[k])[far]] = False
            changed = True
        problem.weights[k] = 1.0 / max(float(np.std(own[problem.kept[k]])), 1e-12 * float(np.std(record.y)))
    return changed


def _judged(problem: Problem, answer: Any) -> Fit:
    value = problem.values(answer.x)
    plant = Dynamics(value["omega_n"], value["zeta"], value["delay"])
    own = []
    for record in problem.records:
        response, y = record.freed(plant)
        own.append(y - value["K_L"] * response)
    kept = [left[keep] for left, keep in zip(own, problem.kept, strict=True)]
    spread = sum(float(np.var(r.y[keep])) for r, keep in zip(problem.records, problem.kept, strict=True))
    correlated, times = _covariance(problem, answer)
    scale = np.array(
        [{"omega_n": value["omega_n"], "zeta": value["zeta"]}.get(name, 1.0) for name in problem.free]
    )
    covariance = np.zeros((4, 4))
    places = [NAMES.index(name) for name in problem.free]
    covariance[np.ix_(places, places)] = correlated * np.outer(scale, scale)
    return Fit(
        value=value,
        covariance=covariance,
        nrmse=math.sqrt(sum(float(np.var(left)) for left in kept) / spread),
        noise=tuple(float(np.std(left)) for left in kept),
        residual=tuple(own),
        white=max(times) < 2.0,
        cost=2.0 * float(answer.cost),
        rejected=sum(int(np.count_nonzero(~keep)) for keep in problem.kept),
    )


def _covariance(problem: Problem, answer: Any) -> tuple[Array, list[float]]:
    """Of the searched unknowns, and each residual's correlation time in samples.

    A correlated residual, as a wrong model leaves it, counts by batches: the scatter of the gradient's sums
    over pieces much longer than its correlation (a sandwich of batch means).
    """
    jacobian, residual = answer.jac, answer.fun
    count, unknowns = jacobian.shape
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    variance = float(residual @ residual) / max(count - unknowns - 4 * len(problem.records), 1)
    plain = variance * inverse
    spread, times, at = np.zeros((unknowns, unknowns)), [], 0
    for record in problem.records:
        piece = slice(at, at + len(record.y))
        at += len(record.y)
        times.append(correlation_time(residual[piece]))
        length = max(1, min(int(5.0 * times[-1]), len(record.y) // _BATCHES))
        starts = np.arange(0, len(record.y), length)
        sums = np.add.reduceat(scaled[piece] * residual[piece, None], starts, axis=0)
        spread += sums.T @ sums
    wide = plain if max(times) < 2.0 else inverse @ spread @ inverse
    grown = np.sqrt(np.maximum(1.0, wide.diagonal() / np.maximum(plain.diagonal(), 1e-300)))
    out = plain * np.outer(grown, grown) if (grown > 1.0).any() else plain
    return out / np.outer(size, size), times


def correlation_time(residual: Array) -> float:
    """Sum of the autocorrelation up to where it first vanishes [samples]; about 1 for white noise."""
    n = len(residual)
    power = float(residual @ residual)
    if power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(residual, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: n // 2] / power
    below = np.flatnonzero(correlation < 2.0 / math.sqrt(n))
    end = int(below[0]) if len(below) else len(correlation)
    return float(1.0 + 2.0 * np.sum(correlation[1:end]))
