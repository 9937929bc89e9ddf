"""The shape of a rig file: strict pydantic models; every number in SI once it is read.

Cross references (channels, sensors, dimensions, rates) are checked in `seod.config.check`, so that all
mistakes of a file are told at once, each with its line.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from seod.config.units import parse_quantity, units_of
from sim.config import SimulationConfig

CONFIG_VERSION = 1


def _quantity(*dimensions: str) -> Any:
    pattern = "^ *[-+]?[0-9.]+([eE][-+]?[0-9]+)? *(" + "|".join(units_of(*dimensions)) + ") *$"
    return (
        BeforeValidator(lambda value: parse_quantity(value, *dimensions)),
        WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": pattern}]}),
    )


_FINITE = Field(allow_inf_nan=False)
_POSITIVE = Field(gt=0, allow_inf_nan=False)
_NON_NEGATIVE = Field(ge=0, allow_inf_nan=False)

Voltage = Annotated[float, *_quantity("voltage"), _FINITE]
PositiveVoltage = Annotated[float, *_quantity("voltage"), _POSITIVE]
Slew = Annotated[float, *_quantity("slew rate"), _POSITIVE]
Position = Annotated[float, *_quantity("angle", "length"), _FINITE]
PositivePosition = Annotated[float, *_quantity("angle", "length"), _POSITIVE]
NonNegativePosition = Annotated[float, *_quantity("angle", "length"), _NON_NEGATIVE]
PositiveSpeed = Annotated[float, *_quantity("angular speed", "speed"), _POSITIVE]
Seconds = Annotated[float, *_quantity("time"), _POSITIVE]
NonNegativeSeconds = Annotated[float, *_quantity("time"), _NON_NEGATIVE]
Hertz = Annotated[float, *_quantity("frequency"), _POSITIVE]


class Section(BaseModel):
    """A mapping of the rig file: unknown keys are errors, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class LoopConfig(Section):
    """Timing of the loop."""

    rate_hz: Annotated[float, *_quantity("frequency"), Field(ge=100, le=10_000)] = 2000.0
    pace: Literal["timer", "sensor"] = "timer"
    """`timer`: a tick each period. `sensor`: a tick at each sample of the first axis' sensor."""
    priority: Annotated[int, Field(ge=1, le=98)] = 50
    """SCHED_FIFO priority of the loop; the supervisor runs one above."""
    cpu: Annotated[int, Field(ge=0)] | None = None
    """Processor to pin the loop to."""
    hang_timeout: Seconds = 0.05
    """The supervisor writes neutral and fences the loop when no tick came for this long."""


class SensorConfig(Section):
    """A channel made into a physical quantity: value = (raw * scale + offset) in `unit`."""

    channel: str
    unit: str
    """Unit of the scaled value; converted to SI inside."""
    scale: Annotated[float, _FINITE] = 1.0
    offset: Annotated[float, _FINITE] = 0.0
    """In `unit`."""


class OutputConfig(Section):
    """A command voltage made into a channel's number: raw = V * scale + offset."""

    channel: str
    unit: Literal["V", "mV"] = "V"
    """Unit in which `scale` takes the voltage."""
    scale: Annotated[float, _FINITE] = 1.0
    """Negative for an actuator wired the other way round."""
    offset: Annotated[float, _FINITE] = 0.0


class RelayConfig(Section):
    """The relay of Fig. 2."""

    e_a: PositiveVoltage
    hysteresis: NonNegativePosition = 0.0
    """Half-width: switches at e = +hysteresis and -hysteresis."""
    bias: Voltage = 0.0
    """Added behind the relay, against a valve null shift."""


class ExcitationConfig(Section):
    """When the relay is on."""

    kind: Literal["continuous", "burst"] = "continuous"
    duration: Seconds = 0.5
    """Length of a burst (the paper's 0.05-0.8 s)."""
    pause: NonNegativeSeconds = 1.0
    """Time between bursts, spent holding the position."""
    entry: NonNegativeSeconds = 0.05
    """The relay's amplitude rises from 0 to e_a in this time."""


