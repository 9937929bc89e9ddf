"""Supply pressure and temperature of a simulated recording: constants of the rig, or courses from a file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.loop.sensor import make_sensor
from sim.truth import LEAST_SUPPLY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.simulate.view import AxisView
    from sim.excitation import GivenInput

    Array = NDArray[np.float64]


class Surroundings:
    """What a plant runs under, row by row.

    Args:
        view: The axis.
        n: Number of rows.
        given: A file that may tell both.

    Attributes:
        ps: Supply pressure [Pa], shape (n,); nan where nobody tells it.
        temperature: [K], likewise.
        supply: Supply pressure over nominal, shape (n,); shape (0,) where the plant follows none.
        warmth: Temperature above nominal [K], likewise.

    Raises:
        ValueError: The file tells what the plant cannot follow.
    """

    def __init__(self, view: AxisView, n: int, given: GivenInput | None = None) -> None:
        plant, axis = view.plant, view.axis
        ps = given.ps if given else None
        temperature = given.temperature if given else None
        self.ps, supply = _course(view, n, "ps", axis.supply_pressure, plant.supply_pressure, ps)
        self.temperature, warm = _course(
            view, n, "temperature", axis.temperature, plant.temperature, temperature
        )
        self.supply = np.maximum(supply / (plant.nominal_pressure or 1.0), LEAST_SUPPLY)
        self.warmth = warm - (plant.nominal_temperature or 0.0)

    def columns(self) -> dict[str, Array]:
        """Those that are known."""
        both = {"ps": self.ps, "temperature": self.temperature}
        return {name: column for name, column in both.items() if not np.isnan(column).all()}


def _course(
    view: AxisView, n: int, name: str, sensor: str | None, followed: str | None, given: Array | None
) -> tuple[Array, Array]:
    """In SI as the axis' sensor tells it, and as numbers of the channel that the plant follows (or none)."""
    constants = view.config.simulation.constants if view.config.simulation else {}
    if given is not None:
        if followed is None:
            key = "supply_pressure" if name == "ps" else "temperature"
            raise ValueError(
                f"the input has {name}, but the plant follows none: give it `{key}` and its nominal"
            )
        zero, slope = _line(view, followed)
        return given, (given - zero) / slope
    numbers = np.full(n, constants[followed]) if followed is not None else np.empty(0)
    if sensor is None:
        return np.full(n, math.nan), numbers
    config = view.config.sensors[sensor]
    return np.full(n, make_sensor(config).read(constants[config.channel])), numbers


def _line(view: AxisView, channel: str) -> tuple[float, float]:
    """SI value at number 0 of a channel, and per number; as they are where no sensor reads it."""
    for config in view.config.sensors.values():
        if config.channel == channel:
            sensor = make_sensor(config)
            zero = sensor.convert(0.0)
            return zero, sensor.convert(1.0) - zero
    return 0.0, 1.0
