"""A simulated rig on the bench: relay runs, and multisines for the frequency response."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.config.gain_in_force import gain_of
from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.respond.design import multisines
from seod.respond.record import Segment
from seod.respond.response import respond
from seod.simulate.view import AxisView
from sim.experiment import sensor_effects, with_effects
from sim.hydraulics import closed_loop
from sim.hydraulics.linear import Physics, small_signal
from sim.hydraulics.record import record_of
from sim.machine import HydraulicMachine
from sim.runs import RELAY
from sim.truth import numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.respond.record import Output
    from seod.respond.response import Response

    Array = NDArray[np.float64]

NONE: Final = np.empty(0)
TICK_S: Final = 5e-4
"""The paper's, section 3."""
ENTRY_S: Final = 0.05
"""In which the relay's amplitude rises."""
PERIODS: Final = 4
"""Of the multisine that are looked at, after one that settles."""
TRIM: Final = 0.2
"""As the daemon's: part of a cycle's mean relay voltage that is moved into the bias."""
CREEP: Final = 1e-6
"""Speed of creeping [unit/s]."""
NOISE: Final = 1
DRIVE: Final = 2
"""Streams of random numbers."""


@dataclass(frozen=True)
class Run:
    """Rows of a relay run, in the units of the axis; arrays of one length.

    Attributes:
        t: [s]
        u: [V]
        y: Reading [unit, in velocity mode unit/s].
        ps: Supply pressure [Pa].
        reference: Position, in velocity mode speed.
        bias: Behind the relay [V].
        K_L: That the daemon assumes [unit/s/V].
        area: In velocity mode the integral of the speed's error [unit]; else none.
        e_a: [V]
        inside: `sim.hydraulics.closed_loop.INSIDE` of each row, where it was asked for.
    """

    t: Array
    u: Array
    y: Array
    ps: Array
    reference: Array
    bias: Array
    K_L: Array
    area: Array
    e_a: float
    inside: Array = field(default_factory=lambda: np.empty((0, 6)))

    @property
    def signal(self) -> Array:
        """What the relay switches by: position error, or the integral of the speed's [unit]."""
        return self.area if len(self.area) else self.y - self.reference


@cache
def rig(name: str) -> RigConfig:
    """A shipped rig file, by its name without `.yaml`."""
    return load_rig(configs_dir() / f"{name}.yaml")


