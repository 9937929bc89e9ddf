"""The shape of a rig file: strict pydantic models; every number in SI once it is read.

A model sees only its own section. What concerns several (references, dimensions, rates) is in the rules
`wiring`, `numbers` and `access`, so that all mistakes of a file are told at once, each with its line.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from seod.config.calibration import CalibrationConfig
from seod.config.excitation import ExcitationConfig
from seod.config.gain import Gain, GainModel
from seod.config.section import (
    FINITE,
    POSITIVE,
    Deviation,
    Hertz,
    Measured,
    Name,
    NonNegativePosition,
    NonNegativeSeconds,
    PositiveAcceleration,
    PositiveMeasured,
    PositivePosition,
    PositiveSpeed,
    PositiveVoltage,
    Scale,
    Seconds,
    SecondsDeviation,
    Section,
    Slew,
    Speed,
    Voltage,
    quantity,
)
from seod.config.sensors import SensorConfig
from seod.gain import gain_range, is_identified
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


class OutputConfig(Section):
    """A command voltage made into a channel's number: raw = V * scale + offset."""

    channel: str
    """Output channel of the driver."""
    unit: Literal["V", "mV"] = "V"
    """Unit in which `scale` takes the voltage."""
    scale: Scale = 1.0
    """Channel's number per `unit`; negative for an actuator wired the other way round."""
    offset: Annotated[float, FINITE] = 0.0
    """Channel's number at 0 V."""


class RelayConfig(Section):
    """The relay of Fig. 2, or of Fig. 6b."""

    e_a: PositiveVoltage
    """Amplitude of the relay."""
    hysteresis: NonNegativePosition = 0.0
    """Half-width: switches at e = +hysteresis and -hysteresis."""
    bias: Voltage = 0.0
    """Added behind the relay, against a valve null shift."""


class HoldConfig(Section):
    """The hold that brings the actuator back to where it stood at start; in velocity mode, to its speed."""

    bandwidth: Annotated[float, *quantity("angular speed"), POSITIVE] = 5.0
    """K_L times the proportional gain [rad/s]."""
    output: PositiveVoltage | None = None
    """Limit of its output; e_a where left out."""
    tolerance: PositiveMeasured | None = None
    """Within this of the start the hold ends; where left out, a tenth of limits.amplitude.

    In velocity mode within this of the wanted speed; where left out, half of K_L e_a.
    """
    timeout: Seconds = 3.0
    """The hold ends after this, wherever it is."""


class PolarityConfig(Section):
    """A small guarded pulse before the loop is closed: does a positive voltage move the sensor up?"""

    enabled: bool = True
    """Only a rig that cannot be hurt should do without."""
    pulse: PositiveVoltage | None = None
    """Height; e_a where left out."""
    duration: Seconds = 0.05
    """Longest pulse; it ends early once the movement is seen."""
    movement: PositiveMeasured
    """Movement (in velocity mode: speed) that counts as seen; must be well above the sensor's noise."""


class LimitsConfig(Section):
    """What must never be passed. Output and slew clip; the others fault."""

    output: PositiveVoltage
    """Largest voltage, either way."""
    slew: Slew | None = None
    """Fastest change of the voltage."""
    travel: tuple[Measured, Measured]
    """Lowest and highest position; in velocity mode, lowest and highest speed."""
    speed: PositiveSpeed | None = None
    """Highest speed, either way; in velocity mode `travel` tells it."""
    amplitude: PositivePosition
    """Half the peak-to-peak movement within one second of excitation.

    In velocity mode that of the relay's input, the integral of the speed's error.
    """
    growth: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 3.0
    """Largest growth of the limit cycle within a second or a few periods, once it is at its amplitude."""
    excitation: Seconds
    """Longest excitation from start to stop; then stopped, not faulted."""


class EstimatorConfig(Section):
    """How zeta and omega_n are made of the limit cycle."""

    method: Literal["wave", "exact", "peaks"] = "wave"
    """`wave`: maximum likelihood. `exact`: through the exact limit cycle. `peaks`: the paper's procedure."""
    cycles: Annotated[int, Field(ge=1, le=50)] = 4
    """Cycles that must agree, and that are averaged over; `wave` takes fewer where they differ."""
    lowpass: Hertz | None = None
    """Cut-off of the low-pass of section 2.3(2), used by `peaks`."""
    delay: NonNegativeSeconds = 0.0
    """Known delay between a command's leaving and the valve's input, and of the sensor."""
    K_L_sd: Deviation | None = None
    """Standard deviation of K_L as it is known, [as K_L], or `unknown`; left out: that of `calibration`."""
    delay_sd: SecondsDeviation | None = None
    """Likewise of `delay`. Neither there nor here: the value is taken as certain."""


