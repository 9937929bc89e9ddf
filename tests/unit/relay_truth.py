"""Relay limit cycles made by other means than the closed forms under test: an ODE solver, a sampled loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from seod.estimate.base import EstimatorSettings, Row
from seod.estimate.limit_cycle.inversion import Measured

K_L = 17.0
E_A = 0.5
TICK = 5e-4
PLANTS = [(0.21, 117.0), (0.45, 145.0), (0.8, 60.0)]


def amplitude_of(zeta: float, omega_n: float) -> float:
    """Roughly the limit cycle's amplitude, for scaling noise and hysteresis."""
    return 1.28 * K_L * E_A / (2.0 * zeta * omega_n)


@lru_cache
def ideal_relay(
    zeta: float, omega_n: float, lag=(0.0, 0.0), hysteresis: float = 0.0, load: float = 0.0, cycles: int = 12
) -> Measured:
    """Integrate the plant of Eq. 1 under a relay that acts `lag` after each crossing; its last cycle."""
    state, t, up = np.array([-0.1 * amplitude_of(zeta, omega_n), 0.0, 0.0]), 0.0, True
    switches, extremes = [], []
    for _ in range(2 * cycles):

        def slope(_t, s, drive=(E_A if up else -E_A) - load):
            return [s[1], s[2], omega_n**2 * (K_L * drive - s[1]) - 2.0 * zeta * omega_n * s[2]]

        def crosses(_t, s, level=hysteresis if up else -hysteresis):
            return s[0] - level

        def stands(_t, s):
            return s[1]

        crosses.terminal, crosses.direction = True, 1.0 if up else -1.0
        options = {"rtol": 1e-9, "atol": 1e-12, "events": (crosses, stands), "method": "DOP853"}
        run = solve_ivp(slope, (t, t + 100.0 / omega_n), state, first_step=1e-3 / omega_n, **options)
        t, state, still = run.t[-1], run.y[:, -1], list(np.reshape(run.y_events[1], (-1, 3))[:, 0])
        wait = lag[1] if up else lag[0]
        if wait:
            crosses.terminal = False
            run = solve_ivp(slope, (t, t + wait), state, **options)
            t, state = run.t[-1], run.y[:, -1]
            still += list(np.reshape(run.y_events[1], (-1, 3))[:, 0])
        switches.append(t)
        extremes.append(min(still, default=0.0) if up else max(still, default=0.0))
        up = not up
    # the last switch turns the relay up: before it the relay was down, before that up
    h_down, h_up = switches[-1] - switches[-2], switches[-2] - switches[-3]
    return Measured(h_up, h_down, lag[0], lag[1], 0.5 * (extremes[-1] - extremes[-2]))


@dataclass(frozen=True)
class Loop:
    """A sampled relay on the plant of Eq. 1: each tick reads, decides, and acts `delay` ticks later."""

    zeta: float
    omega_n: float
    delay: float = 1.0
    noise: float = 0.0
    """Standard deviation, as a part of the amplitude; likewise `hysteresis` and `start`."""
    hysteresis: float = 0.0
    start: float = 0.0
    load: float = 0.0
    tick: float = TICK
    jitter: float = 0.0
    loss: float = 0.0
    clip: float = np.inf
    step: float = 0.0
    friction: bool = False
    seed: int = 1


@lru_cache(maxsize=256)
def rows(loop: Loop, seconds: float) -> list[Row]:
    """Run the loop; positions are exact between ticks (matrix exponential)."""
    rng = np.random.default_rng(loop.seed)
    scale = amplitude_of(loop.zeta, loop.omega_n)
    count = int(seconds / loop.tick)
    times = 50.0 + loop.tick * (np.arange(count) + loop.jitter * rng.integers(-8, 9, count) / 16)
    noise = rng.standard_normal(count) * loop.noise * scale
    lost = rng.random(count) < loss if (loss := loop.loss) else np.zeros(count, bool)
    state = np.array([loop.start * scale, 0.0, 0.0])
    moves, most = _Moves(loop), loop.clip * scale
    pending: list[tuple[float, float]] = []  # (when it acts, voltage)
    acting, now, u, y, t = 0.0, times[0], E_A, 0.0, times[0]
    out = []
    for k in range(count):
        for when, voltage in [p for p in pending if p[0] <= times[k]]:
            state, now = moves.go(state, acting - loop.load, when - now), when
            acting = voltage
        pending = [p for p in pending if p[0] > times[k]]
        state, now = moves.go(state, acting - loop.load, times[k] - now), times[k]
        if not lost[k]:
            t, y = float(times[k]), min(max(float(state[0] + noise[k]), -most), most)
            y = loop.step * scale * round(y / (loop.step * scale)) if loop.step else y
            u = E_A if -y > loop.hysteresis * scale else -E_A if -y < -loop.hysteresis * scale else u
        leaves = float(times[k] + loop.delay * loop.tick)
        pending.append((leaves, u))
        out.append(Row(t, y, u, leaves, 0.0, E_A, 0.0, exciting=True, fresh=not lost[k]))
    return out


class _Moves:
    """The plant over a time step; step lengths repeat, so their matrices are kept."""

    def __init__(self, loop: Loop) -> None:
        w = loop.omega_n
        self._a = np.zeros((4, 4))
        if not loop.friction:
            self._a[:3] = [[0, 1, 0, 0], [0, 0, 1, 0], [0, -w * w, -2 * loop.zeta * w, K_L * w * w]]
        self._kept: dict[int, np.ndarray] = {}

    def go(self, state: np.ndarray, drive: float, h: float) -> np.ndarray:
        key = round(h * 1e12)
        if key not in self._kept:
            self._kept[key] = expm(self._a * h)
        m = self._kept[key]
        return m[:3, :3] @ state + m[:3, 3] * drive


def settings(method: str = "exact", loop: Loop | None = None, **changes) -> EstimatorSettings:
    """Estimator settings that suit `loop`."""
    eps = loop.hysteresis * amplitude_of(loop.zeta, loop.omega_n) if loop else 0.0
    known = {"K_L": K_L, "hysteresis": eps, "delay_s": 0.0, "period_s": loop.tick if loop else TICK}
    return EstimatorSettings(**({"method": method, **known, "cycles": 4, "lowpass_hz": None} | changes))
