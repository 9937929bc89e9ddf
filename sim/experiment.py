"""A plant of a rig file under an excitation: what a recording of it would hold, defects included.

Numbers are the plant's own: volts as they reach it, position in its unit, speed in that per second. A seed
makes noise and defects; the same seed makes the same recording, bit for bit.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sim.defects import jittered, missing_samples, outliers
from sim.machine import NONE, Machine, make_machine
from sim.parameters import plant_parameters
from sim.runs import RELAY
from sim.sensor_config import AbsoluteEncoderTruth, FvConverterTruth, IncrementalEncoderTruth

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    from sim.config import PlantConfig

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Relay:
    """The relay of Fig. 2, or with `velocity` that of Fig. 6b, in the plant's numbers.

    Attributes:
        e_a: Amplitude [V].
        hysteresis: Half-width [unit].
        bias: Added to it [V].
        reference: In velocity mode the speed to swing about [unit/s].
        entry: Its amplitude rises from 0 to e_a in this time [s].
        velocity: Velocity mode.
        cycles: Cycles of each phase of the two-phase relay; 0 for one phase.
        shift: Periods by which it is late in the second phase.
    """

    e_a: float
    hysteresis: float = 0.0
    bias: float = 0.0
    reference: float = 0.0
    entry: float = 0.0
    velocity: bool = False
    cycles: int = 0
    shift: float = 0.25


@dataclass(frozen=True)
class Recording:
    """Rows of a recording; arrays of one length.

    Attributes:
        t: What the samples' timestamps say [s].
        u: Command computed from the row [V].
        y: Reading [unit, or unit/s]; nan where the sample is missing.
        t_u: When `u` left [s].
    """

    t: Array
    u: Array
    y: Array
    t_u: Array


@dataclass
class Experiment:
    """One plant, when it is looked at, and in what surroundings.

    Attributes:
        plant: It, with its effects.
        t: Times of the samples [s], ascending.
        seed: Of noise and defects.
        noise: Standard deviation of the sensor's noise [unit, or unit/s].
        latency: From a sample to the command's leaving [s].
        supply: Supply pressure over nominal: one for each time, or none where it stays nominal.
        warmth: Temperature above nominal [K], likewise.
        force: What is measured of a disturbance, likewise.
        approach: Command held before the first sample, until the plant has settled [V]; None: at rest.
        machine: What runs: the reduced kernel or the physical plant.

    Raises:
        ValueError: Effects that contradict each other or the sensor.
    """

    plant: PlantConfig
    t: Array
    seed: int = 1
    noise: float = 0.0
    latency: float = 0.0
    supply: Array = field(default_factory=lambda: NONE)
    warmth: Array = field(default_factory=lambda: NONE)
    force: Array = field(default_factory=lambda: NONE)
    approach: float | None = None
    machine: Machine = field(init=False)

    def __post_init__(self) -> None:
        plant, start = with_effects(self.plant, sensor_effects(self.plant)), float(self.t[0])
        self.machine = make_machine(plant, start)
        if self.approach is not None:
            self.machine = make_machine(plant, start - self.machine.settling(self.approach))
        self.state["origin"] = start
        self.machine.surround(self.supply, self.warmth)

    @property
    def p(self) -> NDArray[np.void]:
        """The kernel's parameters, shape (1,)."""
        return self.machine.p

    @property
    def state(self) -> NDArray[np.void]:
        """The kernel's state, shape (1,): `state["t"]` tells how far it has come, also while it runs."""
        return self.machine.state

    @property
    def _around(self) -> tuple[Array, Array, Array]:
        return self.supply, self.warmth, self.force

    def run_given(self, u: Array) -> Recording:
        """Under given commands [V], one for each time."""
        seen, noise = self._begin()
        t_u = self.t + self.latency
        y = self.machine.follow(t_u, u, seen, noise, self._around)
        return self._recorded(u, y, t_u)

    def run_relay(self, relay: Relay) -> Recording:
        """In the limit cycle of a relay that looks at the times; in position mode about the plant's start.

        Raises:
            ValueError: The readings reach the end of the sensor's range.
        """
        seen, noise = self._begin()
        y, u, t_u = self.machine.relay(self._kernel_relay(relay), seen, noise, self._around)
        low, high = sensor_range(self.plant)
        if y.min() < low or y.max() > high:
            raise ValueError(
                f"the F/V converter clips at {low:g} and {high:g}, and the relay would see that: "
                "let it swing less or further away"
            )
        return self._recorded(u, y, t_u)

    def _kernel_relay(self, relay: Relay) -> NDArray[np.void]:
        r = np.zeros(1, RELAY)
        r["e_a"], r["hysteresis"], r["bias"] = relay.e_a, relay.hysteresis, relay.bias
        r["reference"] = relay.reference if relay.velocity else self.plant.position
        r["entry"], r["latency"], r["velocity_mode"] = relay.entry, self.latency, relay.velocity
        r["cycles"], r["shift"] = relay.cycles, relay.shift
        return r

    def _begin(self) -> tuple[Array, Array]:
        """Brings the plant to the first time; when the samples are really taken, and their noise."""
        if self.approach is not None:
            before, volts, start = self.state["t"].copy(), np.array([self.approach]), self.t[:1]
            self.machine.follow(before, volts, start, NONE, (NONE, NONE, NONE))
            self.machine.forget_readings()
        seen = jittered(self.t, float(self.p["timing_jitter_deviation"][0]), self._random("timing_jitter"))
        noise = self._random("noise").normal(0.0, self.noise, len(seen)) if self.noise else NONE
        return seen, noise

    def _recorded(self, u: Array, y: Array, t_u: Array) -> Recording:
        """The record, with its defects."""
        p, n = self.p[0], len(y)
        off = outliers(n, float(p["outliers_rate"]), float(p["outliers_size"]), self._random("outliers"))
        rate, length = float(p["missing_samples_rate"]), float(p["missing_samples_length"])
        missing = missing_samples(n, rate, length, self._random("missing_samples"))
        return Recording(self.t, u, np.where(missing, math.nan, y + off), t_u)

    def _random(self, purpose: str) -> Generator:
        """A stream of its own for each purpose, so that one effect does not change the others' numbers."""
        return np.random.default_rng([self.seed, zlib.crc32(purpose.encode())])


