"""Units of measured data: those of the rig file, some of other loggers, and their many spellings."""

from __future__ import annotations

import re
from typing import Final

from seod.config.units import BASE as OWN_BASE
from seod.config.units import KNOWN, ZEROS, spelled

__all__ = ["BASE", "KNOWN", "is_unit_cell", "spelled", "split_header", "to_base", "unit_of_cell"]

BASE: Final[dict[str, str]] = {**OWN_BASE, "force": "N"}
"""Dimension -> its SI base unit."""

_IN_HEADER = re.compile(
    r"^(?P<name>.*?)\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\)|\s/\s*(?P<c>[^/\s]+))\s*$"
)


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
