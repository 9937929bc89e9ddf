"""The rig file's `simulation:` section: the truth of a simulated rig. Plain SI numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PlantConfig(BaseModel):
    """One actuator: velocity = G_L(s) (V - bias), G_L of Eq. 1, position its integral."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    input: str
    """Channel of the command voltage."""
    output: str
    """Channel of the measured position."""
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
    """Standard deviation of the sensor's white noise [output unit]."""
    resolution: NonNegative = 0.0
    """Quantisation step of the sensor [output unit]; 0 for none."""
    saturation: Positive | None = None
    """The amplifier clips the command to +- this [V]."""
    stops: tuple[Finite, Finite] | None = None
    """End stops [output unit]: the load stands still there."""


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
