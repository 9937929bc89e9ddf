"""Rows of a sampled relay on the compiled plant of `sim`, and the Cramer-Rao bound by differences of it.

Neither knows anything of the estimators' closed forms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from accuracy_cases import TICK, Case

from seod.estimate.base import EstimatorSettings, Row
from sim.parameters import parameters
from sim.runs import RELAY, follow, sampled_relay
from sim.state import new_state

Array = np.ndarray

K_L, E_A = 17.0, 0.5
GUESS = 5.0
"""Of K_L, where nothing is known of it [unit/s/V]."""
SPEED = 30.0
"""Mean speed in velocity mode [unit/s]."""
GAIN_KNOWN, DELAY_KNOWN = 0.03, 0.3
"""How well K_L and the delay are known where they are estimated: a part of K_L, ticks."""
CYCLES = 4
"""The estimators' window."""
PHASE, SHIFT = 3, 0.25
"""Cycles of each of two phases, and by how much of a period the second is late."""
SPREAD = 0.02
"""Each run has a plant up to this far from the case's, so that no one ratio of period and tick decides."""
NONE = np.zeros(0)
STEP = 1e-4
"""Of the differences, relative to each unknown's scale."""


class Plant(NamedTuple):
    """What is true."""

    zeta: float
    omega_n: float
    K_L: float = K_L
    delay: float = 0.0
    """From a voltage's leaving to its arrival [s]."""
    load: float = 0.0
    """[unit/s^2]"""
    unequal: float = 0.0
    """Half the relative difference between the gains of positive and negative voltages."""


@dataclass(frozen=True)
class Run:
    """One record of a case; arrays of shape (n,)."""

    case: Case
    plant: Plant
    sigma: float
    """Of the noise [unit, or unit/s]; a coarse sensor's counts included."""
    step: float
    """Of the sensor [unit, or unit/s]."""
    hysteresis: float
    """[unit]"""
    period: float
    """Of the limit cycle [s], on average."""
    t: Array
    """When the samples were taken [s]; `stamped`: when their timestamps say so."""
    stamped: Array
    y: Array
    """What the sensor says [unit, or unit/s]."""
    u: Array
    t_u: Array

    @property
    def bias(self) -> float:
        """Behind the relay [V]."""
        return SPEED / K_L if self.case.speed else self.case.bias * E_A

    @property
    def seen(self) -> Array:
        """What the estimators get: the position, or the integral of the speed's error, shape (n,)."""
        if not self.case.speed:
            return self.y
        means = 0.5 * (self.y[1:] + self.y[:-1]) - SPEED
        return np.concatenate([[0.0], np.cumsum(means * np.diff(self.stamped))])

    def rows(self) -> list[Row]:
        """As the daemon would feed them."""
        columns = (self.stamped, self.seen, self.u, self.t_u, self.y)
        rows = zip(*(column.tolist() for column in columns), self._second(), strict=True)
        return [
            Row(*each, 0.0, E_A, self.bias, exciting=True, speed=speed, second=second)
            for *each, speed, second in rows
        ]

    def _second(self) -> list[bool]:
        """Whether each row's command is the second phase's: the relay's own counting, by its crossings."""
        if not self.case.two_phase:
            return [False] * len(self.t)
        count, sign, second, out = -1, 1.0, False, []
        for y in self.y.tolist():
            wanted = -1.0 if y > self.hysteresis else 1.0 if y < -self.hysteresis else sign
            if wanted > sign:
                count += 1
                if count == PHASE:
                    count, second = 0, not second
            sign = wanted
            out.append(second)
        return out

    def settings(self, method: str) -> EstimatorSettings:
        """What a user would tell the estimators."""
        free = self.case.free
        if self.case.two_phase:
            return EstimatorSettings(
                method, GUESS, self.hysteresis, 0.0, TICK, cycles_of(self.case), None,
                K_L_sd=math.inf, delay_sd=math.inf,
            )  # fmt: skip
        return EstimatorSettings(
            method, K_L, self.hysteresis, known_delay(self.case), TICK, CYCLES, None,
            K_L_sd=GAIN_KNOWN * K_L if free == "K_L" else 0.0,
            delay_sd=DELAY_KNOWN * TICK if free == "delay" else 0.0,
            resolution=self.step,
            integrated=self.case.speed,
        )  # fmt: skip


