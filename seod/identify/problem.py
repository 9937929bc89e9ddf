"""What is searched for, and the weighted residual of all recordings with its derivatives.

Searched are the logarithms of omega_n and zeta, the delay, and K_L; what a recording's start and an offset
add is projected out (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.estimate.plant.free_motion import Dynamics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.arrays import Array
    from seod.identify.record import Record

NAMES: Final = ("omega_n", "zeta", "delay", "K_L")
ZETAS: Final = (0.1, 0.4, 1.2)
"""Where the search begins, with omega_n from `_FREQUENCIES` values."""
ZETA_RANGE: Final = (1e-3, 30.0)
_FREQUENCIES: Final = 12
_STEP: Final = 1e-6
"""Of the derivatives, relative; the delay's relative to 1 / omega_n."""


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
        response, y = self.freed(plant_of(value))
        return np.asarray(y - value["K_L"] * response)

    def slopes(self, theta: Array) -> Array:
        """Of the residual by each free unknown, shape (n, unknowns)."""
        here, value = self.residual(theta), self.values(theta)
        steps = {"omega_n": _STEP, "zeta": _STEP, "delay": _STEP / value["omega_n"]}
        columns = []
        for k, name in enumerate(self.free):
            if name == "K_L":
                columns.append(-self.freed(plant_of(value))[0])
                continue
            moved = theta.copy()
            moved[k] += steps[name]
            columns.append((self.residual(moved) - here) / (moved[k] - theta[k]))
        return np.stack(columns, axis=1)

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
        tick, span = self._times()
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
        tick, span = self._times()
        zetas = ZETAS if self.given.zeta is None else (self.given.zeta,)
        grid = [
            Dynamics(omega_n, zeta, self.given.delay or 0.0)
            for omega_n in np.geomspace(10.0 / span, 1.0 / tick, _FREQUENCIES).tolist()
            for zeta in zetas
        ]
        return sorted(grid, key=lambda plant: self.gain(plant)[1])[:2]

    def _times(self) -> tuple[float, float]:
        """Longest interval and length of the recordings [s]."""
        return max(record.tick for record in self.records), max(record.span for record in self.records)


def plant_of(value: dict[str, float]) -> Dynamics:
    """Without the gain."""
    return Dynamics(value["omega_n"], value["zeta"], value["delay"])
