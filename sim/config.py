"""The rig file's `simulation:` section: the truth of a simulated rig. Plain SI numbers."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from sim.sensor_config import AnySensor, Finite, IncrementalEncoderTruth, NonNegative, Positive


class PlantConfig(BaseModel):
    """One actuator: velocity = G_L(s) (V - bias), G_L of Eq. 1, position its integral."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

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
    """Damping ratio."""
    bias: Finite = 0.0
    """Valve null shift [V]: the voltage at which the load stands still."""
    position: Finite = 0.0
    """Position at start [output unit]."""
    noise: NonNegative = 0.0
    """Standard deviation of the sensor's white noise [output unit, for a speed per s]."""
    resolution: NonNegative = 0.0
    """Quantisation step of the sensor [output unit]; 0 for none."""
    saturation: Positive | None = None
    """The amplifier clips the command to +- this [V]."""
    stops: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = None
    """End stops [output unit]: the load stands still there."""
    sensor: AnySensor | None = None
    """What measures it; then the `output unit` is rad or m (for noise and resolution of a speed, per s)."""

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

    @property
    def measures_speed(self) -> bool:
        """Whether its channel carries a speed."""
        return self.measures == "velocity" or (self.sensor is not None and self.sensor.kind == "fv_converter")


class SimulationConfig(BaseModel):
    """A whole simulated rig."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    plants: dict[str, PlantConfig] = Field(min_length=1)
    constants: dict[str, Finite] = {}
    """Input channels that stand still at a value, such as an e-stop line."""
    seed: int = 1
    watchdog_s: Positive = 0.02
    """The amplifier goes to neutral when commands stop for this long."""
    sensor_rate_hz: Annotated[float, Field(ge=1, le=20000)] = 2000.0
    """Rate of the sensor frames where the rig sends them by itself."""
    control_port: Annotated[int, Field(ge=0, le=65535)] = 7601
    """TCP port on loopback where `seod rig` takes faults and tells its true values."""

    @property
    def index_channels(self) -> list[str]:
        """Channels of index marks."""
        return [plant.index_channel for plant in self.plants.values() if plant.index_channel is not None]

    @model_validator(mode="after")
    def _one_source_for_each_channel(self) -> SimulationConfig:
        plants = self.plants.values()
        read = [*(p.output for p in plants), *self.constants, *self.index_channels]
        for used in ([p.input for p in plants], read):
            twice = sorted(channel for channel, count in Counter(used).items() if count > 1)
            if twice:
                raise ValueError(
                    f"channel {', '.join(twice)} is used twice: it can have one plant or constant"
                )
        return self
