"""Shape of a rig file's `outputs`: how a command becomes a channel's number."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from seod.config.section import (
    FINITE,
    Scale,
    Section,
)


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
