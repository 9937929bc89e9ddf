"""Whether the answer depends on the relay's amplitude, which that of a linear plant does not.

A deadband, friction, hysteresis or a supply that is nearly spent change one limit cycle as another gain or
damping would: at a single amplitude the fit is good and its numbers are wrong. Two amplitudes show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.estimate.base import Dependence

if TYPE_CHECKING:
    from seod.estimate.base import Estimate

ALLOWED: Final = {"zeta": 0.03, "omega_n": 0.01, "K_L": 0.01}
"""Parts by which answers may differ at twice the amplitude: no more than the method is good for. Amplitudes
that are closer must differ by less."""
CERTAIN: Final = 5.0
"""Standard deviations of the difference beyond which it is none of noise's; answers come many a second."""
SAME_E_A: Final = 0.1
"""Amplitudes that differ by less than this part are one level."""
SAME_CONDITION: Final = {"ps": 0.02, "temperature": 0.01}
"""Parts by which conditions may differ between levels that are compared; 3 K."""
FRESH_S: Final = 30.0
"""An answer at another level is compared for so long: the plant drifts."""
MOST: Final = 8
"""Levels that are remembered."""

ADVICE: Final = (
    "at e_a = {other:g} V the answer is another (friction, deadband, hysteresis or pressure limit): "
    "state e_a with it, or find by `seod ramp` where it does not depend on it{bound}"
)
UP_TO: Final = (
    "; by these two, zeta and omega_n are within {part:.0%} of small movements' up to e_a = {e_a:.2g} V"
)
FROM_ON: Final = "; by these two, dry friction changes zeta by {part:.0%} or less from e_a = {e_a:.2g} V on"
WITHIN: Final = 0.02
"""Part by which an answer may differ from that of small movements, or of large ones where friction is why."""


@dataclass(frozen=True, slots=True)
class _Level:
    e_a: float
    estimate: Estimate


class Levels:
    """Remembers the newest good answer at each of the last amplitudes, and what the comparison told.

    A finding stays while the amplitude does, even when the answer at the other one is long past.
    """

    def __init__(self) -> None:
        self.finding: Dependence | None = None
        """At the present amplitude."""
        self._levels: list[_Level] = []
        self._e_a = math.nan

    def compare(self, e_a: float, estimate: Estimate) -> Dependence | None:
        """Take an answer that is `ok` at the amplitude `e_a` [V]; what is known of its dependence."""
        if not _same(e_a, self._e_a, SAME_E_A):
            self._e_a, self.finding = e_a, None
        others = [each for each in self._levels if not _same(each.e_a, e_a, SAME_E_A)]
        fresh = [each for each in others if _comparable(each.estimate, estimate)]
        if fresh:
            nearest = min(fresh, key=lambda each: abs(math.log(each.e_a / e_a)))
            self.finding = dependence(nearest.e_a, nearest.estimate, e_a, estimate)
        self._levels = [*others[-(MOST - 1) :], _Level(e_a, estimate)]
        return self.finding


def dependence(other_e_a: float, other: Estimate, here_e_a: float, here: Estimate) -> Dependence | None:
    """Compare two answers; None where one lacks numbers or deviations."""
    differences: dict[str, tuple[float, float]] = {}
    for name in ALLOWED:
        values = [getattr(each, name) for each in (here, other)]
        sds = [getattr(each, f"{name}_sd") for each in (here, other)]
        if name == "K_L" and not any(sds):
            continue  # certain: no finding of either
        if None in values or None in sds or not values[1]:
            return None
        differences[name] = values[0] / values[1] - 1.0, math.hypot(*sds) / abs(values[1])
    octaves = min(abs(math.log2(here_e_a / other_e_a)), 1.0)
    surprises = {name: abs(part) / max(sd, 1e-12) for name, (part, sd) in differences.items()}
    return Dependence(
        other_e_a,
        zeta=differences["zeta"][0],
        omega_n=differences["omega_n"][0],
        K_L=differences["K_L"][0] if "K_L" in differences else None,
        sds=max(surprises.values()),
        matters=any(
            surprises[name] > CERTAIN and abs(part) > octaves * ALLOWED[name]
            for name, (part, _) in differences.items()
        ),
    )


def advise(e_a: float, finding: Dependence) -> str:
    """What to do about an answer at `e_a` [V] that depends on it: which amplitudes would do.

    A relay holds the valve open by e_a all the time, and an open orifice damps in proportion to its opening:
    zeta rises in proportion to e_a (docs/hydraulics.md, measured on physical rigs). Dry friction damps in
    proportion to 1 / e_a, so that zeta falls.
    """
    return ADVICE.format(other=finding.other_e_a, bound=_bound(e_a, finding))


def _bound(here: float, finding: Dependence) -> str:
    other = finding.other_e_a
    falls = (finding.zeta > 0.0) != (here > other)
    if falls:
        slope = _slope(1.0 / here, 1.0 / other, finding.zeta)
        return FROM_ON.format(part=WITHIN, e_a=slope / WITHIN) if slope else ""
    slopes = [_slope(here, other, part) for part in (finding.zeta, finding.omega_n)]
    steepest = max((slope for slope in slopes if slope), default=None)
    return UP_TO.format(part=WITHIN, e_a=WITHIN / steepest) if steepest else ""


def _slope(here: float, other: float, part: float) -> float | None:
    """Slope of a line through two values over its value at 0; the second is 1, the first larger by `part`.

    None: the line falls to 0 before.
    """
    slope = part / (here - other)
    at_zero = 1.0 - slope * other
    return abs(slope) / at_zero if at_zero > 0.0 else None


def _comparable(other: Estimate, here: Estimate) -> bool:
    """Whether both answers are of one plant: close in time, by one method, under like conditions."""
    if here.t - other.t > FRESH_S or here.method != other.method:
        return False
    pairs = ((getattr(other, name), getattr(here, name), part) for name, part in SAME_CONDITION.items())
    return all(a is None or b is None or _same(a, b, part) for a, b, part in pairs)


def _same(a: float, b: float, part: float) -> bool:
    return abs(a - b) <= part * max(abs(a), abs(b))
