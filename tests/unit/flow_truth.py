"""An actuator whose valve's flow follows the square root of the pressure drop, written apart: RK4, no kernel.

    v' = p,  p' = omega_n^2 (flow - v) - 2 zeta omega_n p,  flow = K_L u root(1 - sgn(u) p / supply)

`p` is the load's acceleration that the pressure makes [unit/s^2], `supply` that of all the supply pressure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

TICK = 5e-4
SUBSTEPS = 4


class Actuator(NamedTuple):
    K_L: float
    omega_n: float
    zeta: float
    supply: float


def slopes(a: Actuator, u: float, v: float, p: float) -> tuple[float, float, float]:
    drop = 1.0 - math.copysign(p, p * u) / a.supply if p and u else 1.0
    flow = a.K_L * u * math.copysign(math.sqrt(abs(drop)), drop)
    return v, p, a.omega_n**2 * (flow - v) - 2.0 * a.zeta * a.omega_n * p


def step(a: Actuator, state: tuple[float, float, float], u: float) -> tuple[float, float, float]:
    """One tick under a voltage that holds."""
    h = TICK / SUBSTEPS
    x, v, p = state
    for _ in range(SUBSTEPS):
        k1 = slopes(a, u, v, p)
        k2 = slopes(a, u, v + 0.5 * h * k1[1], p + 0.5 * h * k1[2])
        k3 = slopes(a, u, v + 0.5 * h * k2[1], p + 0.5 * h * k2[2])
        k4 = slopes(a, u, v + h * k3[1], p + h * k3[2])
        x, v, p = (
            s + h / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4)
            for s, d1, d2, d3, d4 in zip((x, v, p), k1, k2, k3, k4, strict=True)
        )
    return x, v, p


def relay_run(a: Actuator, e_a: float, seconds: float, noise: float = 0.0, seed: int = 1):
    """t, u, y of a sampled relay on the position; a voltage leaves at its own sample's time."""
    random = np.random.default_rng(seed)
    n = round(seconds / TICK)
    u, y, state = np.empty(n), np.empty(n), (0.0, 0.0, 0.0)
    for k in range(n):
        y[k] = state[0] + (random.normal(0.0, noise) if noise else 0.0)
        u[k] = -e_a if y[k] > 0.0 else e_a
        state = step(a, state, u[k])
    return np.arange(n) * TICK, u, y


def driven(a: Actuator, u: np.ndarray, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """The position under given voltages, one a tick."""
    random = np.random.default_rng(seed)
    y, state = np.empty(len(u)), (0.0, 0.0, 0.0)
    for k, volts in enumerate(u.tolist()):
        y[k] = state[0] + (random.normal(0.0, noise) if noise else 0.0)
        state = step(a, state, volts)
    return y
