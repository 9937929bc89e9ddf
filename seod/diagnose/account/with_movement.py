"""Whether what is left is larger where the load moves more.

Noise of a sensor or of a load is as large where it rests. What a wrong plant leaves is not, whatever command
and state make of it: of a machine's operation, whose moves are all different, that may be all that shows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import rankdata

from seod.diagnose.account.chance import limit, noises_like
from seod.diagnose.account.residual import horizon
from seod.diagnose.tuning.account import WITH_MOVEMENT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import Plant, WindowResidual
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.result import Array


def comes_with_movement(
    parts: Sequence[WindowResidual], plant: Plant, noise: NoiseColour, chance: float
) -> float:
    """Part of the squared error [0 to 1] that a load at rest would not have; 0 where it may be chance.

    Of errors half a period of the plant ahead, as of a black box: what had moved the load before drifts on.
    Their mean squares over a period each are ranked within their recording, as are those of the pressure that
    moves the load: another recording's sensor may have another noise. Ranks of noises of the same colour say
    what chance makes of it.

    Args:
        parts: What a model leaves of windows; in each a row has all of its past.
        plant: Of that model.
        noise: What is left, as noise.
        chance: Probability with which noise may pass.
    """
    files = sorted({one.file for one in parts})
    pairs = [
        [each for k, one in enumerate(parts) if one.file == file for each in _squares(one, plant, noise, k)]
        for file in files
    ]
    if sum(map(len, pairs)) < WITH_MOVEMENT.fewest:
        return 0.0
    together: Array = np.zeros(())
    resting = every = 0.0
    for errors, pressure in (map(np.array, zip(*own, strict=True)) for own in pairs if own):
        together = together + _ranked(errors).T @ _ranked(pressure)
        rests = pressure <= np.quantile(pressure, WITH_MOVEMENT.resting)
        resting += len(errors) * float(np.mean(errors[rests, 0]))
        every += float(np.sum(errors[:, 0]))
    own, *chances = together
    part = 1.0 - resting / max(every, 1e-300)
    return max(0.0, part) if own > limit(np.array(chances), chance) else 0.0


def _squares(one: WindowResidual, plant: Plant, noise: NoiseColour, number: int) -> list[tuple[Array, float]]:
    """Of each period in a window the mean square of errors ahead, also of noises, and of the pressure."""
    sees = noise.has_past(one.scored)
    error = np.where(one.scored, one.error, 0.0)
    white = noise.whitened(np.column_stack([error, noises_like(one, noise, number)]))
    half = horizon(one, plant)
    ahead = noise.ahead_of_white(np.where(sees[:, None], white, 0.0), half)
    rows = np.flatnonzero(sees)
    periods = np.array_split(rows, max(1, len(rows) // (2 * half)))
    return [(np.mean(ahead[each] ** 2, axis=0), float(np.mean(one.pressure[each] ** 2))) for each in periods]


def _ranked(x: Array) -> Array:
    """Ranks along the first axis, of mean 0 and deviation 1."""
    ranks = rankdata(x, axis=0)
    spread = np.std(ranks, axis=0)
    return np.asarray((ranks - np.mean(ranks, axis=0)) / np.where(spread > 0.0, spread, 1.0))
