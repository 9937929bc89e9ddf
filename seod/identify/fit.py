"""Least squares of the simulated output to recordings, several jointly, each with its own noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.optimize import least_squares

from seod.estimate.noise import outliers
from seod.identify.problem import NAMES, Given, Problem, plant_of
from seod.identify.spread import WHITE, correlation_time, covariance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.arrays import Array
    from seod.estimate.plant.free_motion import Dynamics
    from seod.identify.record import Record

_ROUGH: Final = 10_000
"""Samples of each recording with which the search begins: all of them have the last word only."""
_MOST_STEPS: Final = 100


@dataclass(frozen=True, slots=True)
class Fit:
    """The plant that simulates the recordings best.

    Attributes:
        value: omega_n [rad/s], zeta, delay [s], K_L [unit/s/V].
        covariance: Of the four in that order, shape (4, 4); zero where given beforehand.
        nrmse: What the simulation leaves of the recordings (rms error / standard deviation).
        noise: Effective value of each recording's residual.
        residual: Of each recording.
        white: Each residual's neighbours are independent: what is left looks like noise.
        rejected: Samples left out as outliers.
    """

    value: dict[str, float]
    covariance: Array
    nrmse: float
    noise: tuple[float, ...]
    residual: tuple[Array, ...]
    white: bool
    rejected: int

    @property
    def sd(self) -> dict[str, float]:
        """Standard deviations by name; 0 where given beforehand."""
        return dict(zip(NAMES, np.sqrt(self.covariance.diagonal()).tolist(), strict=True))

    @property
    def plant(self) -> Dynamics:
        """What is not linear."""
        return plant_of(self.value)


def fit(records: Sequence[Record], given: Given, start: Dynamics | None = None) -> Fit:
    """The most likely plant; noise of each recording estimated, outliers left out.

    Args:
        records: At least one.
        given: What is known for certain.
        start: Where to search from; None: a coarse grid.
    """
    rough = Problem([record.thinned(_ROUGH) for record in records], given)
    begins = [start] if start is not None else rough.starts()
    found = min((_search(rough, rough.theta(each)) for each in begins), key=lambda a: float(a.cost))
    problem = Problem(records, given)
    answer = _search(problem, found.x)
    for _ in range(2):
        if not _reweigh(problem, answer.fun):
            break
        answer = _search(problem, answer.x)
    return _judged(problem, answer)


def _search(problem: Problem, theta: Array) -> Any:
    low, high = problem.bounds()
    inside = np.clip(theta, np.nextafter(low, high), np.nextafter(high, low))
    return least_squares(
        problem.residual,
        inside,
        jac=problem.slopes,
        bounds=(low, high),
        x_scale="jac",
        xtol=1e-9,
        ftol=1e-12,
        max_nfev=_MOST_STEPS,
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
    correlated, times = covariance(problem, answer)
    scale = np.array([value[name] if name in {"omega_n", "zeta"} else 1.0 for name in problem.free])
    table = np.zeros((4, 4))
    places = [NAMES.index(name) for name in problem.free]
    table[np.ix_(places, places)] = correlated * np.outer(scale, scale)
    return _left_by(problem, value, table, times)


def at(records: Sequence[Record], value: dict[str, float], table: Array) -> Fit:
    """What a plant that was found elsewhere, with its covariance, leaves of the recordings."""
    problem = Problem(records, Given())
    own = _residuals(problem, value)
    return _left_by(problem, value, table, [correlation_time(left) for left in own])


def _residuals(problem: Problem, value: dict[str, float]) -> list[Array]:
    pairs = [record.freed(plant_of(value)) for record in problem.records]
    return [y - value["K_L"] * response for response, y in pairs]


def _left_by(problem: Problem, value: dict[str, float], table: Array, times: Sequence[float]) -> Fit:
    own = _residuals(problem, value)
    kept = [left[keep] for left, keep in zip(own, problem.kept, strict=True)]
    motion = [record.y[keep] for record, keep in zip(problem.records, problem.kept, strict=True)]
    left = sum(float(e @ e) for e in kept)
    return Fit(
        value=value,
        covariance=table,
        nrmse=math.sqrt(left / sum(len(y) * float(np.var(y)) for y in motion)),
        noise=tuple(math.sqrt(float(e @ e) / len(e)) for e in kept),
        residual=tuple(own),
        white=max(times) < WHITE,
        rejected=sum(int(np.count_nonzero(~keep)) for keep in problem.kept),
    )
