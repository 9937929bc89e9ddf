"""Units of measured data: those of the rig file, some of other loggers, and their many spellings."""

from __future__ import annotations

import re
from typing import Final

from seod.config.units import BASE as OWN_BASE
from seod.config.units import UNITS, ZEROS

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

BASE: Final[dict[str, str]] = {**OWN_BASE, "force": "N"}
"""Dimension -> its SI base unit."""

_IN_HEADER = re.compile(
    r"^(?P<name>.*?)\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\)|\s/\s*(?P<c>[^/\s]+))\s*$"
)


def spelled(unit: str) -> str:
    """The unit's usual spelling; one that is not known stays as it is."""
    unit = unit.strip()
    return unit if unit in KNOWN else SPELLINGS.get(unit.lower(), unit)


def split_header(cell: str) -> tuple[str, str]:
    """`pos [deg]`, `pos (°)` or `pos / deg` to name and unit; the unit is "" where there is none.

    A number in brackets is an index, not a unit.
    """
    cell = cell.strip()
    match = _IN_HEADER.match(cell)
    if match is None or not match["name"]:
        return cell, ""
    unit = next(part for part in (match["a"], match["b"], match["c"]) if part is not None).strip()
    if unit.isdigit() or (match["b"] and spelled(unit) not in KNOWN):
        return cell, ""
    return match["name"], "" if unit in ("-", "1") else spelled(unit)


def is_unit_cell(cell: str) -> bool:
    """Whether a cell below a header can be a unit: `[deg]`, `(ms)`, `V`, `-` or nothing."""
    inner = cell.strip()
    if inner[:1] + inner[-1:] in ("[]", "()"):
        return True
    return inner in ("", "-") or spelled(inner) in KNOWN


def unit_of_cell(cell: str) -> str:
    """The unit in such a cell."""
    inner = cell.strip()
    if inner[:1] + inner[-1:] in ("[]", "()"):
        inner = inner[1:-1]
    return "" if inner in ("-", "1") else spelled(inner)


def to_base(unit: str) -> tuple[float, float, str]:
    """Factor and zero that bring values in `unit` to the SI base unit, and that unit.

    Raises:
        KeyError: The unit is not known.
    """
    dimension, factor = KNOWN[unit]
    return factor, ZEROS.get(unit, 0.0), BASE[dimension]
