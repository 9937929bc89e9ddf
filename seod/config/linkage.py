"""The `linkage` of a linear scale: how a cylinder's stroke makes an angle."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from seod.config.section import FINITE, POSITIVE, Section, Unit, of_dimension, quantity
from seod.config.units import units_of

Length = Annotated[float, *quantity("length"), FINITE]
PositiveLength = Annotated[float, *quantity("length"), POSITIVE]
AngleUnit = Annotated[Unit, Field(json_schema_extra={"enum": units_of("angle")})]


class TableConfig(Section):
    """Stroke and angle at some points of a linkage; between them a curve that never turns back."""

    stroke: Annotated[list[Annotated[float, FINITE]], Field(min_length=2)]
    """Ascending strokes [the sensor's unit]."""
    angle: Annotated[list[Annotated[float, FINITE]], Field(min_length=2)]
    """Angles, rising or falling throughout [the linkage's unit]."""
    interpolation: Literal["linear", "cubic"] = "cubic"
    """`cubic`: smooth, and monotone as the table is."""

    @model_validator(mode="after")
    def _monotone(self) -> TableConfig:
        if len(self.stroke) != len(self.angle):
            raise ValueError(f"{len(self.stroke)} strokes, but {len(self.angle)} angles")
        rises = [b - a for a, b in pairwise(self.angle)]
        if any(b <= a for a, b in pairwise(self.stroke)):
            raise ValueError("stroke must ascend")
        if not (all(rise > 0 for rise in rises) or all(rise < 0 for rise in rises)):
            raise ValueError("angle must rise or fall throughout")
        return self


class CrankConfig(Section):
    """A cylinder between a fixed pivot and a crank: the law of cosines."""

    base: PositiveLength
    """From the crank's axis to the cylinder's fixed pivot."""
    rod: PositiveLength
    """From pivot to pivot along the cylinder at stroke 0."""
    arm: PositiveLength
    """From the crank's axis to the rod's pivot."""
    zero: Length = 0.0
    """Stroke at which the angle is 0."""
    sign: Literal[1, -1] = 1
    """-1 where the angle falls as the cylinder extends."""

    @model_validator(mode="after")
    def _zero_is_reached(self) -> CrankConfig:
        if not abs(self.base - self.arm) < self.rod + self.zero < self.base + self.arm:
            raise ValueError("base, arm and rod + zero are no triangle: the linkage cannot stand at its zero")
        return self


class LinkageConfig(Section):
    """From a cylinder's stroke to an angle: either a table or a crank."""

    unit: AngleUnit = "rad"
    """Unit of the table's angles."""
    table: TableConfig | None = None
    crank: CrankConfig | None = None

    @field_validator("unit")
    @classmethod
    def _is_angle(cls, unit: str) -> str:
        return of_dimension(unit, "angle")

    @model_validator(mode="after")
    def _one_form(self) -> LinkageConfig:
        if (self.table is None) == (self.crank is None):
            raise ValueError("needs either table or crank")
        return self
