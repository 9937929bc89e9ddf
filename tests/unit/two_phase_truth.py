"""Two-phase excitation by other means than those under test: each motion by the matrix exponential."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from seod.estimate.base import EstimatorSettings, Row

K_L, E_A, TICK = 17.0, 0.5, 5e-4
PLANTS = [(0.21, 117.0), (0.45, 145.0), (0.8, 60.0)]


def amplitude_of(zeta: float, omega_n: float) -> float:
    """Roughly that of the first phase."""
    return 1.28 * K_L * E_A / (2.0 * zeta * omega_n)


@dataclass(frozen=True)
class Alternation:
    """A sampled relay that is late by `shift` first periods in every other `cycles` cycles."""

    zeta: float
    omega_n: float
    shift: float = 0.25
    cycles: int = 3
    delay: float = TICK
    """From a command's leaving to the plant [s]."""
    noise: float = 0.0
    """Standard deviation, as a part of the first phase's amplitude."""
    seed: int = 1


class _Plant:
    """Eq. 1, by which positions are exact at any time."""

    def __init__(self, omega_n: float, zeta: float) -> None:
        self.a = np.eye(4, k=1)
        self.a[2, 1:] = -(omega_n**2), -2.0 * zeta * omega_n, K_L * omega_n**2
        self.state, self.t = np.zeros(4), 0.0
        self.kept: dict[int, np.ndarray] = {}

    def go(self, t: float) -> None:
        step = round((t - self.t) * 1e12)
        if step > 0:
            if step not in self.kept:
                self.kept[step] = expm(self.a * step * 1e-12)
            self.state, self.t = self.kept[step] @ self.state, t


def motion(loop: Alternation, seconds: float) -> list[tuple[float, float, float, bool]]:
    """Time, position, voltage that leaves and whether the second phase is on, at each tick."""
    plant = _Plant(loop.omega_n, loop.zeta)
    noise = np.random.default_rng(loop.seed).standard_normal(round(seconds / TICK))
    noise *= loop.noise * amplitude_of(loop.zeta, loop.omega_n)
    asked, volts, late, due = 1.0, E_A, 0.0, 0.0
    ups: list[int] = []
    under_way: list[tuple[float, float]] = [(loop.delay, E_A)]
    out = []
    for k, error in enumerate(noise):
        t = k * TICK
        while under_way and under_way[0][0] <= t:
            when, level = under_way.pop(0)
            plant.go(when)
            plant.state[3] = level
        plant.go(t)
        y = float(plant.state[0] + error)
        if y * asked > 0.0:
            asked = -asked
            if asked > 0.0:
                ups.append(k)
                if len(ups) % loop.cycles == 0:
                    late = 0.0 if late else loop.shift * TICK * (ups[-1] - ups[-2])
            due = t + late
        if t >= due - 1e-9 and volts != E_A * asked:
            volts = E_A * asked
            under_way.append((t + loop.delay, volts))
        out.append((t, y, volts, late > 0.0))
    return out


@lru_cache(maxsize=64)
def rows(loop: Alternation, seconds: float) -> list[Row]:
    """As the gateway would hand them to an estimator; `u` leaves in its tick."""
    return [
        Row(t, y, u, t, 0.0, E_A, 0.0, exciting=True, K_L=np.nan, second=second)
        for t, y, u, second in motion(loop, seconds)
    ]


def settings(method: str = "wave", **changes: object) -> EstimatorSettings:
    """Of an axis with two-phase excitation, of whose gain nothing is known."""
    known = {"method": method, "K_L": 5.0, "hysteresis": 0.0, "delay_s": 0.0, "period_s": TICK}
    more = {"cycles": 6, "lowpass_hz": None, "K_L_sd": np.inf, "delay_sd": np.inf}
    return EstimatorSettings(**(known | more | changes))
