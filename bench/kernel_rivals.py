"""The kernel's tasks by scipy's solve_ivp and by python-control, started anew at each switch as one would."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import control
import numpy as np
from kernel_tasks import EXAMPLES, K_L, OMEGA_N, RATE, ZETA
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim import physics

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

SCALES = np.array([3000.0, 25.0, 0.25, 0.5])
"""Of pressure, velocity, position, spool: absolute tolerances are a hundredth of the relative one of it."""

Rates = Callable[[float, NDArray, float, float], list[float]]
Run = Callable[[str, float], NDArray]
START = -0.05
"""Where the relay's load begins [rad]: at the threshold itself anything could happen first."""

LEVEL = EXAMPLES["coulomb_friction"]["level"]


def linear(_t: float, z: NDArray, volts: float, _mode: float) -> list[float]:
    """Eq. 1: pressure, velocity, position."""
    return [OMEGA_N**2 * (K_L * volts - z[1]) - 2.0 * ZETA * OMEGA_N * z[0], z[0], z[1]]


def orifice(_t: float, z: NDArray, volts: float, _mode: float) -> list[float]:
    """The same with square_root_flow and valve_lag; the fourth state is the spool."""
    drop = 1.0 - (z[0] if z[3] > 0.0 else -z[0]) / EXAMPLES["square_root_flow"]["supply"]
    laminar = physics.LAMINAR**2
    speed = K_L * z[3] * drop * ((1.0 + laminar) / (drop * drop + laminar)) ** 0.25
    pressure = OMEGA_N**2 * (speed - z[1]) - 2.0 * ZETA * OMEGA_N * z[0]
    return [pressure, z[0], z[1], (volts - z[3]) / EXAMPLES["valve_lag"]["time"]]


def friction(t: float, z: NDArray, volts: float, mode: float) -> list[float]:
    """Eq. 1 with coulomb_friction: `mode` is the direction of movement, 0 sticks."""
    pressure, velocity, position = linear(t, z, volts, mode)
    return [pressure, velocity - mode * LEVEL if mode else 0.0, position if mode else 0.0]


def stops(_t: float, z: NDArray, _volts: float, mode: float) -> float:
    return mode * z[1] if mode else LEVEL - abs(z[0])


def crosses(_t: float, z: NDArray, volts: float, _mode: float) -> float:
    return -z[2] if volts > 0.0 else z[2]


for event in (stops, crosses):
    event.terminal, event.direction = True, -1


def atol(rtol: float, states: int) -> NDArray:
    return 0.01 * rtol * SCALES[:states]


def keep(done: OptimizeResult, y: NDArray, k: int) -> int:
    """Put the positions at the ticks that were reached into `y` from row `k` on; returns the next row."""
    reached = k + len(done.t)
    if reached > k:
        y[k:reached] = done.y[2]
    return reached


def given(rates: Rates, t: NDArray, u: NDArray, states: int, mode: float = 1.0, events: object = None) -> Run:
    """Commands `u` at the ticks `t`, solve_ivp started anew where they change and at each event."""
    edges = [0, *(np.flatnonzero(np.diff(u)) + 1), len(t) - 1]

    def run(method: str, rtol: float) -> NDArray:
        y, z, now = np.zeros(len(t)), np.zeros(states), mode
        for first, last in pairwise(edges):
            start, k = t[first], first + 1
            while start < t[last]:
                done = solve_ivp(
                    rates, (start, t[last]), z, method, t[k : last + 1], events=events,
                    args=(u[first], now), rtol=rtol, atol=atol(rtol, states),
                )  # fmt: skip
                k = keep(done, y, k)
                if done.status != 1:
                    z = done.y[:, -1]
                    break
                start, z = done.t_events[0][0], done.y_events[0][0]
                z[1] = 0.0
                now = 0.0 if now and abs(z[0]) <= LEVEL else float(np.sign(z[0]))
        return y

    return run


def relay(t: NDArray, e_a: float) -> Run:
    """The ideal relay on the linear plant."""

    def run(method: str, rtol: float) -> NDArray:
        y, z, volts, start, k = np.full(len(t), START), np.array([0.0, 0.0, START]), e_a, t[0], 1
        while start < t[-1]:
            done = solve_ivp(
                linear, (start, t[-1]), z, method, t[k:], events=crosses,
                args=(volts, 1.0), rtol=rtol, atol=atol(rtol, 3),
            )  # fmt: skip
            k = keep(done, y, k)
            if done.status != 1:
                break
            start, z, volts = done.t_events[0][0], done.y_events[0][0], -volts
        return y

    return run


def sampled_system(t: NDArray, u: NDArray) -> Run:
    """python-control on the linear plant: sampled with a hold, which is exact, then stepped."""
    a = [[-2.0 * ZETA * OMEGA_N, -(OMEGA_N**2), 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    whole = control.ss(a, [[OMEGA_N**2 * K_L], [0.0], [0.0]], [[0.0, 0.0, 1.0]], [[0.0]])
    stepped = whole.sample(1.0 / RATE, "zoh")
    return lambda _method, _rtol: control.forced_response(stepped, t, u).outputs


def nonlinear_system(t: NDArray, u: NDArray) -> Run:
    """python-control with `orifice`; it draws lines between inputs, so each step is two times 1 ns apart."""
    after = np.flatnonzero(np.diff(u)) + 1
    times, volts = np.insert(t, after, t[after] - 1e-9), np.insert(u, after, u[after - 1])
    system = control.nlsys(
        lambda t, z, volts, _params: orifice(t, z, volts[0], 1.0),
        lambda _t, z, _volts, _params: z[2],
        inputs=1, outputs=1, states=4,
    )  # fmt: skip

    def run(method: str, rtol: float) -> NDArray:
        options = {"rtol": rtol, "atol": atol(rtol, 4)}
        done = control.input_output_response(
            system, times, volts, t_eval=t, solve_ivp_method=method, solve_ivp_kwargs=options
        )
        return done.outputs

    return run
