"""What is measured of one half cycle, and by how much the fits mistake a known limit cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.estimate.limit_cycle.closed_form import LimitCycle
from seod.estimate.limit_cycle.inversion import Measured, Plant
from seod.estimate.limit_cycle.local_fit import crossing, peak

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.estimate.arrays import Array

CROSSING_WIDTH = 0.25
PEAK_WIDTH = 0.35
"""Half-widths of the fitted segments, in half cycles."""
_GRID = np.linspace(-0.5, 1.0, 145)


class HalfCycle(NamedTuple):
    """One half cycle of the relay, from a switch to the next.

    `before` and `after` are the half cycles before and after the switch [s]; `lag` goes from the crossing to
    the switch really applied [s]; `t_peak` and `peak` are the extreme position that follows [s, axis unit].
    """

    up: bool
    before: float
    after: float
    lag: float
    t_peak: float
    peak: float


class SwitchWindow(NamedTuple):
    """Where to look: the switch really applied, when it was seen, its level, the half cycles around it."""

    up: bool
    applied: float
    seen: float
    level: float
    before: float
    after: float


def measure(around: SwitchWindow, t: Array, y: Array) -> HalfCycle | None:
    """Fit the crossing that caused a switch and the peak after it; None where the samples do not show them.

    Args:
        around: Where to look.
        t: Times of samples [s], ascending, shape (n,).
        y: Position [axis unit], shape (n,).
    """
    up, applied, seen, level, before, after = around
    if min(before, after) <= 0.0:
        return None
    crossed = crossing(t, y, level, seen, CROSSING_WIDTH * min(before, after))
    if crossed is None:
        return None
    top = peak(t, y, -1 if up else 1, crossed + 0.5 * after, PEAK_WIDTH * after)
    return top and HalfCycle(up, before, after, applied - crossed, *top)


def means(halves: Sequence[HalfCycle]) -> Measured | None:
    """Half cycles as one periodic limit cycle; None before there are both kinds."""
    ups, downs = [h for h in halves if h.up], [h for h in halves if not h.up]
    if not ups or not downs:
        return None
    return Measured(
        h_up=_mean([h.before for h in downs]),  # the relay was up before it switched down
        h_down=_mean([h.before for h in ups]),
        lag_up=_mean([h.lag for h in ups]),
        lag_down=_mean([h.lag for h in downs]),
        V_s=0.5 * (_mean([h.peak for h in downs]) - _mean([h.peak for h in ups])),
    )


def without_fit_error(measured: Measured, plant: Plant, gain: float) -> Measured:
    """`measured` less what the fits would mistake on the limit cycle of `plant`; gain is K_L e_a.

    The motion has a kink at each switch, the sharper the more damping, and no polynomial has one.
    """
    h_up, h_down, lag_up, lag_down = (plant.omega_n * x for x in measured[:4])
    cycle = LimitCycle.of(plant.zeta, h_up, h_down)
    t = _GRID * (h_up + h_down) + 0.5 * (h_up - h_down)
    y = cycle.positions(t)
    up = measure(SwitchWindow(True, 0.0, -lag_up, cycle.position(-lag_up), h_down, h_up), t, y)
    level = cycle.position(h_up - lag_down)
    down = measure(SwitchWindow(False, h_up, h_up - lag_down, level, h_up, h_down), t, y)
    if up is None or down is None:
        return measured
    V_s = 0.5 * (down.peak - up.peak - cycle.peak_to_peak())
    return measured._replace(
        lag_up=measured.lag_up - (up.lag - lag_up) / plant.omega_n,
        lag_down=measured.lag_down - (down.lag - lag_down) / plant.omega_n,
        V_s=measured.V_s - V_s * gain / plant.omega_n,
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
