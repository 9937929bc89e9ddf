"""Speeds behind a play: samples beside a contact, where the reading jumps from rest to the actuator's speed.

A sample shows such a jump on one side or the other, so that a simulation's error does not say how near it is,
and no derivative leads to the right play. For a fit the jump is a ramp over one interval; its samples then have
as much noise more as a jump anywhere within the interval makes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.simulate import inside, simulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seod.diagnose.answer import Array, Mask
    from seod.diagnose.windows import Cut

_RAMP = 1.0 / math.sqrt(12.0)
"""Standard deviation of a place within one interval."""


class Contacts(NamedTuple):
    """Where a play is closed in a simulation; arrays of shape (c,).

    Attributes:
        rows: First sample after each contact.
        since: Part of the interval before it for which there was contact, 0 to 1.
        jump: What is read there.
    """

    rows: NDArray[np.int64]
    since: Array
    jump: Array


def jumps(record: NDArray[np.void]) -> bool:
    """Whether readings jump where a play is closed."""
    one = record[0]
    return bool(one["measures_speed"] and one["backlash_gap"] > 0.0 and one["sensor_lag_time"] == 0.0)


def contacts(cut: Cut, seen: Array, states: Array) -> Contacts:
    """Of simulated readings, shape (n,), with what is inside, shape (n, 4)."""
    begins = np.zeros(len(seen), np.bool_)
    begins[[piece.start for piece in cut.slices]] = True
    found = np.flatnonzero((seen != 0.0) & (np.roll(seen, 1) == 0.0) & ~begins)
    moved = states[found, 3] - states[found - 1, 3]
    interval = cut.gathered("t")[found] - cut.gathered("t")[found - 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        since = moved / (states[found, 1] * interval)
    return Contacts(found, np.clip(np.nan_to_num(since, nan=0.5), 0.0, 1.0), seen[found])


def smooth(record: NDArray[np.void], cut: Cut, start: Array) -> tuple[Array, Array]:
    """What is measured, with ramps for jumps, and the noise variance that each row has more; shape (n,)."""
    if not jumps(record):
        seen = simulate(record, cut, start)
        return seen, np.zeros(len(seen))
    seen, states = inside(record, cut, start)
    rows, since, jump = contacts(cut, seen, states)
    more = np.zeros(len(seen))
    seen[rows] = jump * np.minimum(since + 0.5, 1.0)
    seen[rows - 1] = jump * np.maximum(since - 0.5, 0.0)
    more[np.where(since < 0.5, rows, rows - 1)] = (_RAMP * jump) ** 2
    return seen, more


def sure(record: NDArray[np.void], cut: Cut, seen: Array, states: Array) -> Mask:
    """Rows whose reading does not hang on which side of a jump they are, shape (n,)."""
    out = np.ones(len(seen), np.bool_)
    if jumps(record):
        rows = contacts(cut, seen, states).rows
        out[rows] = out[rows - 1] = False
    return out
