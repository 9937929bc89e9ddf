"""Options that every question takes, from however they are written to numbers in SI."""

from __future__ import annotations

from seod.api.data import pair
from seod.config.units import GAINS, parse_quantity

Number = float | str
"""A number in SI, or text with its unit: `0.004`, `"4 ms"`."""


def gain_of(gain: Number | None) -> float | None:
    """K_L in SI.

    Raises:
        ValueError: It is no gain, or 0.
    """
    value = _quantity("gain", gain, *GAINS)
    if value == 0.0:
        raise ValueError("gain: must be a number other than 0")
    return value


def delay_of(delay: Number | None) -> float | None:
    """A delay [s].

    Raises:
        ValueError: It is no time, or negative.
    """
    value = _quantity("delay", delay, "time")
    if value is not None and not value >= 0.0:
        raise ValueError(f"delay: must be 0 or more, got {delay}")
    return value


def volts_of(name: str, value: Number | None) -> float | None:
    """A voltage [V].

    Raises:
        ValueError: It is none.
    """
    return _quantity(name, value, "voltage")


def seconds_of(name: str, value: Number | None) -> float | None:
    """A time [s].

    Raises:
        ValueError: It is none.
    """
    return _quantity(name, value, "time")


def hertz_of(name: str, value: Number | None) -> float | None:
    """A frequency [Hz].

    Raises:
        ValueError: It is none.
    """
    return _quantity(name, value, "frequency")


def part_of(between: str | tuple[float, float] | None) -> tuple[float, float] | None:
    """A part of a recording [s].

    Raises:
        ValueError: It is none.
    """
    return None if between is None else pair(between, "--between")


def _quantity(name: str, value: Number | None, *dimensions: str) -> float | None:
    if value is None:
        return None
    try:
        return parse_quantity(value, *dimensions)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
