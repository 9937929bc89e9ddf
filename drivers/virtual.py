"""Driver of the simulated rig, in process: no bus and no other end, nothing between loop and plant but time.

It keeps whatever time its clock tells: CLOCK_MONOTONIC in real time, or a simulated clock that steps as fast
as it can (`realtime: false`). The plant is always where that time says. The kernel behind it is imported by
`open`: reading a rig file does not pay for it.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from drivers.base import Channel, Driver, DriverError, DriverStateError, Sample
from sim.config import SimulationConfig

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sim.rig import SimulatedRig

NEUTRAL = 0.0
"""At which the load stands still [V]."""


class VirtualOptions(BaseModel):
    """The rig file's `driver:` section for kind `virtual`."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    kind: Literal["virtual"]
    realtime: bool = True
    """False: as fast as it can, on simulated time."""
    simulation: SimulationConfig | None = None
    """Filled from the rig file's top-level `simulation:` section."""


def _required(options: VirtualOptions) -> SimulationConfig:
    if options.simulation is None:
        raise DriverError("driver.kind: virtual needs a simulation: section")
    return options.simulation


def _unopened(call: str) -> DriverStateError:
    return DriverStateError(f"{call}: call open first")


class VirtualDriver(Driver):
    """Reads the plant at the tick's time and commands it at the clock's time."""

    Options = VirtualOptions
    push = True
    acts_on = "simulation"
    counter_names: ClassVar[tuple[str, ...]] = ("samples", "commands", "watchdog_trips")

    def __init__(self, options: VirtualOptions, clock: Callable[[], float]) -> None:
        super().__init__(options, clock)
        self.simulation = _required(options)
        self.realtime = options.realtime
        self.rig: SimulatedRig | None = None
        self._period = 1.0 / self.simulation.sensor_rate_hz
        self._next_sample = math.inf
        self._samplers: list[Callable[[float], tuple[float, float]]] = []
        self._amplifiers: list[Callable[[float, float], None]] = []
        self._neutral: list[float] = []

    @classmethod
    def channels(cls, options: VirtualOptions) -> tuple[Channel, ...]:
        """Plant inputs, what enables amplifiers, plant outputs, constants; in the rig file's units."""
        simulation = _required(options)
        plants = simulation.plants.values()
        return (
            *(Channel(plant.input, "output") for plant in plants),
            *(Channel(name, "output") for name in simulation.enabling_channels),
            *(Channel(plant.output, "input") for plant in plants),
            *(Channel(name, "input") for name in simulation.index_channels),
            *(Channel(name, "input") for name in simulation.constants),
        )

    def open(
        self, inputs: Sequence[str], outputs: Sequence[str], neutral: Sequence[float] | None = None
    ) -> None:
        """Build the rig, standing still."""
        if self.rig is not None:
            raise DriverStateError("the virtual rig is open already: close it first")
        known = {(c.name, c.direction) for c in self.channels(self.options)}
        asked = [(name, "input") for name in inputs] + [(name, "output") for name in outputs]
        for name, direction in asked:
            if (name, direction) not in known:
                there = ", ".join(sorted(n for n, d in known if d == direction))
                raise DriverError(f"no {direction} channel {name!r} in simulation:; there are {there}")
        from sim.rig import SimulatedRig  # noqa: PLC0415 - numba

        self.rig = SimulatedRig(self.simulation, self.clock())
        self._samplers = [self.rig.sampler(name) for name in inputs]
        self._amplifiers = [self.rig.amplifier(name) for name in outputs]
        self._neutral = [NEUTRAL] * len(outputs) if neutral is None else list(neutral)

    def start(self) -> None:
        """Let samples arrive, the first one sensor period from now."""
        if self.rig is None:
            raise _unopened("start")
        self._next_sample = self.clock() + self._period

    def wait(self, deadline: float) -> bool:
        """Sleep to the next sample or to `deadline` [s]; on simulated time, tell at once which is first."""
        if math.isinf(self._next_sample):
            raise DriverStateError("wait: call start first")
        due = self._next_sample
        fresh = due <= deadline
        left = min(due, deadline) - self.clock()
        if self.realtime and left > 0.0:
            time.sleep(left)
        if fresh:  # samples that passed while nobody waited are gone
            passed = (self.clock() - due) // self._period
            self._next_sample = due + self._period * max(1.0, passed + 1.0)
        return fresh

    def read(self, t: float) -> list[Sample]:
        """What each sensor says at `t` [s]: every reading is a new sample, but those that never came."""
        if self.rig is None:
            raise _unopened("read")
        samples = [Sample(*sample(t)) for sample in self._samplers]
        self.counters[0] += 1
        self.counters[2] = self.rig.watchdog_trips()
        return samples

    def write(self, t: float, values: Sequence[float]) -> float:  # noqa: ARG002 - the plant hears it now
        """Command each amplifier at the clock's time, which is returned [s]."""
        if self.rig is None:
            raise _unopened("write")
        now = self.clock()
        for amplifier, value in zip(self._amplifiers, values, strict=True):
            amplifier(now, value)
        self.counters[1] += 1
        return now

    def untold_delay(self, tick: float) -> float:
        """By the slower of loop and sensor."""
        return super().untold_delay(max(tick, self._period))

    def neutral(self, t: float) -> float:
        """Command 0 V."""
        return self.write(t, self._neutral)

    def close(self) -> None:
        """Forget the rig."""
        self.rig = None
        self._next_sample = math.inf

    def truth(self) -> Mapping[str, Mapping[str, float | None]]:
        """True K_L [channel unit/s/V], omega_n [rad/s] and zeta by plant name, as the rig begins."""
        from sim.truth import rig_truth  # noqa: PLC0415 - numerics

        return rig_truth(self.simulation)
