"""A sampled relay on Eq. 1 with delays that nobody tells, by matrix exponentials; bounds by differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH

K_L, E_A, TICK = 17.0, 0.5, 5e-4
LEAVES = 0.3
"""Ticks from a sample to its command's leaving; `t_u` tells them."""
PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0))
HYSTERESIS = 0.02
"""Half-width, as a part of the amplitude."""
NAN = math.nan
STEPS = {
    "omega_n": 1e-4,
    "zeta": 1e-4,
    "delay": 1e-2 * TICK,
    "position": 1e-4,
    "speed": 1e-2,
    "acceleration": 1.0,
    "load": 1e-4,
}
"""Of the bound's differences: parts of omega_n and zeta, [s], [rad], [rad/s], [rad/s^2], [V]."""


class Rig(NamedTuple):
    """What is true.

    Attributes:
        zeta: Damping ratio.
        omega_n: [rad/s].
        latency: That nobody tells, from a command's leaving to the plant [ticks].
        noise: White, standard deviation as a part of the amplitude.
        late: Most by which a single command may come later still [ticks], uniform.
        scatter: Of the samples' stamps, standard deviation [ticks].
    """

    zeta: float
    omega_n: float
    latency: float
    noise: float
    late: float = 0.0
    scatter: float = 0.0

    @property
    def amplitude(self) -> float:
        """About that of the limit cycle [rad]."""
        return 1.28 * K_L * E_A / (2.0 * self.zeta * self.omega_n)


@dataclass(frozen=True)
class Record:
    """One excitation, arrays of shape (n,): stamps, readings, voltages, when these left; and true states."""

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    t_u: np.ndarray
    states: np.ndarray
    """Position, speed, acceleration and voltage in force at each tick, shape (n, 4)."""

    def rows(self) -> list[tuple[float | int, ...]]:
        """As the loop writes them."""
        columns = (self.t, self.y, self.u, self.t_u)
        flags = FLAG_EXCITING | FLAG_FRESH
        return [
            (t, y, 0.0, u, t_u, E_A, 0.0, -y, NAN, NAN, K_L, 3, flags)
            for t, y, u, t_u in zip(*(column.tolist() for column in columns), strict=True)
        ]


@cache
def _move(zeta: float, omega_n: float, nanoseconds: int) -> np.ndarray:
    a = np.zeros((4, 4))
    a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(omega_n**2), -2 * zeta * omega_n, K_L * omega_n**2]]
    return np.asarray(expm(a * nanoseconds * 1e-9)[:3])


class Plant:
    """Position, velocity and acceleration, from rest beside the set point."""

    def __init__(self, rig: Rig, place: float) -> None:
        self._rig, self._x = rig, np.array([place, 0.0, 0.0, 0.0])

    def go(self, seconds: float) -> None:
        nanoseconds = round(seconds * 1e9)
        if nanoseconds:
            self._x[:3] = _move(self._rig.zeta, self._rig.omega_n, nanoseconds) @ self._x

    def hear(self, volts: float) -> None:
        self._x[3] = volts

    @property
    def state(self) -> np.ndarray:
        return self._x.copy()


def record(rig: Rig, seconds: float, seed: tuple[int, ...]) -> Record:
    """One excitation; the seed makes it again."""
    rng, count = np.random.default_rng(seed), int(seconds / TICK)
    noise = rig.noise * rig.amplitude * rng.standard_normal(count)
    late = rig.late * rng.random(count)
    stamps = TICK * (np.arange(count) + rig.scatter * np.clip(rng.standard_normal(count), -3.0, 3.0))
    plant = Plant(rig, 0.2 * rig.amplitude * rng.uniform(-1.0, 1.0))
    u, under_way, y, volts, states = E_A, [], np.empty(count), np.empty(count), np.empty((count, 4))
    for k in range(count):
        states[k] = plant.state
        y[k] = states[k, 0] + noise[k]
        if abs(y[k]) > HYSTERESIS * rig.amplitude:
            u = -math.copysign(E_A, y[k])
        if k == 0 or u != volts[k - 1]:
            under_way.append((k + LEAVES + rig.latency + late[k], u))
        volts[k] = u
        now = float(k)
        while under_way and under_way[0][0] < k + 1:
            when, value = under_way.pop(0)
            when = max(when, now)
            plant.go((when - now) * TICK)
            plant.hear(value)
            now = when
        plant.go((k + 1 - now) * TICK)
    return Record(stamps, y, volts, TICK * (np.arange(count) + LEAVES), states)


class Bound(NamedTuple):
    """Cramer and Rao's of one window, parts of omega_n and zeta.

    Attributes:
        told: Standard deviations where the delay is known.
        untold: Where it is not.
        by_delay: Change of both with the delay [1/s].
        delay: Standard deviation of the delay [s].
    """

    told: np.ndarray
    untold: np.ndarray
    by_delay: np.ndarray
    delay: float


def bound(rig: Rig, kept: Record, begin: float, end: float) -> Bound:
    """By differences of the plant under the voltages of a window, its initial state and a load unknown."""
    ticks = np.arange(round(begin / TICK), round(end / TICK) + 1)
    slopes = [
        (_course(rig, kept, ticks, **{name: off}) - _course(rig, kept, ticks, **{name: -off})) / (2.0 * off)
        for name, off in STEPS.items()
    ]
    slope = np.stack(slopes) / (rig.noise * rig.amplitude)
    untold, known = _covariance(slope), _covariance(np.delete(slope, 2, axis=0))
    sd = math.sqrt(untold[2, 2])
    return Bound(
        np.sqrt(known.diagonal()[:2]), np.sqrt(untold.diagonal()[:2]), untold[:2, 2] / untold[2, 2], sd
    )


def _covariance(slope: np.ndarray) -> np.ndarray:
    information = slope @ slope.T
    scale = 1.0 / np.sqrt(information.diagonal())
    return np.asarray(np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale))


def _course(rig: Rig, kept: Record, ticks: np.ndarray, **off: float) -> np.ndarray:
    """Positions at these ticks of a plant that is somewhat off from the first of them on."""
    omega_n, zeta = (getattr(rig, name) * math.exp(off.get(name, 0.0)) for name in ("omega_n", "zeta"))
    switched = np.flatnonzero(np.diff(kept.u)) + 1
    arrives = kept.t_u[switched] + rig.latency * TICK
    t, x = TICK * ticks, kept.states[ticks[0]].copy()
    coming = (arrives > t[0]) & (arrives <= t[-1])
    events = list(
        zip((arrives[coming] + off.get("delay", 0.0)).tolist(), kept.u[switched[coming]], strict=True)
    )
    x[:3] += [off.get(name, 0.0) for name in ("position", "speed", "acceleration")]
    load = np.array([0.0, 0.0, 0.0, off.get("load", 0.0)])
    a, y, now = _matrix(zeta, omega_n), np.empty(len(t)), float(t[0])
    tick = expm(a * TICK)[:3]
    for k, at in enumerate(t.tolist()):
        moved = False
        while events and events[0][0] <= at:
            when, value = events.pop(0)
            x[:3] = expm(a * (when - now))[:3] @ (x - load)
            x[3], now, moved = value, when, True
        if at > now:
            x[:3] = (expm(a * (at - now))[:3] if moved else tick) @ (x - load)
        y[k], now = x[0], at
    return y


def _matrix(zeta: float, omega_n: float) -> np.ndarray:
    a = np.zeros((4, 4))
    a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -(omega_n**2), -2 * zeta * omega_n, K_L * omega_n**2]]
    return a
