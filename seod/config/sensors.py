"""The sensor kinds of a rig file: how a channel's number becomes a quantity, and when it is wrong."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
    TypeAdapter,
    ValidationError,
    field_validator,
    model_validator,
)

from seod.config.linkage import LinkageConfig
from seod.config.section import FINITE, NonNegativeSeconds, Scale, Section, Unit, of_dimension
from seod.config.units import UNITS, units_of

Span = tuple[Annotated[float, FINITE], Annotated[float, FINITE]]
"""Lowest and highest number of a channel."""


class ValidConfig(Section):
    """A channel that tells whether the readings of a sensor are valid; one that is not counts as not come."""

    model_config = ConfigDict(serialize_by_alias=True)

    channel: str
    """Input channel of the driver."""
    is_: Annotated[float, FINITE] = Field(1.0, alias="is")
    """Number [the channel's unit] at which readings are valid."""


class SensorSection(Section):
    """What every kind has."""

    DIMENSIONS: ClassVar[tuple[str, ...]] = ()
    """Dimensions that `unit` may have; empty for any."""

    channel: str
    """Input channel of the driver."""
    unit: Unit
    """Unit of the value; converted to SI inside."""
    range: Span | None = None
    """Numbers [channel's unit] that a sound sensor can give; beyond (a broken wire) the guard stops."""
    saturation: Span | None = None
    """Numbers [channel's unit] at which the sensor clips; an estimate from such samples is saturated."""
    lag: NonNegativeSeconds = 0.0
    """Time constant of the sensor's own first-order low-pass, which the estimators account for."""
    valid: ValidConfig | None = None

    @property
    def dimension(self) -> str:
        """Of the value that the axis sees."""
        return UNITS[self.unit][0]

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """As pydantic has it, with the units of this kind alone."""
        schema = handler.resolve_ref_schema(handler(core))
        if cls.DIMENSIONS:
            schema["properties"]["unit"]["enum"] = units_of(*cls.DIMENSIONS)
        return schema

    @field_validator("unit")
    @classmethod
    def _right_dimension(cls, unit: str) -> str:
        return of_dimension(unit, *cls.DIMENSIONS) if cls.DIMENSIONS else unit

    @field_validator("range", "saturation")
    @classmethod
    def _ascending(cls, span: Span | None) -> Span | None:
        if span is not None and span[0] >= span[1]:
            raise ValueError("the lower end must come first and lie below the upper end")
        return span

    @model_validator(mode="after")
    def _saturation_within_range(self) -> SensorSection:
        inner, outer = self.saturation, self.range
        if inner and outer and not outer[0] <= inner[0] < inner[1] <= outer[1]:
            raise ValueError("saturation must lie within range: beyond it the guard stops the rig anyway")
        return self


class ScaledConfig(SensorSection):
    """value = (raw * scale + offset) in `unit`."""

    scale: Scale = 1.0
    """What one of the channel's unit is [`unit` / channel's unit]."""
    offset: Annotated[float, FINITE] = 0.0
    """Value at the channel's number 0 [`unit`]."""


class LinearConfig(ScaledConfig):
    """Anything: value = (raw * scale + offset) in `unit`."""

    kind: Literal["linear"] = "linear"


class PressureConfig(ScaledConfig):
    """A pressure: value = (raw * scale + offset) in `unit`."""

    DIMENSIONS = ("pressure",)
    kind: Literal["pressure"]


class TemperatureConfig(ScaledConfig):
    """A temperature: value = (raw * scale + offset) in `unit`."""

    DIMENSIONS = ("temperature",)
    kind: Literal["temperature"]


class FvConverterConfig(SensorSection):
    """A frequency to voltage converter: value = (V - offset_v) * scale, its sign that of the scale."""

    DIMENSIONS = ("angular speed", "speed")
    kind: Literal["fv_converter"]
    scale: Scale
    """Speed per voltage [`unit`/V]; negative where the voltage falls with the speed."""
    offset_v: Annotated[float, FINITE] = 0.0
    """Voltage at standstill [V]."""


class IndexConfig(Section):
    """The index pulse of an incremental encoder: it makes the position absolute."""

    channel: str
    """Input channel that leaves 0 while the index mark passes; the count then is the zero."""


class IncrementalEncoderConfig(SensorSection):
    """A counter of increments that wraps at its width. Exactly one of the two scales is given.

    Without an index the position is 0 (plus `offset`) where the first sample finds it.
    """

    DIMENSIONS = ("angle", "length")
    kind: Literal["incremental_encoder"]
    bits: Annotated[int, Field(ge=2, le=48)]
    """Width of the counter; it may be read with or without a sign."""
    counts_per_rev: Scale | None = None
    """Counts per turn [1/rev], all edges counted; negative where the counter falls as the angle rises."""
    counts_per_unit: Scale | None = None
    """Counts per unit [1/`unit`], likewise."""
    offset: Annotated[float, FINITE] = 0.0
    """Position at count 0, or at the index mark [`unit`]."""
    largest_step: Annotated[int, Field(ge=1)] | None = None
    """More counts than that between two samples are no movement: the guard stops the rig.

    Below half the counter's range, as where left out: a larger step cannot be told from one backwards.
    """
    index: IndexConfig | None = None

    @model_validator(mode="after")
    def _one_scale(self) -> IncrementalEncoderConfig:
        if (self.counts_per_rev is None) == (self.counts_per_unit is None):
            raise ValueError("needs either counts_per_rev or counts_per_unit")
        if self.counts_per_rev is not None and self.dimension != "angle":
            raise ValueError(f"counts_per_rev needs an angle as unit, not {self.unit}: use counts_per_unit")
        return self

    @field_validator("largest_step")
    @classmethod
    def _below_half(cls, step: int | None, info: Any) -> int | None:
        half = 1 << (info.data.get("bits", 48) - 1)
        if step is not None and step >= half:
            raise ValueError(f"must be below half the counter's range, {half}")
        return step


class AbsoluteEncoderConfig(SensorSection):
    """A single-turn absolute encoder, made continuous over turns; at start within half a turn of `offset`."""

    DIMENSIONS = ("angle",)
    kind: Literal["absolute_encoder"]
    bits: Annotated[int, Field(ge=2, le=32)]
    """Width of its number."""
    counts_per_rev: Scale | None = None
    """Counts per turn [1/rev], negative for the other way round; left out: 2 to the power of bits."""
    offset: Annotated[float, FINITE] = 0.0
    """Position at count 0 [`unit`]."""

    @field_validator("counts_per_rev")
    @classmethod
    def _fits(cls, counts: float | None, info: Any) -> float | None:
        most = 1 << info.data.get("bits", 32)
        if counts is not None and (abs(counts) > most or counts != int(counts)):
            raise ValueError(f"must be a whole number of at most 2 to the power of bits, {most}")
        return counts


class LinearScaleConfig(ScaledConfig):
    """A scale on a cylinder: stroke = (raw * scale + offset) in `unit`; with a linkage, its angle."""

    DIMENSIONS = ("length",)
    kind: Literal["linear_scale"]
    linkage: LinkageConfig | None = None

    @property
    def dimension(self) -> str:
        """Of the value that the axis sees."""
        return "angle" if self.linkage else "length"


def _kind(value: Any) -> str:
    """`linear` where nothing is said, as in files from before there were kinds."""
    kind = value.get("kind", "linear") if isinstance(value, dict) else getattr(value, "kind", "linear")
    return kind if isinstance(kind, str) else repr(kind)


SensorConfig = Annotated[
    Annotated[LinearConfig, Tag("linear")]
    | Annotated[IncrementalEncoderConfig, Tag("incremental_encoder")]
    | Annotated[AbsoluteEncoderConfig, Tag("absolute_encoder")]
    | Annotated[FvConverterConfig, Tag("fv_converter")]
    | Annotated[LinearScaleConfig, Tag("linear_scale")]
    | Annotated[PressureConfig, Tag("pressure")]
    | Annotated[TemperatureConfig, Tag("temperature")],
    Discriminator(_kind),
]
"""A channel made into a physical quantity."""


def index_channel(sensor: SensorConfig) -> str | None:
    """The channel of an encoder's index mark; None where there is none."""
    found = sensor.index if isinstance(sensor, IncrementalEncoderConfig) else None
    return found.channel if found else None


_ADAPTER: TypeAdapter[SensorConfig] = TypeAdapter(SensorConfig)


def sensor_or_none(text: str) -> SensorConfig | None:
    """The sensor that this JSON text describes; None if it is not valid."""
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError:
        return None
