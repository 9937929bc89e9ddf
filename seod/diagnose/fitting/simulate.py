"""Simulations of windows, and of what a window's initial state does to them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting import work
from seod.diagnose.tuning.fitting import SIMULATION
from sim.physics import bends, friction_level
from sim.state import new_state
from sim.windows import INSIDE, START, follow_windows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array

STATES = len(START)
PRESSURE, VELOCITY, POSITION, VELOCITY_2, POSITION_2, LAGGED, LOOSE = range(STATES)
"""Columns of initial states, `sim.windows.START`."""
FOLLOWED, LOOSE_INSIDE = INSIDE.index("followed"), INSIDE.index("loose")
"""Further columns of what is inside, `sim.windows.INSIDE`; its first three are as of `START`."""
_NOTHING = np.empty((0, len(INSIDE)))


def simulate(record: NDArray[np.void], cut: Cut, start: Array) -> Array:
    """What is measured, windows end to end, from initial states of shape (w, 7)."""
    return _run(record, cut, start, states=False)[0]


def inside(record: NDArray[np.void], cut: Cut, start: Array) -> tuple[Array, Array]:
    """Likewise, and the load's state, `sim.windows.INSIDE`, shape (n, 5)."""
    return _run(record, cut, start, states=True)


def _run(record: NDArray[np.void], cut: Cut, start: Array, *, states: bool) -> tuple[Array, Array]:
    seen, within = [], []
    orifice = bool(np.isfinite(record[0]["square_root_flow_supply"]))
    for one, own, first, last, reach in cut.runs:
        begin = float(min(one.t[0], one.drive[0][0]))
        valve, load = new_state(record, begin), new_state(record, begin)
        load["origin"] = one.t[0]
        y = np.empty(len(one.t))
        z = np.empty((len(one.t), len(INSIDE))) if states else _NOTHING
        given = *one.drive, one.t, one.supply, one.warmth, one.force
        limit = SIMULATION.gone_beyond * reach
        follow_windows(record, valve, load, *given, first, last, start[own], limit, y, z)
        work.spend(float(load["steps"][0]), int(np.sum(last - first)), orifice=orifice)
        seen += [y[a:b] for a, b in zip(first, last, strict=True)]
        within += [z[a:b] for a, b in zip(first, last, strict=True)]
    return np.concatenate(seen), np.concatenate(within)


def moves_alike_everywhere(record: NDArray[np.void]) -> bool:
    """Whether a load that begins elsewhere is read as the same movement, as far from where it was."""
    one = record[0]
    endless = one["stop_low"] == -math.inf and one["stop_high"] == math.inf
    straight = one["rectified_sensor_part"] == 0.0 and one["rectified_sensor_power"] == 1.0
    straight = straight and one["position_ripple_amplitude"] == 0.0 and not bends(one)
    return bool(endless and straight and one["load_spring_stiffness"] == 0.0)


def loosest(record: NDArray[np.void]) -> float:
    """How far the load may be from the flank that it runs against, or bristles from their bend [unit].

    Infinite where nothing is loose.
    """
    plant, gap = record[0], float(record[0]["backlash_gap"])
    if plant["lugre_friction_stiffness"] > 0.0:
        gap = 2.0 * float(friction_level(plant, 0.0) / plant["lugre_friction_stiffness"])
    return gap or math.inf
