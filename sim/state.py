"""The kernel's state: where the plant is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.compiled import Record, compiled
from sim.matrix_steps import KEPT, STATES
from sim.physics import dry_friction, encoded, rectified

if TYPE_CHECKING:
    import numpy.typing as npt

STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "t",  # [s]
            "origin",  # [s] when drift and disturbance began
            "target",  # [V] where the spool is going: the command after saturation and hysteresis
            "spool",  # [V]
            "spool_speed",  # [V/s] of a spool with inertia
            "pressure",  # [unit/s^2] acceleration of the free load by the load pressure
            "velocity",  # [unit/s]
            "position",  # [unit]
            "velocity2",  # [unit/s] of the second inertia
            "position2",  # [unit]
            "bristle",  # [unit] mean deflection of LuGre friction's bristles
            "lagged",  # [unit, unit/s] behind the sensor's lag
            "followed",  # [unit] behind the backlash
            "motion",  # -1, 1: where the load moves; 0: it sticks
            "stopped",  # -1, 1: it lies at the low, the high end stop
            "supply",  # [1] supply pressure over its nominal value
            "warmth",  # [K] temperature above its nominal value
            "force",  # [unit of f] what the channel of a measured disturbance shows
            "level",  # [unit] threshold that the measurement is watched for
            "rate",  # [unit/s] at which the threshold moves
            "watch",  # -1, 1: the measurement falls below, rises above the threshold; 0: nothing is watched
            "passed",  # 1: it did, and the integration ended there
            "reading",  # [unit, unit/s] the last that was taken, where the sensor holds it
            "taken",  # [s] when
            "kept_square",  # [rad^2/s^2] and damping [1/s] of the plant that these are of (`sim.exact`)
            "kept_damping",
            "kept_h",  # [s] length of a step, and its factors
            "kept_answer",
            "kept_area",
            "kept_volume",
            "spare_h",  # those of another length
            "spare_answer",
            "spare_area",
            "spare_volume",
            "matrices_of",  # `by_matrix` of the plant that these are of (`sim.matrix_steps`)
            "owed",  # steps that they must still save
            "oldest",  # which of them is the next to go
            "steps",  # Runge-Kutta steps so far, an exact one a part of one: what the simulation costs
        )
    ]
    + [("lengths", np.float64, (KEPT,)), ("matrices", np.float64, (KEPT, STATES, STATES))]
)


@compiled
def rest(p: Record, s: Record, t: float, position: float) -> None:
    """Let the plant stand still at `position` [unit] at `t` [s], valve closed, load in balance."""
    s.t = s.origin = t
    s.target = s.spool = s.spool_speed = 0.0
    s.position = s.position2 = position
    s.velocity = s.velocity2 = 0.0
    s.pressure = p.load_bias_acceleration + p.load_spring_stiffness * (position - p.load_spring_centre)
    s.bristle = 0.0
    s.motion = 0.0 if dry_friction(p) else 1.0
    s.stopped = 0.0
    s.supply = 1.0
    s.warmth = s.force = 0.0
    s.watch = s.passed = 0.0
    s.reading, s.taken = 0.0, -math.inf
    s.followed = position
    s.lagged = 0.0 if p.measures_speed else rectified(p, encoded(p, position))


def new_state(record: npt.NDArray[np.void], t: float = 0.0, position: float = 0.0) -> npt.NDArray[np.void]:
    """A plant at rest: array of shape (1,) of `STATE`."""
    state = np.zeros(1, STATE)
    _rest_of(record, state, t, position)
    return state


@compiled
def _rest_of(record: Any, state: Any, t: float, position: float) -> None:
    """`rest` of arrays of shape (1,): records given by themselves take microseconds to unpack."""
    rest(record[0], state[0], t, position)
