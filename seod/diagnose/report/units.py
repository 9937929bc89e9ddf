"""Units of what is told, from that of y: `unit` of the table of effects is nobody's."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from seod.diagnose.result import Output

_NUMBER: Final = r"-?\d+(?:\.\d*)?(?:e[-+]?\d+)?"
OF_READINGS: Final = "(unit of y)"
"""What stands for the unit of y in sentences that are made where nobody knows it."""
NOBODYS: Final = re.compile(
    rf"(?P<value>{_NUMBER})(?: (?P<joined>±|and) (?P<second>{_NUMBER}))? "
    rf"(?P<unit>rad/unit\b|{re.escape(OF_READINGS)}|unit \(unit/s for a speed\)|unit\b(?:/s(?:\^\d)?)?)"
)
"""Numbers in nobody's unit in such sentences: a value, one with its interval, or two values."""


@dataclass(frozen=True, slots=True)
class Units:
    """Of the readings, and of the load's position, speed and acceleration."""

    reading: str
    position: str
    speed: str
    acceleration: str

    @classmethod
    def of(cls, unit: str, output: Output) -> Units:
        """From the unit of y, which is a position or a speed; a speed may be in m or V, in a closed loop."""
        position = unit if output == "position" else _times_s(unit)
        return cls(unit, position, _per_s(position), _per_s(_per_s(position)))

    @property
    def gain(self) -> str:
        """Of K_L."""
        return f"{self.speed}/V"

    def named(self, text: str) -> str:
        """A unit of the table of effects; nothing for a pure number."""
        own = {
            "1": "",
            "unit": self.position,
            "unit/s": self.speed,
            "unit/s^2": self.acceleration,
            "unit/s^3": _per_s(self.acceleration),
            "unit (unit/s for a speed)": self.reading,
            OF_READINGS: self.reading,
            "rad/unit": f"rad/({self.position})" if "·" in self.position else f"rad/{self.position}",
        }
        first, more, rest = text.partition(" for each ")
        return own.get(first, first) + more + rest

    def told(self, sentence: str) -> str:
        """A sentence of the answer, with these units in place of nobody's."""
        return NOBODYS.sub(
            lambda found: found[0].removesuffix(found["unit"]) + self.named(found["unit"]), sentence
        )


def _per_s(unit: str) -> str:
    """`m` to `m/s`, `m/s` to `m/s^2`, `m·s` to `m`."""
    base, _, power = unit.rpartition("/s")
    if unit.endswith("·s"):
        return unit.removesuffix("·s")
    if base and (not power or power.startswith("^")):
        return f"{base}/s^{int(power.removeprefix('^') or 1) + 1}"
    return f"{unit}/s"


def _times_s(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit}·s"
