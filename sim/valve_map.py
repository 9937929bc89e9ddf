"""The valve's map in plain numbers: what a command is worth, which is worth so much, and its slope."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from sim.effects import MAP_BENDS, MAP_TILTS

if TYPE_CHECKING:
    from collections.abc import Mapping

NEAR = 1e-6
"""Part of the range over which the slope is taken, to the side that is asked."""
MOST_HALVINGS = 2000
"""Until two neighbouring numbers are left, also near zero."""


class ValveMap:
    """`static_valve_map` of a plant.

    Attributes:
        range: The command of its end [V].
        at_ports: It acts on what the spool opens; else on commands. Below, "command" is either.

    Args:
        p: The kernel's parameters by name.
    """

    def __init__(self, p: Mapping[str, float]) -> None:
        of = {name: p[f"static_valve_map_{name}"] for name in (*MAP_BENDS, *MAP_TILTS, "range", "rounding")}
        self.range, self._rounding = of["range"], of["rounding"]
        self.at_ports = p.get("static_valve_map_at_ports", 0.0) != 0.0
        self._at = (0.0, p["static_valve_map_knot_1"], p["static_valve_map_knot_2"], 1.0)
        self._bend = (0.0, *(of[name] for name in MAP_BENDS), 0.0)
        self._tilt = (0.0, *(of[name] for name in MAP_TILTS))

    def worth(self, volts: float) -> float:
        """What a command [V] is worth [V]."""
        if math.isinf(self.range):
            return volts
        part = min(abs(volts) / self.range, 1.0)
        bend = self._through(part, self._bend)
        return volts + (-bend if volts < 0.0 else bend) + self._through(part, self._tilt)

    def command(self, worth: float) -> float:
        """The command that is worth so much [V]; of a map that is flat there one of them."""
        if math.isinf(self.range) or worth == 0.0:
            return worth
        low, high = worth - self.range, worth + self.range
        while self.worth(low) > worth or self.worth(high) < worth:
            low, high = low - self.range, high + self.range
        for _ in range(MOST_HALVINGS):
            middle = 0.5 * (low + high)
            if middle in {low, high}:
                break
            low, high = (low, middle) if self.worth(middle) > worth else (middle, high)
        return high

    def slope(self, volts: float, side: float) -> float:
        """Of what a command is worth over it [1].

        Args:
            volts: The command [V].
            side: -1, 1: to this side of it; 0: the mean of both.
        """
        if math.isinf(self.range):
            return 1.0
        if side == 0.0:
            return 0.5 * (self.slope(volts, -1.0) + self.slope(volts, 1.0))
        step = side * NEAR * self.range
        return (4.0 * self.worth(volts + step) - self.worth(volts + 2.0 * step) - 3.0 * self.worth(volts)) / (
            2.0 * step
        )

    def _through(self, part: float, knots: tuple[float, ...]) -> float:
        """Straight lines through the knots, with rounded corners."""
        places = list(pairwise(self._at))
        slopes = [
            (after - before) / (b - a)
            for (a, b), (before, after) in zip(places, pairwise(knots), strict=True)
        ]
        turns = [after - before for before, after in pairwise(slopes)]
        bent = zip(turns, self._at[1:3], strict=True)
        return slopes[0] * part + sum(turn * _corner(part, at, self._rounding) for turn, at in bent)


def _corner(part: float, at: float, rounding: float) -> float:
    """0 before `at`, a line of slope 1 beyond it, and between them a parabola, as wide as `rounding` says."""
    half = rounding * min(at, 1.0 - at)
    if part <= at - half:
        return 0.0
    return part - at if part >= at + half else (part - at + half) ** 2 / (4.0 * half)
