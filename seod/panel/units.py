"""Units as the page shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seod.config.model import AxisConfig


def measured_unit(axis: AxisConfig) -> str:
    """SI unit of what the axis' sensor measures: of a position, in velocity mode of a speed."""
    return axis.setting_units["hysteresis"] + ("/s" if axis.mode == "velocity" else "")
