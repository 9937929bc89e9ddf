"""A plant with effects, and the same plant in other units or behind a turned command."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from seod.diagnose.causes.table import MIRRORED, OFFSET, OFFSET_DRIFT_PLACE, OFFSET_PLACE
from sim.effects import parameter, power_of_y
from sim.parameters import nulls

if TYPE_CHECKING:
    from collections.abc import Callable

Effects = dict[str, dict[str, float]]

_DIGITS: Final = 7


@dataclass(frozen=True)
class Model:
    """What is written: Eq. 1 with effects, in SI.

    Attributes:
        K_L: Gain [unit/s/V]; negative for an actuator that is wired the other way round.
        omega_n: [rad/s].
        zeta: Damping ratio.
        effects: By effect and parameter.
        noise: Standard deviation of the sensor's noise [unit, of a speed unit/s].
    """

    K_L: float
    omega_n: float
    zeta: float
    effects: Effects = field(default_factory=dict)
    noise: float = 0.0

    def upright(self) -> Model:
        """The same plant behind the command that moves it up."""
        if self.K_L > 0.0:
            return self
        return replace(
            self, K_L=-self.K_L, effects=self._scaled(lambda place: -1.0 if place in MIRRORED else 1.0)
        )

    def steady(self, lasts: float) -> Model:
        """The same under its mean load over so long [s]: a rig goes on for hours, a drift does not."""
        load = dict(self.effects.get(OFFSET, {}))
        grown = 0.5 * lasts * load.pop(OFFSET_DRIFT_PLACE.split(".")[1], 0.0)
        if not grown:
            return self
        of = OFFSET_PLACE.split(".")[1]
        return replace(self, effects=self.effects | {OFFSET: load | {of: load.get(of, 0.0) + grown}})

    def in_units_of(self, slope: float, per_volt: float) -> Model:
        """As a plant has it whose unit is `slope` of ours, and which gets `per_volt` volts for our one."""
        effects = self._scaled(lambda place: _factor(place, slope, per_volt))
        return replace(self, K_L=self.K_L / (slope * per_volt), effects=effects, noise=self.noise / slope)

    def numbers(self) -> dict[str, Any]:
        """Keys of a plant's section, effects that do nothing left out."""
        off = nulls()
        effects = {
            name: {of: rounded(x) for of, x in values.items() if math.isfinite(x)}
            for name, values in self.effects.items()
            if any(x != off[f"{name}_{of}"] for of, x in values.items())
        }
        base: dict[str, Any] = {
            "K_L": rounded(self.K_L),
            "omega_n": rounded(self.omega_n),
            "zeta": rounded(self.zeta),
        }
        return base | ({"noise": rounded(self.noise)} if self.noise else {}) | {"effects": effects}

    def _scaled(self, factor: Callable[[str], float]) -> Effects:
        return {
            name: {of: x * factor(f"{name}.{of}") for of, x in values.items()}
            for name, values in self.effects.items()
        }


def _factor(place: str, slope: float, per_volt: float) -> float:
    """By which a parameter grows in a plant's own units."""
    unit = parameter(place)[1].unit
    if power := power_of_y(unit):
        return 1.0 / slope if power > 0 else slope
    return per_volt if unit.split("/")[0] == "V" else 1.0


def rounded(value: float) -> float:
    """To the digits that are written."""
    return float(f"{value:.{_DIGITS}g}")
