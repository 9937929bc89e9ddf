"""A gain that changes within the window, as that of a valve does while the supply pressure moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from seod.estimate.arrays import Array

STEADY: Final = 1e-3
"""Part by which a gain may change within a window and still be one."""
SEGMENTS: Final = 8
"""Into which the window's average half cycle is cut for one that does not."""


def under_one_gain(t_u: Array, u: Array, K_L: Array, middle: float) -> tuple[Array, Array, float]:
    """The voltages that would do under the gain of one moment what these did under theirs.

    Args:
        t_u: When each voltage began [s], rising, shape (n,).
        u: Voltages [V], likewise.
        K_L: Gain in force then [unit/s/V], likewise; a straight line is laid through them.
        middle: That moment, the window's middle [s].

    Returns:
        Times and voltages, more of them where the gain changes, and that gain.
    """
    mean = float(np.mean(K_L))
    if len(t_u) < 3 or np.ptp(K_L) <= STEADY * abs(mean):
        return t_u, u, mean
    since = t_u - t_u.mean()
    slope = float(since @ (K_L - mean) / (since @ since))
    here = mean + slope * (middle - float(t_u.mean()))
    cut = np.union1d(t_u, np.linspace(t_u[0], t_u[-1], SEGMENTS * len(t_u)))
    centre = cut + 0.5 * np.diff(cut, append=2.0 * cut[-1] - cut[-2])
    held = u[np.searchsorted(t_u, cut, side="right") - 1]
    return cut, held * (1.0 + slope / here * (centre - middle)), here
