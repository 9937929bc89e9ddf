"""The model that a rig's file has, as the baseline."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.extend.model import Model
from seod.diagnose.result import DiagnoseError
from seod.simulate.view import AxisView, plant_of
from sim.effects import EFFECTS
from sim.experiment import sensor_effects

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.config.model import RigConfig


class Rated(NamedTuple):
    """What the file says of an axis' plant.

    Attributes:
        effects: But for defects of records, in the axis' unit and volts of its output.
        K_L: Likewise [unit/s/V]; None where the file does not tell.
        conditions: Supply pressure and temperature at which they hold, as `record.series.series` takes them.
    """

    effects: Mapping[str, Mapping[str, float]]
    K_L: float | None
    conditions: dict[str, float]


def rated(config: RigConfig | None, axis: str | None) -> Rated:
    """The plant of an axis, None: the first; without effects where there is no file, or it simulates nothing.

    Raises:
        DiagnoseError: It simulates plants, but none that this axis' output moves.
    """
    if config is None or config.simulation is None:
        return Rated({}, None, {})
    name = axis or next(iter(config.axes))
    try:
        plant, view = plant_of(config, name), AxisView(config, name)
    except ValueError as error:
        raise DiagnoseError(str(error)) from error
    plant = plant.reduced
    effects = {**plant.effects, **sensor_effects(plant)}
    lasting = {of: values for of, values in effects.items() if EFFECTS[of].enters != "record"}
    own = Model(plant.K_L, plant.omega_n, plant.zeta, lasting)
    seen = own.in_units_of(1.0 / view.slope, 1.0 / view.per_volt)
    told = {"nominal_ps": plant.nominal_pressure, "nominal_temperature": plant.nominal_temperature}
    conditions = {name: value for name, value in told.items() if value is not None}
    return Rated(seen.effects, seen.K_L, conditions)
