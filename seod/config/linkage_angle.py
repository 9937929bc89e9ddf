"""From a cylinder's stroke to the angle it makes: a table or a crank. Cheap enough for the loop: no numpy."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

from seod.config.units import UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.config.linkage import LinkageConfig


class Linkage(Protocol):
    """One geometry."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest stroke that it knows [m]."""

    def angle(self, stroke: float) -> float:
        """Angle [rad] at a stroke [m]."""


class Crank:
    """A cylinder of length rod + stroke between a fixed pivot and a crank's arm.

    The law of cosines: (rod + stroke)^2 = base^2 + arm^2 - 2 base arm cos(phi), phi between base and arm.
    Strokes that the triangle does not reach are taken as its last one.

    Args:
        base: From the crank's axis to the fixed pivot [m].
        rod: Length between the pivots at stroke 0 [m].
        arm: From the crank's axis to the rod's pivot [m].
        zero: Stroke at which the angle is 0 [m].
        sign: -1 where the angle falls as the cylinder extends.
    """

    def __init__(self, base: float, rod: float, arm: float, zero: float, sign: int) -> None:
        self.rod = rod
        self.squares = base * base + arm * arm
        self.product = 2.0 * base * arm
        self.sign = sign
        self.at_zero = 0.0
        self.at_zero = sign * self.angle(zero)

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest stroke of the triangle [m]."""
        shortest, longest = self.squares - self.product, self.squares + self.product
        return math.sqrt(shortest) - self.rod, math.sqrt(longest) - self.rod

    def angle(self, stroke: float) -> float:
        """Angle [rad] at a stroke [m]."""
        length = max(0.0, self.rod + stroke)
        cosine = (self.squares - length * length) / self.product
        return self.sign * (math.acos(max(-1.0, min(1.0, cosine))) - self.at_zero)


class Table:
    """Cubic pieces between points; beyond the ends straight on, so that limits of travel still see it.

    Args:
        strokes: Ascending [m].
        angles: Monotone [rad].
        slopes: Slope at each point [rad/m] for a smooth curve; None for straight pieces.
    """

    def __init__(
        self, strokes: Sequence[float], angles: Sequence[float], slopes: Sequence[float] | None
    ) -> None:
        self.strokes = list(strokes)
        self.pieces = [_piece(strokes, angles, slopes, k) for k in range(len(strokes) - 1)]
        self.last = len(self.pieces) - 1
        first, last = self.pieces[0], self.pieces[-1]
        h = strokes[-1] - strokes[-2]
        self.before = (angles[0], first[1])
        self.after = (angles[-1], last[1] + h * (2.0 * last[2] + 3.0 * h * last[3]))

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest stroke of the table [m]."""
        return self.strokes[0], self.strokes[-1]

    def angle(self, stroke: float) -> float:
        """Angle [rad] at a stroke [m]."""
        strokes = self.strokes
        k = bisect_right(strokes, stroke) - 1
        if k < 0:
            return self.before[0] + self.before[1] * (stroke - strokes[0])
        if k > self.last:
            return self.after[0] + self.after[1] * (stroke - strokes[-1])
        a, b, c, d = self.pieces[k]
        x = stroke - strokes[k]
        return a + x * (b + x * (c + x * d))


def _piece(
    strokes: Sequence[float], angles: Sequence[float], slopes: Sequence[float] | None, k: int
) -> tuple[float, float, float, float]:
    """Coefficients of the polynomial from point k on: through both points, with both slopes."""
    h = strokes[k + 1] - strokes[k]
    rise = (angles[k + 1] - angles[k]) / h
    if slopes is None:
        return angles[k], rise, 0.0, 0.0
    left, right = slopes[k], slopes[k + 1]
    return angles[k], left, (3.0 * rise - 2.0 * left - right) / h, (left + right - 2.0 * rise) / (h * h)


def monotone_slopes(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Slopes at the points of a monotone table that keep the cubic curve monotone.

    Inside the weighted harmonic mean of the neighbouring slopes (Fritsch and Butland 1984), at the ends the
    slope of the first and last piece, which is never above the three times it that monotony allows.
    """
    steps = [b - a for a, b in pairwise(x)]
    rises = [(b - a) / h for (a, b), h in zip(pairwise(y), steps, strict=True)]
    inner = [
        3.0 * (h + g) / ((2.0 * g + h) / r + (g + 2.0 * h) / s)
        for (h, g), (r, s) in zip(pairwise(steps), pairwise(rises), strict=True)
    ]
    return [rises[0], *inner, rises[-1]]


def make_linkage(config: LinkageConfig, stroke_unit: str) -> Linkage:
    """The linkage of a rig file; `stroke_unit` is that of the table's strokes."""
    if config.crank is not None:
        crank = config.crank
        return Crank(crank.base, crank.rod, crank.arm, crank.zero, crank.sign)
    table = config.table
    if table is None:
        raise ValueError("a linkage needs either table or crank")
    strokes = [stroke * UNITS[stroke_unit][1] for stroke in table.stroke]
    angles = [angle * UNITS[config.unit][1] for angle in table.angle]
    smooth = table.interpolation == "cubic"
    return Table(strokes, angles, monotone_slopes(strokes, angles) if smooth else None)