def cycles_of(case: Case) -> int:
    """The estimators' window, in cycles."""
    return 2 * PHASE if case.two_phase else CYCLES


def known_delay(case: Case) -> float:
    """Delay beyond that to a voltage's leaving that is reckoned with [s]."""
    return TICK if case.free == "delay" else 0.0


@lru_cache
def scale_of(case: Case) -> tuple[float, float]:
    """Amplitude [unit, or unit/s] and period [s] of the case's limit cycle without noise and hysteresis."""
    plain = Case(case.zeta, case.turn, 0.0, delay=case.delay, friction=case.friction, speed=case.speed)
    plant = Plant(case.zeta, case.turn / TICK, delay=known_delay(case))
    t = TICK * np.arange(int(40.0 * 2.0 * math.pi / case.turn))
    y, u, _ = _limit_cycle(plain, plant, t, (0.0, 0.0), 0.0, NONE)
    late = t > 0.5 * t[-1]
    ups = np.flatnonzero(np.diff(u[late]) > 0.0)
    newest = y[late][ups[0] : ups[-1]]
    return 0.5 * float(np.ptp(newest)), TICK * (ups[-1] - ups[0]) / (len(ups) - 1)


def make(case: Case, seed: int) -> Run:
    """One record, from rest somewhat beside the set point; the seed makes it again."""
    rng = np.random.default_rng([seed, *case.name.encode()])
    plant, (amplitude, period) = _drawn(case, rng), scale_of(case)
    cycles = cycles_of(case) + case.before
    nominal = TICK * np.arange(int((3 if case.two_phase else 2) * cycles * period / TICK))
    t = nominal + TICK * case.jitter * np.clip(rng.standard_normal(len(nominal)), -3.0, 3.0)
    noise = case.noise * amplitude * rng.standard_normal(len(t))
    position = amplitude / (plant.omega_n if case.speed else 1.0)
    hysteresis, step = case.hysteresis * position, amplitude / case.steps if case.steps else 0.0
    place = hysteresis, 0.3 * position * rng.uniform(-1.0, 1.0)
    y, u, t_u = _limit_cycle(case, plant, t, place, step, noise)
    ups = _ups(t, u, period)[: cycles + 1]
    count = int(ups[-1]) + 3
    sigma = math.hypot(case.noise * amplitude, step / math.sqrt(12.0))
    mean_period = float(t[ups[-1]] - t[ups[1]]) / (len(ups) - 2)
    kept = (x[:count] for x in (t, t if case.told else nominal, y, u, t_u))
    return Run(case, plant, sigma, step, hysteresis, mean_period, *kept)


def _drawn(case: Case, rng: np.random.Generator) -> Plant:
    """The case's plant, somewhat off; what the case leaves free is off by as much as is known of it."""
    zeta, omega_n = (x * (1.0 + SPREAD * rng.uniform(-1.0, 1.0)) for x in (case.zeta, case.turn / TICK))
    off = float(np.clip(rng.standard_normal(), -3.0, 3.0))
    gain = K_L * (1.0 + GAIN_KNOWN * off) if case.free == "K_L" else K_L
    delay = TICK * (1.0 + DELAY_KNOWN * off) if case.free == "delay" else 0.0
    load = case.load * E_A * K_L * omega_n / (2.0 * zeta)
    return Plant(zeta, omega_n, gain, delay, load, case.unequal)


def _parameters(plant: Plant, speed: bool, effects: dict[str, dict[str, float]] | None = None) -> Array:
    linear = {
        "transport_delay": {"time": plant.delay},
        "load_bias": {"acceleration": plant.load},
        "asymmetric_gain": {"ratio": plant.unequal},
    }
    return parameters(
        plant.K_L, plant.omega_n, plant.zeta, linear | (effects or {}), measures_speed=float(speed)
    )


