"""The rig file's `simulation:` section: the truth of a simulated rig. Plain SI numbers. Needs no numba."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from sim.effect_config import Effects
from sim.effects import contradiction
from sim.hydraulics.linear import small_signal
from sim.hydraulics.parts import Hydraulic
from sim.hydraulics.parts import contradiction as unsound
from sim.hydraulics.record import record_of, unfit
from sim.sensor_config import AnySensor, Finite, IncrementalEncoderTruth, NonNegative, Positive

FOLLOWING = ("K_L", "omega_n", "zeta")
"""What follows from the parts of a hydraulic plant."""
UNKNOWN = sys.float_info.min
"""Stands for one of these until the parts are known."""
REDUCED = ("transport_delay", "sensor_lag", "sensor_quantization")
"""Effects of a hydraulic plant that its reduced one keeps."""
AGREES = 1e-6
"""Part by which one that is written all the same may be off."""


def _own_schema(schema: dict[str, Any]) -> None:
    """K_L, omega_n and zeta are required of a reduced plant alone, `hydraulic` of the other."""
    schema["required"] = [name for name in schema["required"] if name not in FOLLOWING]
    kind = {"properties": {"plant": {"const": "hydraulic"}}, "required": ["plant"]}
    schema |= {"if": kind, "then": {"required": ["hydraulic"]}, "else": {"required": list(FOLLOWING)}}


class PlantConfig(BaseModel):
    """One actuator: G_L of Eq. 1 from volts to velocity, position its integral, and what else is in it.

    With `plant: hydraulic` it is described by its parts instead, from which K_L, omega_n and zeta follow.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        use_attribute_docstrings=True,
        json_schema_extra=_own_schema,
    )

    plant: Literal["reduced", "hydraulic"] = "reduced"
    """Eq. 1 with effects, or valve, chambers and load in physical units."""
    hydraulic: Hydraulic | None = None
    """Parts of a hydraulic plant."""
    input: str
    """Channel of the command voltage."""
    output: str
    """Channel of what is measured."""
    measures: Literal["position", "velocity"] = "position"
    """What the channel carries where there is no `sensor`; `output unit` is that of the position."""
    K_L: Positive
    """Gain [(output unit)/s/V]."""
    omega_n: Positive
    """Undamped natural frequency [rad/s]."""
    zeta: Positive
    """Damping ratio [1]."""
    effects: Effects = Field(default_factory=dict)
    """What it has beyond Eq. 1, as in `sim/effects.py`: {effect: {parameter: value}}."""
    position: Finite = 0.0
    """Position at start [output unit]."""
    noise: NonNegative = 0.0
    """Standard deviation of the sensor's white noise [output unit, for a speed per s]."""
    stops: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = None
    """End stops [output unit]: the load stands still there."""
    sensor: AnySensor | None = None
    """What measures it; then the `output unit` is rad or m (for the noise of a speed, per s)."""
    enabled_by: dict[str, Finite] = {}
    """Command channels and the numbers [the channel's unit] without which the amplifier puts out neutral."""

    supply_pressure: str | None = None
    """Constant whose number is in proportion to the supply pressure: effects follow it."""
    nominal_pressure: Positive | None = None
    """Its number [that constant's unit] at which K_L, omega_n and zeta are what is written here."""
    temperature: str | None = None
    """Constant that tells the oil's temperature [K, or deg C]."""
    nominal_temperature: Finite | None = None
    """Its number [K, or deg C] at which K_L, omega_n and zeta are what is written here."""

    @model_validator(mode="before")
    @classmethod
    def _parts_tell_the_rest(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("plant") == "hydraulic":
            return {**dict.fromkeys(FOLLOWING, UNKNOWN), **data}
        return data

    @model_validator(mode="after")
    def _parts_fit(self) -> PlantConfig:
        if (self.plant == "hydraulic") != (self.hydraulic is not None):
            raise ValueError("`plant: hydraulic` and a section `hydraulic:` go together: give both or none")
        if self.hydraulic is None:
            return self
        if wrong := unsound(self.hydraulic):
            raise ValueError(f"hydraulic: {wrong}")
        if wrong := unfit(self.effects):
            raise ValueError(f"effects: {wrong}")
        self._follow_from_parts()
        return self

    def _follow_from_parts(self) -> None:
        try:
            small = small_signal(record_of(self), position=self.position)
        except ValueError as error:
            raise ValueError(f"hydraulic: {error}") from error
        for name in FOLLOWING:
            follows, told = getattr(small, name), getattr(self, name)
            if told != UNKNOWN and abs(told - follows) > AGREES * abs(follows):
                raise ValueError(
                    f"{name}: of a hydraulic plant it follows from the parts, {follows:.6g}: leave it out"
                )
            self.__dict__[name] = follows

    @property
    def reduced(self) -> PlantConfig:
        """The plant of Eq. 1 that comes nearest to it for small movements; a reduced one is that itself."""
        if self.hydraulic is None:
            return self
        kept = {name: values for name, values in self.effects.items() if name in REDUCED}
        return self.model_copy(update={"plant": "reduced", "hydraulic": None, "effects": kept})

    @property
    def index_channel(self) -> str | None:
        """Channel of its encoder's index mark."""
        sensor = self.sensor
        mark = sensor.index if isinstance(sensor, IncrementalEncoderTruth) else None
        return mark.channel if mark else None

    @model_validator(mode="after")
    def _starts_between_stops(self) -> PlantConfig:
        if self.stops is not None and not self.stops[0] <= self.position <= self.stops[1]:
            raise ValueError(f"position {self.position:g} must lie between the stops {list(self.stops)}")
        return self

    @model_validator(mode="after")
    def _effects_go_together(self) -> PlantConfig:
        if wrong := contradiction(self.effects):
            raise ValueError(f"effects: {wrong}")
        return self

    @model_validator(mode="after")
    def _conditions_have_nominal_values(self) -> PlantConfig:
        for channel, nominal in (
            ("supply_pressure", "nominal_pressure"),
            ("temperature", "nominal_temperature"),
        ):
            if (getattr(self, channel) is None) != (getattr(self, nominal) is None):
                raise ValueError(f"{channel} and {nominal} go together: give both or none")
        return self

    @property
    def conditions(self) -> list[str]:
        """Channels of the constants that it follows."""
        return [channel for channel in (self.supply_pressure, self.temperature) if channel is not None]

    @property
    def measures_speed(self) -> bool:
        """Whether its channel carries a speed."""
        return self.measures == "velocity" or (self.sensor is not None and self.sensor.kind == "fv_converter")


class BoardConfig(BaseModel):
    """The board of a simulated rig on a serial line."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    drift: Annotated[float, Field(ge=-0.01, le=0.01)] = 0.0
    """By which its clock is fast [s/s]."""
    clock_start: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    """Its clock at the beginning [us]; it wraps at 2^32."""


class SimulationConfig(BaseModel):
    """A whole simulated rig."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    plants: dict[str, PlantConfig] = Field(min_length=1)
    """Plants by name: each an actuator behind its amplifier, seen by its sensor."""
    constants: dict[str, Finite] = {}
    """Input channels that stand still at a number [the channel's unit], such as an e-stop line."""
    seed: int = 1
    """Of all that is random: noise, missing samples, faults."""
    watchdog_s: Positive = 0.02
    """The amplifier goes to neutral when commands stop for this long [s]."""
    sensor_rate_hz: Annotated[float, Field(ge=1, le=20000)] = 2000.0
    """Rate of the sensor frames where the rig sends them by itself [Hz]."""
    control_port: Annotated[int, Field(ge=0, le=65535)] = 7601
    """TCP port on loopback where `seod rig` takes faults and tells its true values."""

    board: BoardConfig = BoardConfig()
    """Where `seod rig` speaks on a serial line."""

    @property
    def kinds(self) -> list[str]:
        """Kinds of its plants."""
        return sorted({plant.plant for plant in self.plants.values()})

    @property
    def enabling_channels(self) -> list[str]:
        """Command channels that amplifiers wait for."""
        return list(dict.fromkeys(channel for plant in self.plants.values() for channel in plant.enabled_by))

    @property
    def index_channels(self) -> list[str]:
        """Channels of index marks."""
        return [plant.index_channel for plant in self.plants.values() if plant.index_channel is not None]

    @model_validator(mode="after")
    def _one_source_for_each_channel(self) -> SimulationConfig:
        plants = self.plants.values()
        read = [*(p.output for p in plants), *self.constants, *self.index_channels]
        shared = {channel for plant in plants for channel in plant.enabled_by}
        for used in ([*(p.input for p in plants), *shared], read):
            twice = sorted(channel for channel, count in Counter(used).items() if count > 1)
            if twice:
                raise ValueError(
                    f"channel {', '.join(twice)} is used twice: it can have one plant or constant"
                )
        return self

    @model_validator(mode="after")
    def _conditions_are_constants(self) -> SimulationConfig:
        for name, plant in self.plants.items():
            for channel in plant.conditions:
                if channel not in self.constants:
                    there = ", ".join(self.constants) or "none"
                    raise ValueError(f"plants.{name} follows {channel!r}, no constant; there are {there}")
            if plant.supply_pressure is not None and self.constants[plant.supply_pressure] <= 0.0:
                raise ValueError(f"constants.{plant.supply_pressure}: a supply pressure must be > 0")
        return self
