"""Shape of an axis in a rig file: its relay, limits, estimator, and what it takes from other sections."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, PrivateAttr, model_validator

from seod.config.calibration import CalibrationConfig
from seod.config.excitation import ExcitationConfig
from seod.config.gain import Gain, GainModel
from seod.config.gain_in_force import gain_range, is_identified
from seod.config.section import (
    POSITIVE,
    Command,
    GainDeviation,
    Hertz,
    Measured,
    NonNegativePosition,
    NonNegativeSeconds,
    PositiveAcceleration,
    PositiveCommand,
    PositiveMeasured,
    PositivePosition,
    PositiveSpeed,
    Seconds,
    SecondsDeviation,
    Section,
    Slew,
    Speed,
    quantity,
)


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
