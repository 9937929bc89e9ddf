"""What can be changed while an axis runs, and the limits that hold for it, in the loop as in the gateway."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from seod.config.gain_in_force import gain_range, is_identified, needs_pressure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.config.axis import AxisConfig
    from seod.config.model import RigConfig


LOOP_SETTINGS = ("e_a", "hysteresis", "bias", "K_L", "two_phase", "reference", "trim")
"""Settings that the loop keeps, too; the others are the estimator's alone."""


def is_replayed(rig: RigConfig) -> bool:
    """Whether rows come from a recording; asked by the kind's name, for the observer loads no driver."""
    return bool(rig.driver["kind"] == "replay")


def on_clock(rig: RigConfig) -> bool:
    """Whether the times of the rows are CLOCK_MONOTONIC now, not simulated nor recorded."""
    return not is_replayed(rig) and rig.driver.get("realtime") is not False


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


SETTABLE = {False: 10.0, True: 1000.0}
"""Times or part of the rig file's K_L that may be set without `limits.K_L`; and of one that is identified."""
SMALLEST_E_A = 1e-4
"""Part of `limits.output`, likewise of `limits.e_a`."""


def settable_gain(axis: AxisConfig) -> tuple[float, float]:
    """Smallest and largest K_L [axis unit/s/V] that may be set: another is a slip."""
    if axis.limits.K_L is not None:
        return axis.limits.K_L
    low, high = gain_range(axis.K_L)
    if low <= 0.0:  # identified, and nothing is guessed
        low = high = (axis.limits.travel[1] - axis.limits.travel[0]) / axis.limits.output
    factor = SETTABLE[is_identified(axis.K_L)]
    return low / factor, high * factor


def shown(axis: AxisConfig) -> dict[str, Any]:
    """The settings that the loop keeps, as clients see them; K_L is null where it follows the pressure."""
    settings: dict[str, Any] = configured(axis)
    settings.setdefault("K_L", None)
    return settings | {key: bool(settings[key]) for key in ("two_phase", "trim") if key in settings}


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
        if why := _out_of_range(axis, key, value):
            return f"{key}: {why}, got {value:g}"
    new = {**now, **values}
    return _volts(axis, new, values) or _movements(axis, new)


def _out_of_range(axis: AxisConfig, key: str, value: float) -> str:
    """What is wrong with a new e_a or K_L taken by itself; "" if nothing is."""
    if key == "K_L":
        low, high = settable_gain(axis)
        return "" if low <= value <= high else f"must lie within limits.K_L = [{low:g}, {high:g}]"
    if key == "e_a":
        least = axis.limits.e_a or SMALLEST_E_A * axis.limits.output
        return "" if value >= least else f"must be at least limits.e_a = {least:g} {axis.command_unit}"
    return ""


def _volts(axis: AxisConfig, new: Mapping[str, float], values: Mapping[str, float]) -> str | None:
    most, unit = axis.limits.output, axis.command_unit
    bias, what = abs(new["bias"]), "|bias|"
    if axis.mode == "velocity":
        bias += abs(new["reference"]) / new.get("K_L", gain_range(axis.K_L)[0])
        what = "|reference| / K_L + |bias|"
    if new["e_a"] + bias <= most:
        return None
    blamed = next((key for key in ("e_a", "reference", "K_L") if key in values), "bias")
    return f"{blamed}: e_a + {what} = {new['e_a'] + bias:g} {unit} is over limits.output = {most:g} {unit}"


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
