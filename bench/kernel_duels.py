"""The kernel against solve_ivp and python-control (`kernel_rivals`), at the same accuracy.

Each rival gets the method and the tolerance with which it is quickest among those at least as accurate as the
kernel; the truth is DOP853 at a tolerance of 1e-12.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING

import kernel_rivals as rivals
import numpy as np
from bench_pairs import Pairs, alternate
from kernel_tasks import NOTHING, OMEGA_N, RATE, plant

from sim.runs import RELAY, follow, ideal_relay
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

METHODS = ("RK45", "DOP853", "LSODA")
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


@dataclass
class Rival:
    """How someone else does it; `exact`: without method and tolerance."""

    name: str
    run: rivals.Run
    exact: bool = False


@dataclass
class Task:
    """What both sides do: ours returns y, theirs does for a method and a tolerance."""

    name: str
    ours: Callable[[], NDArray]
    truth: rivals.Run
    rivals: list[Rival]


def tasks(seconds: float) -> list[Task]:
    t = np.arange(round(seconds * RATE)) / RATE
    u = np.where(np.sin(OMEGA_N * t) < 0.0, -0.5, 0.5)
    u_soft = np.where(t < 0.5 * seconds, u, np.where(u > 0.0, 0.1, -0.02))
    rough = rivals.given(rivals.friction, t, u_soft, 3, 0.0, rivals.stops)
    smooth, wound, ideal = (
        rivals.given(rivals.linear, t, u, 3),
        rivals.given(rivals.orifice, t, u, 4),
        rivals.relay(t, 0.5),
    )
    return [
        Task("given input, linear", kernel_given(plant(), t, u), smooth,
             [Rival("solve_ivp", smooth), Rival("python-control", rivals.sampled_system(t, u), exact=True)]),
        Task("given input, orifice and valve lag", kernel_given(plant("square_root_flow", "valve_lag"), t, u),
             wound, [Rival("solve_ivp", wound), Rival("python-control", rivals.nonlinear_system(t, u))]),
        Task("given input, dry friction that sticks", kernel_given(plant("coulomb_friction"), t, u_soft),
             rough, [Rival("solve_ivp", rough)]),
        Task("ideal relay, linear", kernel_relay(plant(), t), ideal, [Rival("solve_ivp", ideal)]),
    ]  # fmt: skip


def kernel_given(p: NDArray, t: NDArray, u: NDArray) -> Callable[[], NDArray]:
    def run() -> NDArray:
        y, s = np.empty(len(t)), new_state(p)
        follow(p[0], s[0], t, u, t, NOTHING, NOTHING, NOTHING, NOTHING, y)
        return y

    return run


def kernel_relay(p: NDArray, t: NDArray) -> Callable[[], NDArray]:
    r = np.zeros(1, RELAY)
    r["e_a"] = 0.5

    def run() -> NDArray:
        y, s = np.empty(len(t)), new_state(p, position=rivals.START)
        ideal_relay(p[0], s[0], r[0], t, y, NOTHING)
        return y

    return run


@dataclass
class Duel:
    """One rival on one task, at its best."""

    rival: str
    setting: str
    error: float
    timed: Pairs


def quickest(run: rivals.Run, truth: NDArray, error: float, quick: bool) -> tuple[str, float, float]:
    """Method and tolerance that are accurate enough in the least time, else the most accurate; the error."""
    found = []
    for method in METHODS[: 2 if quick else None]:
        for rtol in TOLERANCES:
            start = perf_counter()
            off = float(np.abs(run(method, rtol) - truth).max())
            found.append((off > error, perf_counter() - start if off <= error else off, off, method, rtol))
            if off <= error:
                break
    _, _, off, method, rtol = min(found)
    return method, rtol, off


def duels(task: Task, rounds: int, quick: bool) -> tuple[float, list[Duel]]:
    """The kernel's error over the movement's range, and how each rival does."""
    truth = task.truth("DOP853", 1e-12)
    reach = float(np.ptp(truth))
    error, found = float(np.abs(task.ours() - truth).max()), []
    for rival in task.rivals:
        if rival.exact:
            method, rtol, off = "", 0.0, float(np.abs(rival.run("", 0.0) - truth).max())
        else:
            method, rtol, off = quickest(rival.run, truth, error, quick)
        run = partial(rival.run, method, rtol)
        timed = alternate(run, task.ours, rounds, repeat_second=20)
        found.append(Duel(rival.name, f"{method} {rtol:g}" if method else "exact", off / reach, timed))
    return error / reach, found