def plant_record(plant: PlantConfig) -> NDArray[np.void]:
    """The reduced kernel's parameters of a plant with its sensor: lag, counts and ripple are effects there.

    Raises:
        ValueError: The sensor and an effect say two different things.
    """
    return plant_parameters(with_effects(plant.reduced, sensor_effects(plant)))


def with_effects(plant: PlantConfig, more: dict[str, dict[str, float]]) -> PlantConfig:
    """The plant with these parameters of effects in place of its own, the others kept."""
    effects = {name: dict(values) for name, values in plant.effects.items()}
    for name, values in more.items():
        effects.setdefault(name, {}).update(values)
    return plant.model_copy(update={"effects": effects})


def sensor_effects(plant: PlantConfig) -> dict[str, dict[str, float]]:
    """What the `sensor` of a plant does, in the terms of the kernel's effects.

    Raises:
        ValueError: The plant has such an effect already.
    """
    sensor, found = plant.sensor, dict[str, dict[str, float]]()
    if sensor is None:
        return found
    if sensor.lag:
        found["sensor_lag"] = {"time": sensor.lag}
    if isinstance(sensor, FvConverterTruth) and sensor.ripple and sensor.ripples_per_unit:
        wavenumber = 2.0 * math.pi * sensor.ripples_per_unit
        found["position_ripple"] = {"amplitude": sensor.ripple / wavenumber, "wavenumber": wavenumber}
    for name in found:
        if any(plant.effects.get(name, {}).values()):
            raise ValueError(f"effect {name}: the plant's sensor has it already; leave one of them out")
    if count := count_size(plant):
        coarser = max(count, plant.effects.get("sensor_quantization", {}).get("step", 0.0))
        found["sensor_quantization"] = {"step": coarser}
    return found


def count_size(plant: PlantConfig) -> float:
    """Movement for each count of its encoder [unit]; 0 where it has none."""
    if isinstance(plant.sensor, IncrementalEncoderTruth):
        return 1.0 / abs(plant.sensor.counts_per_unit)
    if isinstance(plant.sensor, AbsoluteEncoderTruth):
        return 2.0 * math.pi / plant.sensor.counts_per_rev
    return 0.0


def sensor_range(plant: PlantConfig) -> tuple[float, float]:
    """Lowest and highest speed that its F/V converter tells [unit/s]; infinite for other sensors."""
    sensor = plant.sensor
    if not isinstance(sensor, FvConverterTruth):
        return -math.inf, math.inf
    ends = sorted((volts - sensor.offset_v) / sensor.volts_per_unit for volts in sensor.clip)
    return ends[0], ends[1]
