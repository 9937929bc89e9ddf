"""Whether a relay gave the commands: it answers to the movement, which a table of commands does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.record import RELAY

if TYPE_CHECKING:
    from seod.diagnose.result import Array


def relayed(u: Array, place: Array) -> bool:
    """Whether few commands switch alike against the position, period by period.

    A relay holds a limit cycle: there the position is half a period behind the command. It is a quarter
    behind a slow square wave, and behind binary noise anywhere.

    Args:
        u: Command of each row [V], shape (n,).
        place: Position, or the integral of a speed, shape (n,).
    """
    if len(np.unique(u)) > RELAY.levels:
        return False
    alike = _against(u, place)
    if len(alike) < RELAY.fewest_periods:
        return False
    usual = float(np.median(alike))
    return abs(usual) >= RELAY.usually and float(np.mean(alike * usual > 0.0)) >= RELAY.mostly


def _against(u: Array, place: Array) -> Array:
    """Correlation of position and command in each of the command's periods; shape (periods,)."""
    upper = np.where(u > 0.5 * (np.min(u) + np.max(u)), 1.0, -1.0)
    begins = np.flatnonzero(np.diff(upper) > 0.0) + 1
    whole = slice(begins[0], begins[-1]) if len(begins) else slice(0, 0)
    at = begins[:-1] - whole.start
    if not len(at):
        return np.empty(0)
    x, y = upper[whole], place[whole] - np.mean(place[whole])
    rows = np.diff(begins)
    mean_x, mean_y = np.add.reduceat(x, at) / rows, np.add.reduceat(y, at) / rows
    both = np.add.reduceat(x * y, at) / rows - mean_x * mean_y
    width_x = np.add.reduceat(x * x, at) / rows - mean_x**2
    width_y = np.add.reduceat(y * y, at) / rows - mean_y**2
    return np.asarray(both / np.sqrt(np.maximum(width_x * width_y, 1e-300)))
