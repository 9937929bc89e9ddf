"""What every section of a rig file is made of: strict models, and quantities that may carry their unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    WithJsonSchema,
)

from seod.config.errors import suggest
from seod.config.units import BASE, COMMANDS, GAINS, UNITS, parse_quantity, units_of

UNIT_KEY = "x-unit"
"""Key of a schema that tells its unit, until `seod.config.schema` has put it into the description."""


def quantity(*dimensions: str) -> Any:
    """Annotations of a number in SI that may be written with a unit of these dimensions."""
    return (BeforeValidator(lambda value: parse_quantity(value, *dimensions)), _QuantitySchema(dimensions))


@dataclass(frozen=True)
class _QuantitySchema:
    """JSON schema of a quantity: a number with its range, or a text of number and unit."""

    dimensions: tuple[str, ...]

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        units = units_of(*self.dimensions)
        pattern = "^ *[-+]?[0-9.]+([eE][-+]?[0-9]+)? *(" + "|".join(units) + ") *$"
        written = {"type": "string", "pattern": pattern}
        return {
            "anyOf": [handler(core), written],
            UNIT_KEY: " or ".join(BASE[each] for each in self.dimensions),
        }


_SENSOR_UNITS = [unit for unit, (dimension, _) in UNITS.items() if unit and dimension not in GAINS]
"""What a channel's number can be made into."""


def _known_unit(unit: str) -> str:
    if unit not in _SENSOR_UNITS:
        raise ValueError(f"unknown unit {unit!r}; {suggest(unit, _SENSOR_UNITS, 'units')}")
    return unit


def of_dimension(unit: str, *dimensions: str) -> str:
    """`unit`, if it has one of these dimensions.

    Raises:
        ValueError: It has not; says which units are right.
    """
    if UNITS[unit][0] not in dimensions:
        raise ValueError(f"wrong unit {unit!r}: must be one of {', '.join(units_of(*dimensions))}")
    return unit


def _not_zero(scale: float) -> float:
    if scale == 0:
        raise ValueError("must not be 0: nothing would get through")
    return scale


FINITE = Field(allow_inf_nan=False)
POSITIVE = Field(gt=0, allow_inf_nan=False)
NON_NEGATIVE = Field(ge=0, allow_inf_nan=False)

Command = Annotated[float, *quantity(*COMMANDS), FINITE]
"""What an amplifier is told: a voltage, or where its output is in mA a current."""
PositiveCommand = Annotated[float, *quantity(*COMMANDS), POSITIVE]
Slew = Annotated[float, *quantity(*COMMANDS.values()), POSITIVE]
Position = Annotated[float, *quantity("angle", "length"), FINITE]
PositivePosition = Annotated[float, *quantity("angle", "length"), POSITIVE]
NonNegativePosition = Annotated[float, *quantity("angle", "length"), NON_NEGATIVE]
Measured = Annotated[float, *quantity("angle", "length", "angular speed", "speed"), FINITE]
"""What an axis' sensor measures: a position, or in velocity mode a speed."""
PositiveMeasured = Annotated[float, *quantity("angle", "length", "angular speed", "speed"), POSITIVE]
Speed = Annotated[float, *quantity("angular speed", "speed"), FINITE]
PositiveSpeed = Annotated[float, *quantity("angular speed", "speed"), POSITIVE]
PositiveAcceleration = Annotated[float, *quantity("angular acceleration", "acceleration"), POSITIVE]
Seconds = Annotated[float, *quantity("time"), Field(gt=0, le=1e6)]
NonNegativeSeconds = Annotated[float, *quantity("time"), Field(ge=0, le=1e6)]
_Unknown = Annotated[Literal["unknown"], Tag("word")]
_number_or_word = Discriminator(lambda value: "word" if value == "unknown" else "number")
NonNegativeGain = Annotated[float, *quantity(*GAINS), NON_NEGATIVE]
GainDeviation = Annotated[Annotated[NonNegativeGain, Tag("number")] | _Unknown, _number_or_word]
"""A standard deviation of what is known beforehand, if anything is."""
SecondsDeviation = Annotated[Annotated[NonNegativeSeconds, Tag("number")] | _Unknown, _number_or_word]
Hertz = Annotated[float, *quantity("frequency"), POSITIVE]
Scale = Annotated[float, FINITE, AfterValidator(_not_zero)]
Unit = Annotated[str, AfterValidator(_known_unit), WithJsonSchema({"enum": _SENSOR_UNITS})]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")]
"""What the user calls an axis, a sensor or an output: becomes a word in commands and column headers."""


class Section(BaseModel):
    """A mapping of the rig file: unknown keys are errors, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)
