"""Units of the rig file. Everything inside the program is in SI base units (rad, m, V, s, Hz, Pa)."""

from __future__ import annotations

import math
import re
from typing import Final

UNITS: Final[dict[str, tuple[str, float]]] = {
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", math.pi / 180.0),
    "rev": ("angle", 2.0 * math.pi),
    "m": ("length", 1.0),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "Hz": ("frequency", 1.0),
    "kHz": ("frequency", 1e3),
    "Pa": ("pressure", 1.0),
    "kPa": ("pressure", 1e3),
    "bar": ("pressure", 1e5),
    "MPa": ("pressure", 1e6),
    "rad/s": ("angular speed", 1.0),
    "deg/s": ("angular speed", math.pi / 180.0),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "V/s": ("slew rate", 1.0),
    "": ("number", 1.0),
}
"""Unit -> (dimension, factor to the SI base unit)."""

_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*$")


class Quantity(float):
    """A number in SI base units that remembers its dimension ("" for a plain number, taken as SI)."""

    dimension: str

    def __new__(cls, value: float, dimension: str = "") -> Quantity:
        """Make a quantity from its SI value."""
        self = super().__new__(cls, value)
        self.dimension = dimension
        return self


def units_of(*dimensions: str) -> list[str]:
    """The units that have one of these dimensions."""
    return [unit for unit, (dimension, _) in UNITS.items() if dimension in dimensions]


def parse_quantity(value: object, *dimensions: str) -> Quantity:
    """Turn `0.5`, `"0.5 V"` or `"30 deg"` into SI.

    Args:
        value: A number (already SI) or a string of number and unit.
        dimensions: Dimensions that are right here.

    Raises:
        ValueError: Not a quantity, or of another dimension; says which units are right.
    """
    right = ", ".join(units_of(*dimensions))
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"expected a number or a number with a unit ({right})")
    if not isinstance(value, str):
        return Quantity(float(value), getattr(value, "dimension", ""))
    match = _QUANTITY.match(value)
    if match is None:
        raise ValueError(f"expected a number with a unit ({right}), got {value!r}")
    number, unit = match.groups()
    if unit not in UNITS or UNITS[unit][0] not in dimensions:
        raise ValueError(f"wrong unit {unit!r}: expected one of {right}")
    dimension, factor = UNITS[unit]
    return Quantity(float(number) * factor, dimension)
