"""What can be changed while an axis runs, and the limits that hold for it, in the loop as in the gateway."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.gain import gain_range, needs_pressure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.config.model import AxisConfig, RigConfig


def on_clock(rig: RigConfig) -> bool:
    """Whether the times of the rows are CLOCK_MONOTONIC now, not simulated nor recorded."""
    return rig.driver["kind"] != "replay" and rig.driver.get("realtime") is not False


def configured(axis: AxisConfig) -> dict[str, float]:
    """The settings that the loop keeps, as the rig file has them.

    `K_L` is there where it follows no pressure, `reference` and `trim` (0 or 1) in velocity mode.
    """
    relay = axis.relay
    settings = {"e_a": relay.e_a, "hysteresis": relay.hysteresis, "bias": relay.bias}
    settings["two_phase"] = axis.two_phase
    if not needs_pressure(axis.K_L):
        settings["K_L"] = gain_range(axis.K_L)[0]
    if axis.mode == "velocity":
        settings |= {"reference": axis.reference or 0.0, "trim": axis.trim}
    return settings


def refusal(axis: AxisConfig, now: Mapping[str, float], values: Mapping[str, float]) -> str | None:
    """Why `values` cannot be set, beginning with the setting's name; None if they can.

    Args:
        axis: The axis, with its limits.
        now: Settings in force.
        values: New ones, only those that the loop keeps.
    """
    known = {*configured(axis), "K_L"}
    for key, value in values.items():
        if key not in known:
            return f"{key}: cannot be set in {axis.mode} mode"
        if not math.isfinite(value):
            return f"{key}: must be finite"
        if key in ("e_a", "K_L") and value <= 0.0:
            return f"{key}: must be > 0"
    new = {**now, **values}
    return _volts(axis, new, values) or _movements(axis, new)


def _volts(axis: AxisConfig, new: Mapping[str, float], values: Mapping[str, float]) -> str | None:
    most = axis.limits.output
    bias, what = abs(new["bias"]), "|bias|"
    if axis.mode == "velocity":
        bias += abs(new["reference"]) / new.get("K_L", gain_range(axis.K_L)[0])
        what = "|reference| / K_L + |bias|"
    if new["e_a"] + bias <= most:
        return None
    blamed = next((key for key in ("e_a", "reference", "K_L") if key in values), "bias")
    return f"{blamed}: e_a + {what} = {new['e_a'] + bias:g} V is over limits.output = {most:g} V"


def _movements(axis: AxisConfig, new: Mapping[str, float]) -> str | None:
    limits = axis.limits
    if not 0.0 <= new["hysteresis"] < limits.amplitude:
        what = f"must be below limits.amplitude = {limits.amplitude:g}, and not negative"
        return f"hysteresis: {what}, got {new['hysteresis']:g}"
    low, high = limits.travel
    if not low < new.get("reference", 0.5 * (low + high)) < high:
        what = f"must lie within limits.travel = [{low:g}, {high:g}]"
        return f"reference: {what}, got {new['reference']:g}"
    return None