class Bench:
    """One axis of a shipped hydraulic rig.

    Args:
        name: Of the rig file.
        axis: Of the axis.
        effects: More effects of its plant, as in `sim.effects`.
        parts: Other values of its parts, by group and key.
        noise: Of the sensor [unit, or unit/s]; None: the rig file's.
        clean: The sensor neither counts nor lags, K_L is that of the oscillation, the spool's lag is known,
            and the bias stands still.

    Attributes:
        delay: That estimators are told of [s]: the spool's lag, of a clean rig.
    """

    def __init__(
        self,
        name: str,
        axis: str,
        effects: dict[str, dict[str, float]] | None = None,
        parts: dict[str, dict[str, float]] | None = None,
        noise: float | None = None,
        clean: bool = False,
    ) -> None:
        self.view = AxisView(rig(name), axis)
        plant = self.view.plant
        if not clean:
            plant = with_effects(plant, sensor_effects(plant))
        self.clean, self.lag, self.delay = clean, 0.0 if clean else self.view.sensor.lag, 0.0
        if effects:
            plant = with_effects(plant, effects)
        if parts and plant.hydraulic is not None:
            changed = {
                group: {**plant.hydraulic.get(group, {}), **parts.get(group, {})}
                for group in {*plant.hydraulic, *parts}
            }
            plant = plant.model_copy(update={"hydraulic": changed})
        if clean and plant.hydraulic is not None:
            p = record_of(plant)
            self.delay = float(2.0 * p["valve_zeta"][0] / p["valve_omega"][0])
        self.plant = plant
        self.noise = plant.noise if noise is None else noise
        self.velocity = self.view.axis.mode == "velocity"
        self.nominal_pa = float((plant.hydraulic or {})["supply"]["pressure"])
        self.gain = gain_of(self.view.axis.K_L)

    def true(self, ps: float | None = None, speed: float = 0.0) -> dict[str, float]:
        """K_L, omega_n and zeta of small movements at a pressure [Pa] and about a speed [unit/s]."""
        supply = 1.0 if ps is None else ps / self.nominal_pa
        return numbers(self.plant, self.plant.position, speed, supply, 0.0)

    def quick_gain(self, ps: float, speed: float) -> float:
        """K_L that movements as quick as the plant's own show [unit/s/V].

        It is that of steady movement, but of a single rod: what its chambers have in common follows slowly.
        """
        small = small_signal(
            record_of(self.plant),
            speed=speed,
            position=self.plant.position,
            supply=ps / self.nominal_pa,
        )
        own = 1j * small.omega_n * np.eye(len(small.A))
        return 2.0 * small.zeta * float(abs(small.C @ np.linalg.solve(own - small.A, small.B)))

    def _null(self, ps: float) -> float:
        """Command at which a clean plant stands still [V]: mean of creeping forth and back."""
        if not self.clean:
            return 0.0
        physics = Physics(record_of(self.plant), self.plant.position, ps / self.nominal_pa)
        return 0.5 * (physics.steady(CREEP).volts + physics.steady(-CREEP).volts)

    def _machine(self, supply: float, volts: float) -> HydraulicMachine:
        """At rest, or moving steadily where volts are held before time 0."""
        settling = HydraulicMachine(self.plant, 0.0).settling(volts) if volts else 0.0
        machine = HydraulicMachine(self.plant, -settling)
        machine.state["origin"] = 0.0
        machine.surround(np.array([supply]), NONE)
        if volts:
            at = np.array([-settling])
            machine.follow(at, np.array([volts]), np.zeros(1), NONE, (NONE, NONE, NONE))
        return machine

    def relay(
        self,
        duration: float,
        e_a: float | None = None,
        *,
        ps: float | Array | None = None,
        speed: float | Array = 0.0,
        hysteresis: float | None = None,
        seed: int = 1,
        inside: bool = False,
    ) -> Run:
        """A relay run of `duration` [s] at pressures `ps` [Pa] and, in velocity mode, speeds [unit/s]."""
        t = np.arange(round(duration / TICK_S), dtype=np.float64) * np.float64(TICK_S)
        whole = (
            np.full(len(t), self.nominal_pa if ps is None else ps) if not isinstance(ps, np.ndarray) else ps
        )
        reference = np.full(len(t), speed) if not isinstance(speed, np.ndarray) else speed
        if self.clean:
            K_L = np.full(len(t), self.quick_gain(float(whole[0]), float(reference[0])))
        else:
            K_L = np.array([self.gain(each) for each in whole.tolist()])
        bias = self._bias(float(whole[0]), reference, K_L)
        supply = whole / self.nominal_pa
        e_a = self.view.axis.relay.e_a if e_a is None else e_a
        r = np.zeros(1, RELAY)
        r["e_a"], r["entry"], r["velocity_mode"] = e_a, ENTRY_S, self.velocity
        r["hysteresis"] = self.view.axis.relay.hysteresis if hysteresis is None else hysteresis
        machine = self._machine(float(supply[0]), float(bias[0]))
        noise = np.random.default_rng([seed, NOISE]).normal(0.0, self.noise, len(t)) if self.noise else NONE
        y, u, t_u = np.empty((3, len(t)))
        trim = TRIM if self.velocity else 0.0
        within = np.empty((len(t) if inside else 0, 6))
        wish = reference if self.velocity else np.full(len(t), self.plant.position)
        closed_loop.relay(
            machine.p[0], machine.state[0], r[0], t, noise, supply, NONE, wish, bias, trim, y, u, t_u, within
        )
        seen: Array = y * self.view.slope if self.clean else self.view.readings(y)
        area = _area(t, seen, reference) if self.velocity else NONE
        return Run(t, u, seen, whole, reference, bias, K_L, area, e_a, within)

    def _bias(self, ps: float, reference: Array, K_L: Array) -> Array:
        """That holds the axis, or its speed [V]."""
        if not self.velocity:
            return np.full(len(reference), self._null(ps))
        steady = np.full(len(reference), self.true(ps, float(reference[0]))["K_L"]) if self.clean else K_L
        return reference / steady

    def response(
        self,
        amplitude: float,
        band: tuple[float, float],
        *,
        ps: float | None = None,
        speed: float = 0.0,
        period: float = 2.0,
        K_L: float | None = None,
        seed: int = 1,
    ) -> Response:
        """Frequency response to two multisines of `amplitude` [V] within a band [Hz]."""
        pressure = self.nominal_pa if ps is None else ps
        random = np.random.default_rng([seed, DRIVE])
        output: Output = "velocity" if self.velocity else "position"
        bias = speed / self.gain(pressure) if self.velocity else 0.0
        t = np.arange(round((PERIODS + 1) * period / TICK_S), dtype=np.float64) * np.float64(TICK_S)
        segments = []
        for number, tones in enumerate(multisines(band, period, 2, output, random)):
            hertz, size, phase = np.array(tones).T
            u = bias + amplitude * (np.sin(2.0 * math.pi * np.outer(t, hertz) + phase) @ size)
            machine = self._machine(pressure / self.nominal_pa, bias)
            noise = np.random.default_rng([seed, NOISE, number]).normal(0.0, self.noise, len(t))
            y = machine.follow(t, u, t, noise, (np.full(len(t), pressure / self.nominal_pa), NONE, NONE))
            seen: Array = y * self.view.slope if self.clean else self.view.readings(y)
            if output == "position":
                seen = _without_drift(t, seen, round(period / TICK_S))
            segments.append(
                Segment.of("multisine", t, u, seen, t, output=output, period=period).after(period)
            )
        return respond(segments, K_L, None, self.lag)


def _area(t: Array, speed: Array, reference: Array) -> Array:
    """Integral of the speed's error, as the daemon's relay sees it [unit]."""
    steps = (0.5 * (speed[1:] + speed[:-1]) - reference[1:]) * np.diff(t)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _without_drift(t: Array, y: Array, period: int) -> Array:
    """A periodic signal without the slope that shows from period to period."""
    rises = y[2 * period :] - y[period:-period]
    return y - t * float(np.mean(rises)) / (period * TICK_S)