class AxisConfig(Section):
    """One actuator with its sensor, output, relay, estimator and limits."""

    mode: Literal["position", "velocity"] = "position"
    """What the relay controls: the position (Fig. 2), or a speed (Fig. 6b)."""
    sensor: str
    """Name of its sensor under `sensors`: of position, or in velocity mode of speed."""
    output: str
    """Name of its output under `outputs`."""
    K_L: Gain
    """Gain [SI unit of the position per second and volt]: a number, or else as in `seod.config.gain`."""
    supply_pressure: str | None = None
    """Name of a sensor of pressure under `sensors`."""
    temperature: str | None = None
    """Name of a sensor of the oil's temperature under `sensors`; recorded beside the estimates."""
    reference: Speed | None = None
    """Velocity mode: the speed about which it oscillates."""
    ramp: PositiveAcceleration | None = None
    """Velocity mode: how fast the speed is changed; where left out, 2 e_a K_L per second."""
    trim: bool = True
    """Velocity mode: correct the bias behind the relay until both halves of a cycle are equally long."""
    relay: RelayConfig
    limits: LimitsConfig
    polarity: PolarityConfig
    excitation: ExcitationConfig = ExcitationConfig()
    filter: Hertz | None = None
    """Cut-off of a first-order low-pass in front of the relay."""
    hold: HoldConfig = HoldConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    calibration: CalibrationConfig | None = None
    """Written by `seod calibrate`."""

    @property
    def two_phase(self) -> bool:
        """Whether the excitation begins with two phases."""
        enabled = self.excitation.two_phase.enabled
        return is_identified(self.K_L) if enabled is None else enabled

    @model_validator(mode="after")
    def _first_guess(self) -> Self:
        """A gain of which nothing is known is at most what the relay may move the axis by without a fault.

        So the hold, whose gain is the inverse, is slow at first but never unstable.
        """
        speed = self.limits.speed
        if is_identified(self.K_L) and gain_range(self.K_L)[0] == 0.0 and speed is not None:
            guess = GainModel(identified=speed / self.relay.e_a)
            object.__setattr__(self, "K_L", guess)  # frozen for everyone else
        return self


class EstopConfig(Section):
    """An input channel that must have a value for anything to move."""

    channel: str
    """Input channel of the driver."""
    run: Annotated[float, FINITE] = 1.0
    """Value that allows movement; any other value, or silence, is an e-stop."""


class OverrunConfig(Section):
    """A burst of late ticks."""

    count: Annotated[int, Field(ge=1)] = 10
    """So many late ticks"""
    window: Seconds = 0.1
    """within this time are a fault."""


class GuardConfig(Section):
    """What stops the rig."""

    fault_policy: Literal["rig", "axis"] = "rig"
    """What a fault of one axis (travel, speed, sensor, polarity ...) stops: all axes, or that one alone.

    E-stop, link, late ticks, a dead process and the dead man always stop all.
    """
    stale: Seconds = 0.01
    """Oldest sample that may be acted on."""
    frozen: Seconds = 0.25
    """A sensor that repeats one value for this long while the relay is on is frozen."""
    rig_watchdog: Seconds | None = None
    """The amplifier's own watchdog: it goes to neutral when commands stop for this long.

    The last line of defence, when the whole computer dies. The daemon cannot see it: measure it on the rig.
    """
    overruns: OverrunConfig = OverrunConfig()
    estop: EstopConfig | None = None
    dead_man: Seconds | None = None
    """A client must call `keepalive` at least this often while a rig is excited."""


class OrderConfig(Section):
    """How `start` without an axis excites the axes of a rig."""

    order: Literal["together", "in_turn"] = "together"
    """All at once, or one after the other, round and round, while the others hold their position."""
    turn: Seconds = 2.0
    """How long each is excited in its turn."""


class TlsConfig(Section):
    """Certificate and key in PEM files; relative to the rig file."""

    certificate: str
    """Certificate chain, the server's own first."""
    key: str
    """Private key, without a pass phrase."""


class ServerConfig(Section):
    """The TCP server. Beyond loopback it needs TLS and tokens."""

    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    """Address to listen on."""
    port: Annotated[int, Field(ge=0, le=65535)] = 7600
    """TCP port; 0 takes a free one."""
    tls: TlsConfig | None = None
    read_token: Annotated[str, Field(min_length=16)] | None = None
    """Who has it may read."""
    command_token: Annotated[str, Field(min_length=16)] | None = None
    """Who has it may read and command."""
    max_clients: Annotated[int, Field(ge=1, le=1000)] = 100
    """Connections at a time."""


class RecordConfig(Section):
    """Recordings that `seod run --record FILE` makes."""

    max_megabytes: Annotated[float, POSITIVE] | None = 1000.0
    """An MCAP file that has reached this size is ended and the next one begun; null for never."""
    max_time: Seconds | None = 3600.0
    """Likewise after this time."""
    bus_log: Annotated[str, Field(min_length=1)] | None = None
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
    outputs: dict[Name, OutputConfig] = Field(min_length=1)
    axes: dict[Name, AxisConfig] = Field(min_length=1)
    excitation: OrderConfig = OrderConfig()
    guard: GuardConfig = GuardConfig()
    server: ServerConfig = ServerConfig()
    record: RecordConfig = RecordConfig()
    simulation: SimulationConfig | None = None
    """Present only for simulated rigs: the truth that `seod rig` and the virtual driver simulate."""
