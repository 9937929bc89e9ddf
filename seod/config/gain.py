"""Shapes of `K_L` in a rig file: a number, a function of supply pressure (Eq. 9), or `identified`."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from seod.config.section import FINITE, NON_NEGATIVE, POSITIVE, NonNegativeGain, Section, quantity
from seod.config.units import GAINS

PositiveGain = Annotated[float, *quantity(*GAINS), POSITIVE]
Pressure = Annotated[float, *quantity("pressure"), NON_NEGATIVE]


class GainTable(Section):
    """Gains measured at some supply pressures; between them a straight line, beyond them the nearest."""

    ps: Annotated[list[Pressure], Field(min_length=2)]
    """Supply pressures, ascending."""
    K_L: Annotated[list[PositiveGain], Field(min_length=2)]
    """The gain at each."""

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.ps) != len(self.K_L):
            counts = f"ps has {len(self.ps)} entries and K_L {len(self.K_L)}"
            raise ValueError(f"{counts}: one gain for each pressure")
        if any(a >= b for a, b in pairwise(self.ps)):
            raise ValueError("ps must ascend")
        return self


class GainModel(Section):
    """A gain that depends on supply pressure, `table` or `polynomial` with `range`, or is `identified`."""

    table: GainTable | None = None
    """Measured points."""
    polynomial: Annotated[list[Annotated[float, FINITE]], Field(min_length=1, max_length=6)] | None = None
    """c0 + c1 ps + c2 ps^2 + ... [SI unit/s/V], ps in Pa (Eq. 9: 4.25, 2.72e-6, -0.134e-12)."""
    range: tuple[Pressure, Pressure] | None = None
    """Pressures for which the polynomial holds; beyond them its value at the nearer end counts."""
    identified: NonNegativeGain | None = None
    """To be found by two-phase excitation; until then this guess; 0: limits.speed / relay.e_a."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        forms = (self.table, self.polynomial, self.identified)
        if sum(form is not None for form in forms) != 1:
            raise ValueError("needs one of `table`, `polynomial` and `identified`")
        if (self.polynomial is None) != (self.range is None):
            raise ValueError("`polynomial` and `range` belong together")
        if self.range is not None and self.range[0] >= self.range[1]:
            raise ValueError("the lower end of `range` must come first and lie below the upper end")
        return self


IDENTIFIED = "identified"
"""What stands in the rig file for a gain of which nothing is known beforehand."""


def _form(value: Any) -> str:
    if value == IDENTIFIED:
        return "word"
    return "model" if isinstance(value, dict | GainModel) else "number"


_Word = Annotated[
    GainModel, BeforeValidator(lambda _: {IDENTIFIED: 0.0}), WithJsonSchema({"const": IDENTIFIED})
]
Gain = Annotated[
    Annotated[PositiveGain, Tag("number")]
    | Annotated[GainModel, Tag("model")]
    | Annotated[_Word, Tag("word")],
    Discriminator(_form),
]
