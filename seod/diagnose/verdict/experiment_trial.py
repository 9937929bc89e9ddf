"""A trial of an experiment: would two models of the same recordings differ in it, each fitted to it?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import least_squares

from seod.diagnose.fitting import work
from seod.diagnose.fitting.simulate import PRESSURE
from seod.diagnose.tuning.verdict import TRIAL
from sim.excitation import multisine, sine, steps
from sim.runs import RELAY, sampled_relay
from sim.state import new_state
from sim.windows import INSIDE, START, follow_windows

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array

_NONE: Final = np.empty(0)
_SEED: Final = 1


@dataclass(frozen=True, slots=True)
class Excitation:
    """How the rig is driven.

    Attributes:
        kind: `relay`, `two-phase`, `multisine`, `steps` or `sine`, as `seod simulate` calls them.
        amplitudes: One after the other, each for the same time [V].
        band: Lowest and highest frequency [Hz]; of sine and steps the first counts.
    """

    kind: str
    amplitudes: tuple[float, ...]
    band: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Run:
    """What an experiment would record, without noise; arrays of shape (n,).

    Attributes:
        t: [s].
        u: [V].
        y: Reading.
        pressure: Of the load, as acceleration of the free load [unit/s^2].
    """

    t: Array
    u: Array
    y: Array
    pressure: Array


def times(omega_n: float, tick: float) -> Array:
    """Of the samples of a trial [s]."""
    period = 2.0 * math.pi / omega_n
    least = TRIAL.fewest_periods * period
    length = min(max(TRIAL.lasts_s[0], TRIAL.periods * period), max(TRIAL.lasts_s[1], least))
    tick = max(tick, least / TRIAL.most_samples)
    return np.arange(min(round(length / tick), TRIAL.most_samples), dtype=np.float64) * tick


def perform(record: NDArray[np.void], excitation: Excitation, t: Array) -> Run:
    """The plant of this record of parameters under an excitation, from rest."""
    parts = np.array_split(np.arange(len(t)), len(excitation.amplitudes))
    if excitation.kind in {"relay", "two-phase"}:
        pieces = zip(parts, excitation.amplitudes, strict=True)
        u = np.concatenate([_relay(record, excitation.kind, volts, t[rows]) for rows, volts in pieces])
    else:
        shape = _given(excitation, t)
        u = np.concatenate(
            [volts * shape[rows] for rows, volts in zip(parts, excitation.amplitudes, strict=True)]
        )
    return Run(t, np.asarray(u, np.float64), *follow(record, t, u))


def _relay(record: NDArray[np.void], kind: str, volts: float, t: Array) -> Array:
    relay = np.zeros(1, RELAY)
    relay["e_a"] = np.copysign(volts, record["K_L"])  # the daemon finds out how the actuator is wired
    relay["velocity_mode"] = record["measures_speed"]
    if kind == "two-phase":
        relay["cycles"], relay["shift"] = TRIAL.cycles, TRIAL.shift
    y, u, t_u = np.empty((3, len(t)))
    state = new_state(record, float(t[0]))
    sampled_relay(record[0], state[0], relay[0], t, _NONE, _NONE, _NONE, _NONE, y, u, t_u)
    return u


def _given(excitation: Excitation, t: Array) -> Array:
    random = np.random.default_rng(_SEED)
    low = excitation.band[0]
    if excitation.kind == "multisine":
        return multisine(t, 1.0, excitation.band, float(t[-1] - t[0]), None, random)
    if excitation.kind == "steps":
        return steps(t, 1.0, low, random)
    wave: Array = sine(t, 1.0, low)
    return wave


def follow(record: NDArray[np.void], t: Array, u: Array) -> tuple[Array, Array]:
    """Readings and load pressure from rest, each of shape (n,)."""
    begin, end = np.array([0]), np.array([len(t)])
    valve, load = new_state(record, float(t[0])), new_state(record, float(t[0]))
    y, inside = np.empty(len(t)), np.empty((len(t), len(INSIDE)))
    start = np.zeros((1, len(START)))
    given = t, u, t, _NONE, _NONE, _NONE
    follow_windows(record, valve, load, *given, begin, end, start, math.inf, y, inside)
    work.spend(float(load["steps"][0]), len(t))
    return y, inside[:, PRESSURE]


def refitted(model: Model, begins: Iterable[Array], run: Run, noise: float) -> tuple[Array, float]:
    """The model's searched numbers that come nearest to a run, and the rms that it leaves over the noise.

    Those that are known stay as they are.
    """
    low, high = model.bounds
    free = low < high

    def every(some: Array) -> Array:
        x = low.copy()
        x[free] = np.clip(some, low[free], high[free])
        return x

    def residual(some: Array) -> Array:
        y, _ = follow(model.kernel_parameters(every(some)), run.t, run.u)
        gone = TRIAL.gone
        left: Array = np.nan_to_num((y - run.y) / noise, nan=gone, posinf=gone, neginf=-gone)
        return left

    best_x, best = np.empty(0), math.inf
    for begin in begins:
        bounds = low[free], high[free]
        inside = np.clip(begin[free], bounds[0] + 1e-9, bounds[1] - 1e-9)
        step = [TRIAL.derivative_step] * len(inside)
        answer = least_squares(
            residual, inside, bounds=bounds, diff_step=step, x_scale="jac", max_nfev=TRIAL.tries
        )
        rms = math.sqrt(2.0 * float(answer.cost) / len(run.t))
        if rms < best:
            best_x, best = every(answer.x), rms
    return best_x, best
