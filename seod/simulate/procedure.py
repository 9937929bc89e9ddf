"""From a rig file and options to a recording: in the axis' units, at the loop's rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.config.gain_in_force import gain_of, gain_range
from seod.machine.limits import memory_bytes
from seod.simulate.surroundings import Surroundings
from seod.simulate.view import AxisView, plant_of
from sim.excitation import GivenInput, multisine, sine, steps, sweep
from sim.experiment import Experiment, Relay, with_effects

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.config.model import RigConfig
    from seod.simulate.options import Options
    from sim.experiment import Recording

    Array = NDArray[np.float64]

DURATION_S = 10.0
CYCLES = 3
"""Of each phase of the two-phase relay."""


BYTES_PER_ROW = 200
"""Of memory, at most, while a recording is simulated and written: 157 were measured."""


@dataclass
class Simulation:
    """One axis of a rig file, excited as wished.

    Args:
        config: The rig file; it has a `simulation:` section.
        name: The axis.
        options: What is to be done.

    Raises:
        ValueError: A wish cannot be fulfilled; the message says why.
    """

    config: RigConfig
    name: str
    options: Options

    def __post_init__(self) -> None:
        options = self.options
        self.config = _with_plant(self.config, self.name, options.effects)
        self.view = AxisView(self.config, self.name)
        given = options.input
        self.t = given.t if given else _ticks(options.duration, self.config.loop.rate_hz)
        self.surroundings = Surroundings(self.view, len(self.t), given)
        self.signal = None if options.excitation in {"relay", "two-phase"} else self._signal(given)
        plant, velocity = self.view.plant, self.view.axis.mode == "velocity"
        self.experiment = Experiment(
            plant=plant,
            t=self.t,
            seed=self.seed,
            noise=plant.noise if options.noise is None else options.noise,
            latency=options.latency,
            supply=self.surroundings.supply,
            warmth=self.surroundings.warmth,
            approach=float(self.view.volts(np.array(self.offset))) if velocity and not given else None,
        )

    @property
    def seed(self) -> int:
        """Of the signal, the noise and the defects."""
        simulation = self.config.simulation
        default = simulation.seed if simulation else 1
        return default if self.options.seed is None else self.options.seed

    @property
    def amplitude(self) -> float:
        """Of the excitation [V]."""
        return self.view.axis.relay.e_a if self.options.amplitude is None else self.options.amplitude

    @property
    def offset(self) -> float:
        """What the excitation is added to [V]: in velocity mode the voltage of the axis' reference."""
        axis = self.view.axis
        if self.options.bias is not None:
            return self.options.bias
        K_L = gain_of(axis.K_L)(float(self.surroundings.ps[0]))
        if math.isnan(K_L):
            K_L = sum(gain_range(axis.K_L)) / 2.0
        return axis.relay.bias + (axis.reference or 0.0) / K_L

    @property
    def compiled_parts(self) -> list[str]:
        """Functions of the kernel that it calls."""
        room, loop = (
            ("runs", "sampled_relay") if self.view.plant.hydraulic is None else ("closed_loop", "relay")
        )
        relay = [f"{room}.{loop}"] if self.signal is None else []
        held = self.signal is not None or self.experiment.approach is not None
        return relay + ([f"{room}.follow"] if held else [])

    def run(self) -> dict[str, Array]:
        """The recording's columns, in SI.

        Raises:
            ValueError: The simulation shows that it cannot be done.
        """
        view = self.view
        recording = (
            self._run_relay() if self.signal is None else self.experiment.run_given(view.volts(self.signal))
        )
        u = view.command(recording.u) if self.signal is None else self.signal
        columns = {"t": recording.t, "u": u, "y": view.readings(recording.y), "t_u": recording.t_u}
        return columns | self.surroundings.columns()

    def fraction(self) -> float:
        """How far it has come, 0 to 1; may be asked from another thread."""
        first, last = self.t[0], self.t[-1]
        return float(np.clip((self.experiment.state["t"][0] - first) / (last - first), 0.0, 1.0))

    def _run_relay(self) -> Recording:
        view, axis = self.view, self.view.axis
        if not view.per_volt * view.slope > 0.0:
            raise ValueError(
                "a positive voltage does not move the reading up, so that a relay would run away: "
                "turn the sign of the sensor's or the output's scale"
            )
        relay = Relay(
            e_a=self.amplitude * abs(view.per_volt),
            hysteresis=axis.relay.hysteresis / abs(view.slope),
            bias=float(view.volts(np.array(self.offset))),
            reference=(axis.reference or 0.0) / view.slope,
            entry=axis.excitation.entry,
            velocity=axis.mode == "velocity",
            cycles=(self.options.cycles or CYCLES) if self.options.excitation == "two-phase" else 0,
        )
        return self.experiment.run_relay(relay)

    def _signal(self, given: GivenInput | None) -> Array:
        if given is not None:
            return given.u
        return self.offset + self._excitation(np.random.default_rng([self.seed, 0]))

    def _excitation(self, random: np.random.Generator) -> Array:
        options, t, amplitude = self.options, self.t, self.amplitude
        own = self.view.plant.omega_n / (2.0 * math.pi)
        most = 0.5 * self.config.loop.rate_hz
        frequency = own if options.frequency is None else options.frequency
        band = options.band or (0.1 * own, min(3.0 * own, 0.9 * most))
        if max(frequency, band[1]) >= most:
            raise ValueError(
                f"{max(frequency, band[1]):g} Hz must lie below half the loop's rate, {most:g} Hz"
            )
        if options.excitation == "sine":
            return sine(t, amplitude, frequency)
        if options.excitation == "steps":
            return steps(t, amplitude, frequency / 10.0 if options.frequency is None else frequency, random)
        if options.excitation == "multisine":
            period = options.period or len(t) / self.config.loop.rate_hz
            return multisine(t, amplitude, band, period, options.lines, random)
        return sweep(t, amplitude, band, linear=options.excitation == "linear-sweep")


def _with_plant(config: RigConfig, axis: str, effects: dict[str, dict[str, float]]) -> RigConfig:
    """The rig file with more effects on the axis' plant."""
    plant = plant_of(config, axis)
    simulation = config.simulation
    if simulation is None:
        raise ValueError("there is no `simulation:` section")
    plants = {
        name: with_effects(each, effects) if each is plant else each
        for name, each in simulation.plants.items()
    }
    return config.model_copy(update={"simulation": simulation.model_copy(update={"plants": plants})})


def _ticks(duration: float | None, rate: float) -> Array:
    duration = DURATION_S if duration is None else duration
    n = round(duration * rate)
    memory, there = n * BYTES_PER_ROW / 1e9, memory_bytes() / 1e9
    if memory > there:
        what = f"--duration {duration:g} s at {rate:g} Hz needs {memory:.3g} GB of memory, this computer has"
        raise ValueError(
            f"{what} {there:.3g} GB: a shorter one, several with other seeds, or a lower loop.rate_hz"
        )
    if n < 2:
        raise ValueError(
            f"a duration of {duration:g} s has {n} ticks at {rate:g} Hz; a recording needs two or more"
        )
    return np.arange(n) / rate
