"""The valve's map in plain numbers: what a command is worth, which is worth so much, and its slope."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim.effects import MAP_KNOTS

if TYPE_CHECKING:
    from collections.abc import Mapping

NEAR = 1e-6
"""Part of the range over which the slope is taken, to the side that is asked."""
MOST_HALVINGS = 2000
"""Until two neighbouring numbers are left, also near zero."""


class ValveMap:
    """`static_valve_map` of a plant.

    Args:
        p: The kernel's parameters by name.
    """

    def __init__(self, p: Mapping[str, float]) -> None:
        self.range = p["static_valve_map_range"]
        bends = [p[f"static_valve_map_bend_{k}"] for k in range(1, MAP_KNOTS)]
        tilts = [p[f"static_valve_map_tilt_{k}"] for k in range(1, MAP_KNOTS + 1)]
        self._bend, self._tilt = (0.0, *bends, 0.0), (0.0, *tilts)

    def worth(self, volts: float) -> float:
        """Of a command [V]."""
        if math.isinf(self.range):
            return volts
        s = min(MAP_KNOTS * abs(volts) / self.range, float(MAP_KNOTS))
        bend = _through(s, self._bend)
        return volts + (-bend if volts < 0.0 else bend) + _through(s, self._tilt)

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
        """Of what a command is worth over it, to the side -1 or 1 of it; 0: the mean of both."""
        if math.isinf(self.range):
            return 1.0
        if side == 0.0:
            return 0.5 * (self.slope(volts, -1.0) + self.slope(volts, 1.0))
        step = side * NEAR * self.range
        return (4.0 * self.worth(volts + step) - self.worth(volts + 2.0 * step) - 3.0 * self.worth(volts)) / (
            2.0 * step
        )


def _through(s: float, knots: tuple[float, ...]) -> float:
    """A smooth curve through knots at 0, 1, 2 and 3: from the first three's parabola to the last three's."""
    begins, ends = _parabola(s, knots[:3]), _parabola(s - 1.0, knots[1:])
    return begins + min(max(s - 1.0, 0.0), 1.0) * (ends - begins)


def _parabola(s: float, knots: tuple[float, ...]) -> float:
    """Through three knots at 0, 1 and 2."""
    first, second, third = knots
    return first + s * (second - first) + 0.5 * s * (s - 1.0) * (third - 2.0 * second + first)
