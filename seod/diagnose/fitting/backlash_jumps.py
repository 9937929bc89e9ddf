"""Speeds behind a backlash: at a contact the reading jumps from rest to the actuator's speed.

A sample shows a jump on one side or the other, so that a simulation's error does not say how near it is, and
no derivative leads to the right gap. For a fit the jump is a ramp, over one interval at least, whose samples
have as much noise more as a jump anywhere within an interval makes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from seod.diagnose.fitting.simulate import FOLLOWED, VELOCITY, inside, simulate
from seod.diagnose.tuning.fitting import BACKLASH_JUMPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Mask

_SPREAD: Final = 1.0 / 12.0
"""Variance of a place within one interval."""


class Softness(NamedTuple):
    """How jumps are blurred.

    Attributes:
        ramp: Length of the ramp in the place of a jump [intervals].
        level: Of each window's error beside which a jump's own counts, shape (w,).
    """

    ramp: float
    level: Array

    @classmethod
    def least(cls, cut: Cut) -> Self:
        """As there is no way round: a sample is on one side of a jump or on the other."""
        return cls(1.0, cut.noise)


class Contacts(NamedTuple):
    """Where a backlash is closed in a simulation; arrays of shape (c,).

    Attributes:
        rows: First sample after each contact.
        since: Part of the interval before it for which there was contact, 0 to 1.
        jump: What is read there.
    """

    rows: NDArray[np.int64]
    since: Array
    jump: Array


def jumps(record: NDArray[np.void]) -> bool:
    """Whether readings jump where a backlash is closed."""
    one = record[0]
    return bool(one["measures_speed"] and one["backlash_gap"] > 0.0 and one["sensor_lag_time"] == 0.0)


def contacts(cut: Cut, seen: Array, states: Array) -> Contacts:
    """Of simulated readings, shape (n,), with what is inside, shape (n, 5)."""
    begins = np.zeros(len(seen), np.bool_)
    begins[[rows.start for rows in cut.slices]] = True
    found = np.flatnonzero((seen != 0.0) & (np.roll(seen, 1) == 0.0) & ~begins)
    moved = states[found, FOLLOWED] - states[found - 1, FOLLOWED]
    interval = cut.gathered("t")[found] - cut.gathered("t")[found - 1]
    speed = states[found, VELOCITY]
    grows = (speed - states[found - 1, VELOCITY]) / interval
    at_contact = np.copysign(np.sqrt(np.maximum(speed**2 - 2.0 * grows * moved, 0.0)), speed)
    with np.errstate(divide="ignore", invalid="ignore"):
        since = moved / (0.5 * (speed + at_contact) * interval)
    return Contacts(found, np.clip(np.nan_to_num(since, nan=0.5), 0.0, 1.0), seen[found])


def smooth(record: NDArray[np.void], cut: Cut, start: Array, ramp: float) -> tuple[Array, Array]:
    """What is measured, with ramps for jumps, and the noise variance that each row has more; shape (n,)."""
    if not jumps(record):
        seen = simulate(record, cut, start)
        return seen, np.zeros(len(seen))
    seen, states = inside(record, cut, start)
    found = contacts(cut, seen, states)
    more, out = np.zeros(len(seen)), seen.copy()
    reach = math.ceil(0.5 * ramp)
    for away in range(-reach, reach):
        rows = found.rows + away
        within = (rows >= 0) & (rows < len(seen))
        rows, jump = rows[within], found.jump[within]
        part = np.clip(0.5 + (found.since[within] + away) / ramp, 0.0, 1.0)
        out[rows] = part * (seen[rows] if away >= 0 else jump)
        more[rows] += np.where((part > 0.0) & (part < 1.0), _SPREAD * jump**2, 0.0)
    return out, more


def softness(record: NDArray[np.void], cut: Cut, start: Array) -> Softness:
    """Ramps as long as contacts are early or late by the error that is left."""
    seen, states = inside(record, cut, start)
    error = np.where(cut.good, cut.y - seen, 0.0)
    error = np.clip(np.nan_to_num(error, nan=1e150), -1e150, 1e150)
    square = np.array([float(error[rows] @ error[rows]) for rows in cut.slices])
    jump = contacts(cut, seen, states).jump
    late = float(square.sum()) / max(float(jump @ jump), 1e-300)
    level = np.sqrt(np.maximum(square / cut.sizes, cut.noise**2))
    return Softness(1.0 + min(late, BACKLASH_JUMPS.longest), level)


def sure(record: NDArray[np.void], cut: Cut, seen: Array, states: Array) -> Mask:
    """Rows whose reading does not hang on which side of a jump they are, shape (n,)."""
    out = np.ones(len(seen), np.bool_)
    if jumps(record):
        rows = contacts(cut, seen, states).rows
        out[rows] = out[rows - 1] = False
    return out
