"""Units of the rig file. Everything inside the program is in SI base units (rad, m, V, s, Hz, Pa, K)."""

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
    "K": ("temperature", 1.0),
    "degC": ("temperature", 1.0),
    "rad/s": ("angular speed", 1.0),
    "deg/s": ("angular speed", math.pi / 180.0),
    "rpm": ("angular speed", math.pi / 30.0),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "rad/s/s": ("angular acceleration", 1.0),
    "deg/s/s": ("angular acceleration", math.pi / 180.0),
    "m/s/s": ("acceleration", 1.0),
    "mm/s/s": ("acceleration", 1e-3),
    "V/s": ("slew rate", 1.0),
    "": ("number", 1.0),
}
"""Unit -> (dimension, factor to the SI base unit)."""

ZEROS: Final[dict[str, float]] = {"degC": 273.15}
"""Units whose zero is not that of SI: their zero in the SI base unit."""

_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*$", re.ASCII)


def units_of(*dimensions: str) -> list[str]:
    """The units that have one of these dimensions."""
    return [unit for unit, (dimension, _) in UNITS.items() if dimension in dimensions]


def parse_quantity(value: object, *dimensions: str) -> float:
    """Turn `0.5`, `"0.5 V"` or `"30 deg"` into SI.

    Args:
        value: A number (already SI) or a string of number and unit.
        dimensions: Dimensions that are right here.

    Raises:
        ValueError: Not a quantity, or of another dimension; says which units are right.
    """
    right = ", ".join(units_of(*dimensions))
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"must be a number, or a number with a unit ({right})")  # noqa: TRY004 - for pydantic
    if not isinstance(value, str):
        return _float(value)
    match = _QUANTITY.match(value)
    if match is None or match[2] == "":
        raise ValueError(f"must be a number, or a number with a unit ({right})")
    number, unit = match.groups()
    if unit not in UNITS or UNITS[unit][0] not in dimensions:
        raise ValueError(f"wrong unit {unit!r}: must be one of {right}")
    return to_si(_float(number), unit)


def to_si(value: float, unit: str) -> float:
    """`value` [unit] in the SI base unit."""
    return value * UNITS[unit][1] + ZEROS.get(unit, 0.0)


def dimension_of(value: object) -> str | None:
    """Dimension that a raw value such as `"30 deg"` is written in; None for a plain number or no quantity."""
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    return UNITS[match[2]][0] if match and match[2] and match[2] in UNITS else None


def _float(number: float | str) -> float:
    try:
        return float(number)
    except OverflowError:  # an integer of more than 308 digits
        return math.inf
