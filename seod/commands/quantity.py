"""Options that are numbers with a unit: `0.5`, `400 mV`, `4 ms`."""

from __future__ import annotations

import math
from typing import Any

import typer


class Quantity:
    """Reads a number in SI, or text with its unit, within a range.

    Args:
        dimensions: Those that are right.
        least: Smallest value.
        most: Largest value.
    """

    def __init__(self, *dimensions: str, least: float = -math.inf, most: float = math.inf) -> None:
        self.__name__ = "number"  # typer asks for it
        self._dimensions, self._least, self._most = dimensions, least, most

    def __call__(self, value: str | float) -> float:
        """The number in SI.

        Raises:
            typer.BadParameter: It is none, of another dimension, or out of range.
        """
        number = self._number(value)
        if not math.isfinite(number):
            raise typer.BadParameter("must be a finite number")
        if not self._least <= number <= self._most:
            raise typer.BadParameter(f"{value} is not in the range {self._least:g} to {self._most:g}")
        return number

    def _number(self, value: str | float) -> float:
        from seod.config.units import parse_quantity  # noqa: PLC0415 - few commands need it

        try:
            return float(value)
        except ValueError:
            pass
        try:
            return parse_quantity(value, *self._dimensions)
        except ValueError as error:
            raise typer.BadParameter(f"{value!r}: {error}") from error


class Gain(Quantity):
    """K_L: never 0."""

    def __call__(self, value: str | float) -> float:
        """As of `Quantity`."""
        from seod.config.units import GAINS  # noqa: PLC0415 - few commands need it

        self._dimensions = GAINS
        number = super().__call__(value)
        if number == 0.0:
            raise typer.BadParameter("must be a number other than 0")
        return number


def volts(least: float = 0.0, most: float = 1e4) -> dict[str, Any]:
    """What makes an option a voltage [V]."""
    return {"metavar": "VOLTS", "parser": Quantity("voltage", least=least, most=most)}


def seconds(least: float = 0.0, most: float = 1e9) -> dict[str, Any]:
    """What makes an option a time [s]."""
    return {"metavar": "SECONDS", "parser": Quantity("time", least=least, most=most)}


def hertz(least: float = 1e-6) -> dict[str, Any]:
    """What makes an option a frequency [Hz]."""
    return {"metavar": "HERTZ", "parser": Quantity("frequency", least=least)}
