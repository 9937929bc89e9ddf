"""The shape of a rig file: strict pydantic models; every number in SI once it is read.

A model sees only its own section. What concerns several (references, dimensions, rates) is in the rules
`wiring`, `numbers` and `access`, so that all mistakes of a file are told at once, each with its line.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, model_validator

from seod.config.calibration import CalibrationConfig
from seod.config.excitation import ExcitationConfig
from seod.config.gain import Gain, GainModel
from seod.config.gain_in_force import gain_range, is_identified
from seod.config.mqtt import MqttConfig
from seod.config.section import (
    FINITE,
    POSITIVE,
    Command,
    GainDeviation,
    Hertz,
    Measured,
    Name,
    NonNegativePosition,
    NonNegativeSeconds,
    PositiveAcceleration,
    PositiveCommand,
    PositiveMeasured,
    PositivePosition,
    PositiveSpeed,
    Scale,
    Seconds,
    SecondsDeviation,
    Section,
    Slew,
    Speed,
    quantity,
)
from seod.config.sensors import SensorConfig
from seod.config.token_field import Token
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


class EnableConfig(Section):
    """A signal without which the amplifier does not obey: `on` while an axis moves."""

    channel: str
    """Output channel of the driver."""
    on: Annotated[float, FINITE] = 1.0
    """Channel's number [its own unit] from start to standstill."""
    off: Annotated[float, FINITE] = 0.0
    """Channel's number [likewise] otherwise: standing, after a fault, at the end, when the loop is dead."""
    drop_on_fault: bool = True
    """False: `on` all the time, for an amplifier that is safe only while it holds its valve at neutral."""

    @property
    def neutral(self) -> float:
        """Channel's number in a neutral command."""
        return self.off if self.drop_on_fault else self.on

    @model_validator(mode="after")
    def _two_numbers(self) -> Self:
        if self.on == self.off:
            raise ValueError(f"on and off are both {self.on:g}: they must differ")
        return self


class OutputConfig(Section):
    """The command of an axis, a voltage or a current, as a channel's number: raw = u * scale + offset."""

    channel: str
    """Output channel of the driver."""
    unit: Literal["V", "mV", "A", "mA"] = "V"
    """Unit in which `scale` takes the command; with A or mA the axis is commanded by a current."""
    scale: Scale = 1.0
    """Channel's number per `unit` [channel's unit / `unit`]; negative if wired the other way round."""
    offset: Annotated[float, FINITE] = 0.0
    """Channel's number at a command of 0 [channel's unit]."""
    enable: EnableConfig | None = None
    fixed: dict[str, Annotated[float, FINITE]] = Field(default_factory=dict)
    """Output channels with one number [the channel's unit] in every command, neutral too: modes, keys."""


class RelayConfig(Section):
    """The relay of Fig. 2, or of Fig. 6b."""

    e_a: PositiveCommand
    """Amplitude of the relay."""
    hysteresis: NonNegativePosition = 0.0
    """Half-width: switches at e = +hysteresis and -hysteresis."""
    bias: Command = 0.0
    """Added behind the relay, against a valve null shift."""


class HoldConfig(Section):
    """The hold that brings the actuator back to where it stood at start; in velocity mode, to its speed."""

    bandwidth: Annotated[float, *quantity("angular speed"), POSITIVE] = 5.0
    """K_L times the proportional gain [rad/s]."""
    output: PositiveCommand | None = None
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
    pulse: PositiveCommand | None = None
    """Height; e_a where left out."""
    duration: Seconds | None = None
    """Longest pulse; it ends early once the movement is seen. Left out: 50 ms, but at least ten samples."""
    movement: PositiveMeasured
    """Movement (in velocity mode: speed) that counts as seen; must be well above the sensor's noise."""


class LimitsConfig(Section):
    """What must never be passed. Output and slew clip; the others fault."""

    output: PositiveCommand
    """Largest command, either way."""
    slew: Slew | None = None
    """Fastest change of the command."""
    travel: tuple[Measured, Measured]
    """Lowest and highest position; in velocity mode, lowest and highest speed."""
    speed: PositiveSpeed | None = None
    """Highest speed, either way; in velocity mode `travel` tells it."""
    amplitude: PositivePosition
    """Half the peak-to-peak movement within one second of excitation.

    In velocity mode that of the relay's input, the integral of the speed's error.
    """
    growth: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 3.0
    """Largest growth [1] of the limit cycle within a second or a few periods, once it is at its amplitude."""
    excitation: Seconds
    """Longest excitation from start to stop; then stopped, not faulted."""
    K_L: tuple[Annotated[float, POSITIVE], Annotated[float, POSITIVE]] | None = None
    """Smallest and largest K_L that a client may set [axis unit/s/V]; left out: a tenth and ten times K_L.

    Where K_L is identified, a thousandth and a thousand times the first guess.
    """
    e_a: PositiveCommand | None = None
    """Smallest e_a that a client may set; where left out, 1/10000 of `output`. The largest is `output`."""


Method = Literal["wave", "exact", "peaks"]
METHODS = get_args(Method)


