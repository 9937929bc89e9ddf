"""Whether a record is a fair test: the load moves, a relay follows it, and each effect is to be seen.

A load that is stuck in most of the record, and a relay that switches on the noise, test nothing but stuck
rigs. An effect beside another one counts by what the plant with that other one alone leaves, and an effect
that is on no list by what the plant with the best listed one leaves, refitted: what they can imitate nobody
can tell. The refits run the actuator of `hidden_plant` over the commands of the record; states of windows and
a constant bias are taken out as in `hidden_baseline`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hidden_baseline import THIN, Windows, discrete, free_modes
from hidden_rig import GIVEN, Drive, Rig, simulate
from hidden_strength import drawn, effects_of, sizes
from scipy.optimize import least_squares
from scipy.signal import detrend, lfilter

PARTS = 20
"""Of a record, in most of which the load has to move."""
MOVING = 0.75
"""Least part of them that do."""
OVER_NOISE = 5.0
"""Deviation of a part in which the load moves, over the noise."""
CHATTER = 1.5
"""Switches of a relay over those without noise, at most."""
STRENGTH = 0.15
"""From which a listed effect is refitted to one off the list."""
TRIED_S = 3.0
"""Of a record, for that."""
NOT_FITTED = {"sensor_quantization", "held_readings"}
"""Its rounding changes by jumps."""
SIGNED = {"ratio", "acceleration", "K_L", "omega_n", "zeta", "phase", "centre"}
SIGNED |= {"lever_at", "parabola", *(f"order_{n}" for n in range(2, 7))}


def moves(y, noise: float) -> bool:
    """Whether the load moves in most of the record: deviation from a straight line in each of its parts."""
    spread = np.array([np.std(detrend(part)) for part in np.array_split(y, PARTS)])
    return bool(np.mean(spread > OVER_NOISE * noise) >= MOVING)


def chatters(u, quiet) -> bool:
    """Whether a relay's command switches on the noise instead of the movement; `quiet` is without noise."""
    return bool(np.count_nonzero(np.diff(u)) > CHATTER * np.count_nonzero(np.diff(quiet)) + 5)


class Refit:
    """The plant with some effects, brought as near to a record as it will come."""

    def __init__(self, rig: Rig, effects, y, u, t, *, supply=None, latency=0.0):
        self.rig, self.u, self.t = rig, u, t
        self.supply, self.latency = supply, latency
        self.windows = Windows(y, u, float(t[1] - t[0]), sees_speed=rig.sees_speed, bias=False)
        self.y, self.bias = y, "load_bias" not in effects
        self.effects = effects
        self.places = [
            (name, of) for name, group in effects.items() if name not in NOT_FITTED for of in group
        ]

    def at(self, x) -> Rig:
        """The rig at the searched numbers: logarithms of factors, of what has a sign what is added to 1."""
        K_L, omega_n, zeta = np.array([self.rig.K_L, self.rig.omega_n, self.rig.zeta]) * np.exp(x[:3])
        effects = {name: dict(group) for name, group in self.effects.items()}
        for (name, of), step in zip(self.places, x[3:], strict=True):
            effects[name][of] *= (1.0 + step) if of in SIGNED or name == "parameter_drift" else np.exp(step)
        return replace(self.rig, K_L=K_L, omega_n=omega_n, zeta=zeta, effects=effects)

    def residual(self, x):
        rig = self.at(np.clip(x, -4.0, 4.0))
        simulated, _ = simulate(rig, self.t, Drive(GIVEN, self.u), None, self.supply, None, self.latency)
        windows, tick = self.windows, self.windows.tick
        modes = free_modes(rig.omega_n, rig.zeta, windows.y.shape[1], THIN * tick, rig.sees_speed)

        def freed(rows):
            return (rows - (rows @ modes) @ modes.T).ravel()

        left = freed(windows.cut(np.clip(np.nan_to_num(self.y - simulated, nan=1e9), -1e9, 1e9)))
        if self.bias:
            filtered = lfilter(*discrete(rig.omega_n, rig.zeta, tick, rig.sees_speed), np.ones_like(self.y))
            slope = freed(windows.cut(filtered))
            left = left - slope * (slope @ left) / max(slope @ slope, 1e-300)
        return left

    def left(self, tries: int = 8) -> float:
        """The rms that the best refit leaves."""
        scale = float(np.std(self.windows.y)) or 1.0
        start = np.zeros(3 + len(self.places))
        found = least_squares(
            lambda x: self.residual(x) / scale, start, x_scale=0.5, diff_step=1e-4, max_nfev=tries
        )
        return float(np.sqrt(np.mean(self.residual(found.x) ** 2)))


def left_beside(rig: Rig, cause: str, y, u, t, **given) -> float:
    """The rms that the plant with all effects but this cause's leaves."""
    rest = {name: group for name, group in rig.effects.items() if name != cause}
    return Refit(rig, rest, y, u, t, **given).left()


def left_by_list(rig: Rig, listed, y, u, t, enough: float = 0.0, **given) -> float:
    """The least rms that the plant with one listed effect leaves, in the record's first seconds.

    Below `enough` that of the first effect which leaves so little.
    """
    rows = t < TRIED_S
    y, u, t = y[rows], u[rows], t[rows]
    z = sizes(y, u, float(t[1] - t[0]), sees_speed=rig.sees_speed)
    about = drawn("", np.random.default_rng(1))
    tried = [{}]
    for cause in set(listed) - NOT_FITTED - {"pressure_dependent_stiffness"}:
        effects = effects_of(cause, STRENGTH, about, z, rig.omega_n, float(t[-1]))
        if cause == "load_spring":
            effects[cause]["centre"] = float(np.mean(y))
        if cause == "sensor_nonlinearity":
            parts = {f"order_{n}": 0.1 * STRENGTH * z.span for n in range(2, 7)}
            effects[cause] = parts | {"centre": 0.5 * float(np.max(y) + np.min(y)), "half": 0.5 * z.span}
        tried.append(effects)
    least = math.inf
    for effects in tried:
        least = min(least, Refit(rig, effects, y, u, t, **given).left(6))
        if least < enough:
            break
    return least
