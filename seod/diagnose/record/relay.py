"""Whether a relay gave the commands: it answers to the movement, which a table of commands does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.record import RELAY

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Rows


def relayed(u: Array, place: Array) -> bool:
    """Whether few commands switch at a place, and one period is as long as the next.

    A relay switches up and down where the position passes what it holds. A square wave switches where the
    load turns round, or near it, and periods of binary noise differ.

    Args:
        u: Command of each row [V], shape (n,).
        place: Position, or the integral of a speed, shape (n,).
    """
    if len(np.unique(u)) > RELAY.levels:
        return False
    upper = np.where(u > 0.5 * (np.min(u) + np.max(u)), 1.0, -1.0)
    rises = np.flatnonzero(np.diff(upper) > 0.0) + 1
    if len(rises) <= RELAY.fewest_periods or _from_one_to_the_next(np.diff(rises)) > RELAY.changes:
        return False
    falls = np.flatnonzero(np.diff(upper) < 0.0) + 1
    apart = _apart(place, rises, falls[(falls > rises[0]) & (falls < rises[-1])])
    return float(np.quantile(apart, RELAY.part)) < RELAY.apart


def _from_one_to_the_next(rows: Rows) -> float:
    """By how much a period is usually longer or shorter than the one before, as a logarithm."""
    return float(np.median(np.abs(np.diff(np.log(rows)))))


def _apart(place: Array, rises: Rows, falls: Rows) -> Array:
    """Distance of the places of both switches of each period over the range that the load passes in it.

    Less the straight line from one rise to the next: a load may move on meanwhile. Of three rows, the
    switch's and two before: a coarse sensor's reading has stepped in one of them.
    """
    near = place.copy()
    near[2:] = (place[2:] + place[1:-1] + place[:-2]) / 3.0
    off = near - np.interp(np.arange(len(near)), rises, near[rises])
    first, last = int(rises[0]), int(rises[-1])
    at = rises[:-1] - first
    width = np.maximum.reduceat(off[first:last], at) - np.minimum.reduceat(off[first:last], at)
    return np.asarray(np.abs(off[falls]) / np.maximum(width, np.finfo(float).tiny))