class EstimatorConfig(Section):
    """How zeta and omega_n are made of the limit cycle."""

    method: Method = "wave"
    """`wave`: maximum likelihood. `exact`: through the exact limit cycle. `peaks`: the paper's procedure."""
    cycles: Annotated[int, Field(ge=1, le=50)] = 4
    """Cycles that must agree, and that are averaged over; `wave` takes fewer where they differ."""
    lowpass: Hertz | None = None
    """Cut-off of the low-pass of section 2.3(2), used by `peaks`."""
    delay: NonNegativeSeconds = 0.0
    """Known delay between a command's leaving and the valve's input, and of the sensor."""
    K_L_sd: GainDeviation | None = None
    """Standard deviation of K_L as it is known, or `unknown`; left out: that of `calibration`."""
    delay_sd: SecondsDeviation | None = None
    """Likewise of `delay`. Neither there nor here: what the driver cannot know, mostly two periods."""


class AxisConfig(Section):
    """One actuator with its sensor, output, relay, estimator and limits."""

    mode: Literal["position", "velocity"] = "position"
    """What the relay controls: the position (Fig. 2), or a speed (Fig. 6b)."""
    sensor: str
    """Name of its sensor under `sensors`: of position, or in velocity mode of speed."""
    output: str
    """Name of its output under `outputs`."""
    K_L: Gain
    """Gain from command to speed: a number, such as `50 mm/s/V`, or else as in `seod.config.gain`."""
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

    _speed: str = PrivateAttr("rad/s")
    _command: str = PrivateAttr("V")

    @property
    def command_unit(self) -> str:
        """SI unit of its command: V or A."""
        return self._command

    @property
    def gain_unit(self) -> str:
        """SI unit of K_L."""
        return f"{self._speed}/{self._command}"

    @property
    def setting_units(self) -> dict[str, str]:
        """SI units of its settings, by their names."""
        command, position = self.command_unit, self._speed.removesuffix("/s")
        own = {"e_a": command, "bias": command, "hysteresis": position, "K_L": self.gain_unit}
        return own | ({"reference": self._speed} if self.mode == "velocity" else {})

    @property
    def measured_unit(self) -> str:
        """SI unit of what its sensor measures: of a position, in velocity mode of a speed."""
        return self._speed if self.mode == "velocity" else self._speed.removesuffix("/s")

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
    """Number [the channel's unit] that allows movement; any other, or silence, is an e-stop."""


EstopLines = Annotated[
    Annotated[EstopConfig, Tag("one")] | Annotated[list[EstopConfig], Tag("many"), Field(min_length=1)],
    Discriminator(lambda value: "many" if isinstance(value, list) else "one"),
]


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
    no_switch: Seconds = 2.0
    """A relay on a position that stays on one side for this long does not see its axis: another axis' sensor.

    Once its limit cycle is known, four times the longest half of it is the limit, and `frozen` at least.
    Longer than half a period of the slowest limit cycle that is expected.
    """
    rig_watchdog: Seconds | None = None
    """The amplifier's own watchdog: it goes to neutral when commands stop for this long.

    The last line of defence, when the whole computer dies. The daemon cannot see it: measure it on the rig.
    """
    overruns: OverrunConfig = OverrunConfig()
    estop: EstopLines | None = None
    """One channel or a list; any of them stops the rig."""
    foreign_command: Literal["fault", "warn"] = "fault"
    """When somebody else commands our actuators: a fault, or a warning and estimates of quality `fault`."""
    dead_man: Seconds | None = None
    """A client must call `keepalive` at least this often while a rig is excited, and stay connected."""
    gateway_lost: Literal["stop", "hold"] = "stop"
    """When the gateway process dies or hangs: `stop` is a fault, `hold` ends the excitation as `stop` does.

    With `hold` an axis goes back to where it stood at start, for loads that sink at neutral.
    """
    gateway_timeout: Seconds = 1.0
    """The gateway hangs if it has not turned for this long; it is killed then, and started again."""

    @property
    def estops(self) -> list[EstopConfig]:
        """All e-stop lines."""
        lines = self.estop
        return [] if lines is None else lines if isinstance(lines, list) else [lines]


class OrderConfig(Section):
    """How `start` without an axis excites the axes of a rig."""

    order: Literal["together", "in_turn"] = "together"
    """All at once, or one after the other, round and round, while the others hold their position."""
    turn: Seconds = 2.0
    """How long each is excited in its turn."""


class TlsConfig(Section):
    """Certificate and key in PEM files; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""

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
    read_token: Token | None = None
    """Who has it may read. Better in a file, or in the environment as SEOD_READ_TOKEN."""
    command_token: Token | None = None
    """Who has it may read and command. Better in a file, or in the environment as SEOD_COMMAND_TOKEN."""
    read_token_file: Annotated[str, Field(min_length=1)] | None = None
    """File that holds the read_token; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""
    command_token_file: Annotated[str, Field(min_length=1)] | None = None
    """File that holds the command_token; relative to the rig file, or $CREDENTIALS_DIRECTORY/NAME."""
    max_clients: Annotated[int, Field(ge=1, le=1000)] = 100
    """Connections at a time."""
    panel: bool = True
    """Whether the panel is served: a page for browsers, and `/metrics`. Address, TLS and tokens as above."""
    panel_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    """Its TCP port; 0 takes a free one. Left out: 80 above `port`, or a free one where that is 0."""
    scpi: bool = False
    """Whether SCPI commands are taken over TCP, with the same rights."""
    scpi_port: Annotated[int, Field(ge=0, le=65535)] = 5025
    """TCP port of SCPI; 0 takes a free one."""
    foxglove: bool = False
    """Whether live topics are served to Foxglove and Lichtblick, at `/foxglove` on the panel's port."""
    foxglove_origins: list[Annotated[str, Field(min_length=1)]] = Field(default=[])
    """Web pages that may read these topics, such as https://app.foxglove.dev; programs need none."""


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
