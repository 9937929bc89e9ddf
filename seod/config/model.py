"""The shape of a rig file: strict pydantic models; every number in SI once it is read.

A model sees only its own section. What concerns several (references, dimensions, rates) is in the rules
`wiring`, `numbers` and `access`, so that all mistakes of a file are told at once, each with its line.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from seod.config.axis import AxisConfig
from seod.config.guard import GuardConfig
from seod.config.mqtt import MqttConfig
from seod.config.outputs import OutputConfig
from seod.config.section import (
    POSITIVE,
    Name,
    Seconds,
    Section,
    quantity,
)
from seod.config.sensors import SensorConfig
from seod.config.server import ServerConfig
from seod.config.units import BASE, RATES, UNITS
from seod.files.user_files import BUS_LOG_ENDINGS
from sim.config import SimulationConfig

CONFIG_VERSION = 1


class LoopConfig(Section):
    """Timing of the loop."""

    rate_hz: Annotated[float, *quantity("frequency"), Field(ge=100, le=10_000)] = 2000.0
    """Ticks per second."""
    pace: Literal["timer", "sensor"] = "timer"
    """`timer`: a tick each period. `sensor`: a tick at each sample of the first axis' sensor."""
    priority: Annotated[int, Field(ge=1, le=98)] = 50
    """SCHED_FIFO priority of the loop; the supervisor runs one above."""
    cpu: Annotated[int, Field(ge=0)] | None = None
    """Processor to pin the loop to."""
    hang_timeout: Seconds = 0.05
    """The supervisor writes neutral and fences the loop when no tick came for this long."""


class OrderConfig(Section):
    """How `start` without an axis excites the axes of a rig."""

    order: Literal["together", "in_turn"] = "together"
    """All at once, or one after the other, round and round, while the others hold their position."""
    turn: Seconds = 2.0
    """How long each is excited in its turn."""


def _bus_log(name: str) -> str:
    if not name.lower().endswith(BUS_LOG_ENDINGS):
        *most, last = BUS_LOG_ENDINGS
        raise ValueError(f"must end in {', '.join(most)} or {last}")
    return name


class RecordConfig(Section):
    """Recordings that `seod run --record FILE` makes."""

    max_megabytes: Annotated[float, POSITIVE] | None = 1000.0
    """An MCAP file that has reached this size [MB] is ended and the next one begun; null for never."""
    max_time: Seconds | None = 3600.0
    """Likewise after this time."""
    folder: Annotated[str, Field(min_length=1)] | None = None
    """Where recordings that are begun while it runs go; relative to the rig file. Left out: none can be."""
    bus_log: Annotated[str, AfterValidator(_bus_log)] | None = None
    """Raw frames of the CAN bus into this file, in the format of its suffix: .blf, .asc, .log, .mf4."""


class RigConfig(Section):
    """A whole rig file."""

    version: Literal[1]
    """Version of this file's form."""
    rig: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
    """Name of the rig; one daemon runs for each."""
    driver: dict[str, Any]
    """`kind` and that driver's own options (checked by the driver's model)."""
    loop: LoopConfig = LoopConfig()
    sensors: dict[Name, SensorConfig] = Field(min_length=1)
    """Sensors by name: each makes a channel's number a physical quantity."""
    outputs: dict[Name, OutputConfig] = Field(min_length=1)
    """Outputs by name: each makes the command of one axis a channel's number."""
    axes: dict[Name, AxisConfig] = Field(min_length=1)
    """Axes by name: each an actuator with its sensor and output."""
    excitation: OrderConfig = OrderConfig()
    guard: GuardConfig = GuardConfig()
    server: ServerConfig = ServerConfig()
    record: RecordConfig = RecordConfig()
    mqtt: MqttConfig | None = None
    """The broker through which the rig is one of a fleet; left out: none."""
    simulation: SimulationConfig | None = None
    """Present only for simulated rigs: the truth that `seod rig` and the virtual driver simulate."""

    @model_validator(mode="after")
    def _units(self) -> Self:
        """Each axis knows in which units it moves and is commanded."""
        for axis in self.axes.values():
            if axis.sensor in self.sensors:
                speed = RATES.get(self.sensors[axis.sensor].dimension, self.sensors[axis.sensor].dimension)
                axis._speed = BASE.get(speed, axis._speed)
            if axis.output in self.outputs:
                axis._command = BASE[UNITS[self.outputs[axis.output].unit][0]]
        return self
