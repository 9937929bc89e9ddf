"""Columns, units and signs that are wrong, by what no plant does."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seod.diagnose.tuning.record import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.data import Recording
    from seod.diagnose.result import Array

_UNITS: Final = {
    math.degrees(1.0): "degrees for radians",
    1e3: "thousandths for the unit itself",
    1e6: "millionths for the unit itself",
    60.0 / (2.0 * math.pi): "turns a minute for rad/s",
    2.0 * math.pi: "turns for radians",
    25.4: "mm for inches",
}

_OF_TIME: Final = {"ms": 1e3, "us": 1e6}
"""Units that times without one may be in, and how many are a second."""


def tells_supply(recording: Recording) -> bool:
    """Whether it has a supply pressure, that is above 0 in most of its rows that tell one."""
    ps = recording.ps
    return ps is not None and bool(np.isfinite(ps).any()) and float(np.nanmedian(ps)) > 0.0


def with_believed_supply(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """Without a supply pressure that is none, and what is said of that."""
    ps = recording.ps
    if ps is None or tells_supply(recording):
        return recording, ()
    if not np.isfinite(ps).any():
        return replace(recording, ps=None), ()
    times = "seldom" if np.any(ps > 0.0) else "never"
    column = recording.names.get("ps", "ps")
    said = (
        f"{recording.paths[0]}: column {column!r}, the supply pressure ps, is {times} above 0: is its sensor "
        "connected? It is not used. Right would be a pressure above 0, of another column by --columns ps=..."
    )
    return replace(recording, ps=None), (said,)


def column_remarks(name: str, recording: Recording) -> list[str]:
    """What is wrong with the columns themselves."""
    u, y = recording.u, recording.y
    both = np.isfinite(u) & np.isfinite(y)
    if np.count_nonzero(both) < COLUMNS.fewest_samples or np.ptp(u[both]) == 0.0 or np.ptp(y[both]) == 0.0:
        return []
    t, u, y = recording.t[both], u[both], y[both]
    remarks = []
    told = recording.read_in.get("t") or _is_doubted(recording)
    if recording.rate_hz < COLUMNS.slowest_hz and not told:
        remarks.append(
            f"{name}: {recording.rate_hz:.3g} samples a second: is t in ms? Then give --units t=ms"
        )
    if _one_signal(y, t):
        remarks.append(f"{name}: y is a straight line over t: the wrong column? Give --columns y=...")
    elif _one_signal(y, u):
        remarks.append(
            f"{name}: y is u at another scale, without any delay: the wrong column? Give --columns"
        )
    elif _steps(y) and not _steps(u):
        remarks.append(
            f"{name}: y jumps between few values and u runs smoothly: are the columns exchanged? "
            "Give --columns u=...,y=..."
        )
    return remarks


def _one_signal(a: Array, b: Array) -> bool:
    return abs(float(np.corrcoef(a, b)[0, 1])) > COLUMNS.same_signal


def _steps(x: Array) -> bool:
    """Takes few values and seldom leaves one: a command, not a movement."""
    change = np.abs(np.diff(x))
    few = len(np.unique(x)) < COLUMNS.few_values
    return few and float(np.max(change)) > COLUMNS.large_step * float(np.ptp(x))


def different_units(recordings: Sequence[Recording]) -> str:
    """Where recordings that one model is to explain are in different units; "" where they are not."""
    first = recordings[0]
    for each in recordings[1:]:
        for role in ("u", "y"):
            one, other = first.units.get(role, ""), each.units.get(role, "")
            if one and other and one != other:
                return (
                    f"{each.paths[0]}: {role} is in {other}, in {first.paths[0]} in {one}: "
                    f"give --units {role}=... that holds for all files"
                )
    return ""


def gain_remarks(name: str, K_L: float | None, expected: float | None = None) -> list[str]:
    """What a fitted gain [unit/s/V] says about sign and unit; `expected`: the rig file's."""
    remarks: list[str] = []
    if K_L is None:
        return remarks
    if K_L < 0.0 and not (expected and expected < 0.0):
        remarks.append(f"{name}: the fitted K_L is negative: the sign of u or of y is turned round")
    if expected:
        found = _unit(abs(K_L / expected))
        if found:
            remarks.append(
                f"{name}: K_L is {abs(K_L / expected):.3g} times that of the rig file: {found}? "
                "Give --units y=..."
            )
    return remarks


def time_remarks(recording: Recording, omega_n: float) -> list[str]:
    """What a fitted omega_n [rad/s] says about the unit of times for which nobody told one.

    Nothing where the rate has been doubted already.
    """
    doubted = recording.rate_hz < COLUMNS.slowest_hz or _is_doubted(recording)
    if recording.read_in.get("t") or doubted or not 0.0 < omega_n < COLUMNS.slowest_plant:
        return []
    fast = [each for each in _OF_TIME.items() if each[1] * omega_n >= COLUMNS.slowest_plant]
    unit, factor = next(iter(fast), ("us", _OF_TIME["us"]))
    return [
        f"{recording.paths[0]}: t has no unit and is taken to be in s: omega_n is {omega_n:.3g} rad/s. "
        f"If it is in {unit}, omega_n is {factor * omega_n:.3g} rad/s: `--units t={unit}` says so"
    ]


def _is_doubted(recording: Recording) -> bool:
    """Whether the reader of the file has said already that times may be in another unit."""
    return any(problem.kind == "unit" for problem in recording.problems)


def _unit(ratio: float) -> str:
    if not ratio > 0.0:
        return ""
    for factor, text in _UNITS.items():
        for sign in (1.0, -1.0):
            if abs(math.log(ratio) - sign * math.log(factor)) < COLUMNS.unit_tolerance:
                return text if sign > 0.0 else " for ".join(reversed(text.split(" for ")))
    return ""
