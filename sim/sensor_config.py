"""The `sensor` section of a simulated plant: what makes its motion the channel's number. Plain SI numbers.

Without one the channel carries the position itself. With one the plant moves in rad or m.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class SensorTruth(BaseModel):
    """What every kind has."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    lag: NonNegative = 0.0
    """Time constant of a first-order low-pass on what is measured [s]."""


class LinearTruth(SensorTruth):
    """raw = position * scale + offset."""

    kind: Literal["linear"]
    scale: Finite = 1.0
    """Channel's number per unit of the plant [1/rad or 1/m]."""
    offset: Finite = 0.0
    """Channel's number at 0 [channel's unit]."""


class IndexTruth(BaseModel):
    """An index mark, once a turn; its pulse is held until it is read."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    channel: str
    """Carries 1 when the mark passed since the last reading, else 0."""
    position: Finite = 0.0
    """Where the mark is [rad]."""


class IncrementalEncoderTruth(SensorTruth):
    """A counter that begins at `start` and wraps."""

    kind: Literal["incremental_encoder"]
    bits: Annotated[int, Field(ge=2, le=48)]
    """Width of the counter."""
    counts_per_unit: Finite
    """Counts per unit [1/rad or 1/m]; negative for one that counts the other way."""
    start: int = 0
    """Its number at position 0."""
    index: IndexTruth | None = None


class AbsoluteEncoderTruth(SensorTruth):
    """A single turn in numbers from 0."""

    kind: Literal["absolute_encoder"]
    counts_per_rev: Annotated[int, Field(ge=4)]
    """Numbers in one turn."""
    zero: Finite = 0.0
    """Position at number 0 [rad]."""
    sign: Literal[1, -1] = 1
    """-1 where it counts the other way."""


class AdcTruth(BaseModel):
    """An A/D converter: clips at the ends of its range and counts in equal steps."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    bits: Annotated[int, Field(ge=4, le=32)] = 16
    """Its width."""
    range: Annotated[tuple[Finite, Finite], Field(strict=False)] = (-10.0, 10.0)
    """Lowest and highest number [channel's unit]."""

    @model_validator(mode="after")
    def _rises(self) -> AdcTruth:
        if not self.range[0] < self.range[1]:
            raise ValueError("range must rise")
        return self


class FvConverterTruth(SensorTruth):
    """raw = speed * volts_per_unit + offset_v, with ripple in step with the movement, clipped."""

    kind: Literal["fv_converter"]
    volts_per_unit: Finite
    """Voltage per speed [V s/rad or V s/m]."""
    offset_v: Finite = 0.0
    """Voltage at standstill [V]."""
    ripple: NonNegative = 0.0
    """Amplitude of the ripple, as a part of the speed [1]."""
    ripples_per_unit: NonNegative = 0.0
    """Periods of the ripple per movement [1/rad or 1/m]: its frequency is a multiple of the speed."""
    clip: Annotated[tuple[Finite, Finite], Field(strict=False)] = (-10.0, 10.0)
    """Lowest and highest voltage [V]."""
    adc: AdcTruth | None = None
    """What counts that voltage."""


class CrankTruth(BaseModel):
    """Geometry of a cylinder that turns a crank; lengths in m."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    base: Positive
    """From the crank's axis to the cylinder's fixed pivot [m]."""
    rod: Positive
    """Between the pivots, at stroke 0 [m]."""
    arm: Positive
    """From the crank's axis to the rod's pivot [m]."""
    zero: Finite = 0.0
    """Stroke at angle 0 [m]."""
    sign: Literal[1, -1] = 1
    """-1 where the angle falls as the cylinder extends."""


class TableTruth(BaseModel):
    """Strokes [m] and the angles [rad] that they make; straight lines between and beyond."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    stroke: Annotated[list[Finite], Field(min_length=2)]
    """Ascending strokes [m]."""
    angle: Annotated[list[Finite], Field(min_length=2)]
    """The angles that they make, ascending [rad]."""

    @model_validator(mode="after")
    def _ascends(self) -> TableTruth:
        rising = all(b > a for column in (self.stroke, self.angle) for a, b in pairwise(column))
        if len(self.stroke) != len(self.angle) or not rising:
            raise ValueError("stroke and angle must be of equal length and ascend")
        return self


class LinearScaleTruth(SensorTruth):
    """raw = stroke * scale + offset, the stroke that belongs to the plant's angle."""

    kind: Literal["linear_scale"]
    scale: Finite = 1.0
    """Channel's number per stroke [1/m]."""
    offset: Finite = 0.0
    """Channel's number at stroke 0 [channel's unit]."""
    crank: CrankTruth | None = None
    table: TableTruth | None = None
    adc: AdcTruth | None = None
    """What counts the channel's number."""

    @model_validator(mode="after")
    def _one_form(self) -> LinearScaleTruth:
        if self.crank is not None and self.table is not None:
            raise ValueError("can have a crank or a table, not both")
        return self


AnySensor = Annotated[
    LinearTruth | IncrementalEncoderTruth | AbsoluteEncoderTruth | FvConverterTruth | LinearScaleTruth,
    Field(discriminator="kind"),
]