def _limit_cycle(
    case: Case, plant: Plant, t: Array, place: tuple[float, float], step: float, noise: Array
) -> tuple[Array, Array, Array]:
    """Readings, voltages and when they left; `place` is the hysteresis and where the plant starts [unit]."""
    effects = {"coulomb_friction": {"level": case.friction * K_L * E_A * plant.omega_n}}
    effects["sensor_quantization"] = {"step": step}
    p, relay = _parameters(plant, case.speed, effects), np.zeros(1, RELAY)
    relay["e_a"], relay["hysteresis"], relay["latency"] = E_A, place[0], TICK * case.delay
    relay["bias"] = case.bias * E_A
    if case.two_phase:
        relay["cycles"], relay["shift"] = PHASE, SHIFT
    state = new_state(p, t[0], place[1])
    if case.speed:
        relay["velocity_mode"], relay["reference"], relay["bias"] = 1.0, SPEED, SPEED / K_L
        state["velocity"], state["pressure"] = SPEED, 2.0 * plant.zeta * plant.omega_n * SPEED
        state["spool"] = state["target"] = SPEED / K_L
    y, u, t_u = np.empty((3, len(t)))
    sampled_relay(p[0], state[0], relay[0], t, noise, NONE, NONE, NONE, y, u, t_u)
    return y, u, t_u


def _ups(t: Array, u: Array, period: float) -> Array:
    """Rows after which the relay went up, chatter counted once."""
    ups = np.flatnonzero(np.diff(u) > 0.0)
    apart = np.diff(t[ups]) > 0.4 * period
    return ups[np.concatenate([[True], apart])] if len(ups) else ups


def bound(run: Run, begin: float, unknown: tuple[str, ...] = ()) -> Array:
    """Cramer-Rao bound of the relative errors of omega_n and zeta for the samples from `begin` [s] on.

    Unknown with them: the state at `begin`, a constant load, and what the case leaves free, with its prior.
    The voltages count as given: they are made of measurements, and tell no more than these.
    Dry friction and counts are no part of it but as noise.

    Args:
        run: The record.
        begin: [s].
        unknown: "K_L", "delay" or both, of which nothing is known; beside what the case leaves free.

    Returns:
        Standard deviations of the logarithms of omega_n and zeta, shape (2,); zeros without noise.
    """
    if run.sigma == 0.0:
        return np.zeros(2)
    first = int(np.searchsorted(run.t, begin - 1e-9))
    names = ["omega_n", "zeta", "position", "velocity", "pressure", "load"]
    names += [*unknown, *([run.case.free] if run.case.free else [])]
    slopes = np.stack([_slope(run, first, name) for name in names]) / run.sigma
    information = slopes @ slopes.T
    if run.case.free:  # in units of the prior's standard deviation
        information[-1, -1] += 1.0
    told = information.diagonal() > 1e-20 * information.diagonal().max()  # a speed tells no position
    information = information[np.ix_(told, told)]
    scale = 1.0 / np.sqrt(information.diagonal())
    covariance = np.linalg.pinv(information * np.outer(scale, scale), rcond=1e-13) * np.outer(scale, scale)
    return np.asarray(np.sqrt(covariance.diagonal()[:2]))


def _slope(run: Run, first: int, name: str) -> Array:
    """Derivative of the readings by an unknown, central difference; shape (n - first,)."""
    return np.asarray((_readings(run, first, name, STEP) - _readings(run, first, name, -STEP)) / (2.0 * STEP))


def _readings(run: Run, first: int, name: str, off: float) -> Array:
    """Without noise; the unknown is off by a part of its scale from the sample `first` on."""
    p = _parameters(run.plant, run.case.speed)
    state = new_state(p, run.t[0] - TICK, 0.0)
    follow(p[0], state[0], run.t_u, run.u, run.t[: first + 1], NONE, NONE, NONE, NONE, np.empty(first + 1))
    omega_n, y = run.plant.omega_n, np.empty(len(run.t) - first)
    scales = {
        place: K_L * E_A * omega_n ** (k - 1) for k, place in enumerate(("position", "velocity", "pressure"))
    }
    if name in scales:
        state[name] += off * scales[name]
    p = _parameters(_off_by(run.plant, name, off), run.case.speed)
    late = off * DELAY_KNOWN * TICK if name == "delay" else 0.0
    follow(p[0], state[0], run.t_u + late, run.u, run.t[first:], NONE, NONE, NONE, NONE, y)
    return y


def _off_by(plant: Plant, name: str, off: float) -> Plant:
    """The plant with an unknown off by a part of its scale."""
    match name:
        case "omega_n":
            return plant._replace(omega_n=plant.omega_n * math.exp(off))
        case "zeta":
            return plant._replace(zeta=plant.zeta * math.exp(off))
        case "K_L":
            return plant._replace(K_L=plant.K_L + GAIN_KNOWN * K_L * off)
        case "load":
            return plant._replace(load=plant.load + off * K_L * E_A * plant.omega_n)
    return plant
