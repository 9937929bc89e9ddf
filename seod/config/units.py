"""Units of rig files, recordings, commands and the protocol: one parser.

Everything inside the program is in SI base units (rad, m, V, s, Hz, Pa, K).
"""

from __future__ import annotations

import math
import re
from typing import Final

UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", math.pi / 180.0),
    "rev": ("angle", 2.0 * math.pi),
    "m": ("length", 1.0),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
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
    "A/s": ("current slew rate", 1.0),
    "mA/s": ("current slew rate", 1e-3),
    "": ("number", 1.0),
}
"""Unit -> (dimension, factor to the SI base unit)."""

COMMANDS: Final = {"voltage": "slew rate", "current": "current slew rate"}
"""What an amplifier may be told -> the dimension of its change."""
RATES: Final = {"angle": "angular speed", "length": "speed"}
"""A position's dimension -> that of its speed."""
SPEEDS: Final = tuple(RATES.values())


def per(speed: str, command: str) -> str:
    """Dimension of a gain from a command to a speed."""
    return f"{speed} per {command}"


UNITS |= {
    f"{over}/{under}": (per(speed, command), factor / divisor)
    for over, (speed, factor) in list(UNITS.items())
    if speed in SPEEDS
    for under, (command, divisor) in list(UNITS.items())
    if command in COMMANDS
}
GAINS: Final = tuple(per(speed, command) for speed in SPEEDS for command in COMMANDS)
"""Dimensions that K_L may have."""
SETTINGS: Final[dict[str, tuple[str, ...]]] = {
    "e_a": tuple(COMMANDS),
    "bias": tuple(COMMANDS),
    "hysteresis": tuple(RATES),
    "reference": SPEEDS,
    "K_L": GAINS,
}
"""Settings of an axis that a client may change, with their dimensions."""
BASE: Final = {dimension: unit for unit, (dimension, factor) in reversed(UNITS.items()) if factor == 1.0}
"""Dimension -> its SI unit."""

ZEROS: Final[dict[str, float]] = {"degC": 273.15}
"""Units whose zero is not that of SI: their zero in the SI base unit."""

MORE: Final[dict[str, tuple[str, float]]] = {
    "ns": ("time", 1e-9),
    "min": ("time", 60.0),
    "h": ("time", 3600.0),
    "cm": ("length", 1e-2),
    "in": ("length", 0.0254),
    "psi": ("pressure", 6894.757293168),
    "N": ("force", 1.0),
    "kN": ("force", 1e3),
    "%": ("number", 1e-2),
}
KNOWN: Final = UNITS | MORE
"""Unit -> (dimension, factor to the SI base unit)."""

SPELLINGS: Final[dict[str, str]] = {
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "usec": "us",
    "µs": "us",
    "μs": "us",
    "µm": "um",
    "μm": "um",
    "°": "deg",
    "º": "deg",
    "degree": "deg",
    "degrees": "deg",
    "volt": "V",
    "volts": "V",
    "v": "V",
    "mv": "mV",
    "°c": "degC",
    "ºc": "degC",
    "c": "degC",
    "celsius": "degC",
    "pa": "Pa",
    "mpa": "MPa",
    "kpa": "kPa",
    "1/min": "rpm",
    "u/min": "rpm",
    "°/s": "deg/s",
    "inch": "in",
}

_QUANTITY = re.compile(r"^\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(\S*)\s*$")


def spelled(unit: str) -> str:
    """The unit's usual spelling; one that is not known stays as it is."""
    unit = unit.strip()
    return unit if unit in KNOWN else SPELLINGS.get(unit.lower(), unit)


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
    number, unit = match[1], spelled(match[2])
    if unit not in KNOWN or KNOWN[unit][0] not in dimensions:
        raise ValueError(f"wrong unit {match[2]!r}: must be one of {right}")
    return to_si(_float(number), unit)


def to_si(value: float, unit: str) -> float:
    """`value` [unit] in the SI base unit."""
    return value * KNOWN[unit][1] + ZEROS.get(unit, 0.0)


def written_as(value: float, written: object) -> float | str:
    """A value in SI in the unit of what stands there now, such as `12 mV` after `0 mV`; a number else."""
    match = _QUANTITY.match(written) if isinstance(written, str) else None
    unit = spelled(match[2]) if match else ""
    if not match or unit not in KNOWN or not unit:
        return value
    return f"{(value - ZEROS.get(unit, 0.0)) / KNOWN[unit][1]:.6g} {match[2]}"


def dimension_of(value: object) -> str | None:
    """Dimension that a raw value such as `"30 deg"` is written in; None for a plain number or no quantity."""
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    unit = spelled(match[2]) if match else ""
    return KNOWN[unit][0] if unit in KNOWN and unit else None


def _float(number: float | str) -> float:
    try:
        return float(number)
    except OverflowError:  # an integer of more than 308 digits
        return math.inf