class HoldConfig(Section):
    """The position hold that brings the actuator back to where it stood at start."""

    bandwidth: Annotated[float, *_quantity("angular speed"), _POSITIVE] = 5.0
    """K_L times the proportional gain [rad/s]."""
    output: PositiveVoltage | None = None
    """Limit of its output; e_a where left out."""
    tolerance: PositivePosition | None = None
    """Within this of the start the hold ends; where left out, a tenth of the limit cycle's amplitude limit."""
    timeout: Seconds = 3.0
    """The hold ends after this, wherever it is."""


class PolarityConfig(Section):
    """A small guarded pulse before the loop is closed: does a positive voltage move the sensor up?"""

    enabled: bool = True
    pulse: PositiveVoltage | None = None
    """Height; e_a where left out."""
    duration: Seconds = 0.05
    """Longest pulse; it ends early once the movement is seen."""
    movement: PositivePosition
    """Movement that counts as seen; must be well above the sensor's noise."""


class LimitsConfig(Section):
    """What must never be passed. Output and slew clip; the others fault."""

    output: PositiveVoltage
    slew: Slew | None = None
    travel: tuple[Position, Position]
    speed: PositiveSpeed
    amplitude: PositivePosition
    """Half the peak-to-peak movement within one second of excitation."""
    excitation: Seconds
    """Longest excitation from start to stop; then stopped, not faulted."""


class EstimatorConfig(Section):
    """How zeta and omega_n are made of the limit cycle."""

    method: Literal["peaks", "exact"] = "exact"
    cycles: Annotated[int, Field(ge=1, le=50)] = 4
    lowpass: Hertz | None = None
    """Cut-off of the low-pass of section 2.3(2), used by `peaks`."""
    delay: NonNegativeSeconds = 0.0
    """Known delay between a command's leaving and the valve's input, and of the sensor."""


class AxisConfig(Section):
    """One actuator with its sensor, output, relay, estimator and limits."""

    mode: Literal["position"] = "position"
    sensor: str
    output: str
    K_L: Annotated[float, _POSITIVE]
    """Gain [SI unit of the sensor per second and volt]."""
    relay: RelayConfig
    limits: LimitsConfig
    polarity: PolarityConfig
    excitation: ExcitationConfig = ExcitationConfig()
    filter: Hertz | None = None
    """Cut-off of a first-order low-pass in front of the relay."""
    hold: HoldConfig = HoldConfig()
    estimator: EstimatorConfig = EstimatorConfig()


class EstopConfig(Section):
    """An input channel that must have a value for anything to move."""

    channel: str
    run: float = 1.0
    """Value that allows movement; any other value, or silence, is an e-stop."""


class OverrunConfig(Section):
    """A burst of late ticks."""

    count: Annotated[int, Field(ge=1)] = 10
    window: Seconds = 0.1


class GuardConfig(Section):
    """What stops the rig."""

    stale: Seconds = 0.01
    """Oldest sample that may be acted on."""
    frozen: Seconds = 0.25
    """A sensor that repeats one value for this long while the relay is on is frozen."""
    overruns: OverrunConfig = OverrunConfig()
    estop: EstopConfig | None = None
    dead_man: Seconds | None = None
    """A client must call `keepalive` at least this often while a rig is excited."""


class TlsConfig(Section):
    """Certificate and key in PEM files; relative to the rig file."""

    certificate: str
    key: str


class ServerConfig(Section):
    """The TCP server. Beyond loopback it needs TLS and tokens."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 7600
    tls: TlsConfig | None = None
    read_token: Annotated[str, Field(min_length=16)] | None = None
    command_token: Annotated[str, Field(min_length=16)] | None = None
    max_clients: Annotated[int, Field(ge=1, le=1000)] = 100


class RigConfig(Section):
    """A whole rig file."""

    version: Literal[1]
    rig: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
    driver: dict[str, Any]
    """`kind` and that driver's own options (checked by the driver's model)."""
    loop: LoopConfig = LoopConfig()
    sensors: dict[str, SensorConfig] = Field(min_length=1)
    outputs: dict[str, OutputConfig] = Field(min_length=1)
    axes: dict[str, AxisConfig] = Field(min_length=1)
    guard: GuardConfig = GuardConfig()
    server: ServerConfig = ServerConfig()
    simulation: SimulationConfig | None = None
    """Present only for simulated rigs: the truth that `seod rig` and the virtual driver simulate."""
