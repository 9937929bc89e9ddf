"""What chance shows: the same asked of noises of the colour of what is left."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from seod.diagnose.fitting.noise_colour import WHITE
from seod.diagnose.tuning.account import BLACK_BOX, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.result import Array


def may_pass(*, in_loop: bool) -> float:
    """Probability with which noise alone may pass for something systematic."""
    return SYSTEMATIC.chance_in_loop if in_loop else SYSTEMATIC.chance


def usable(noise: NoiseColour, parts: Sequence[WindowResidual]) -> NoiseColour:
    """White noise where a window has no row with all of its past."""
    return noise if all(noise.has_past(one.scored).any() for one in parts) else WHITE


def noises_like(one: WindowResidual, noise: NoiseColour, number: int) -> Array:
    """Noise of the same colour in a window, drawn by its number; shape (n, noises)."""
    random = np.random.default_rng(number)
    return np.where(one.scored[:, None], noise.drawn(len(one.t), BLACK_BOX.noises, random), 0.0)


def limit(scores: Array, chance: float) -> float:
    """Score that one more noise would reach with this probability, at least 0."""
    count = len(scores)
    spread = float(np.std(scores, ddof=1)) * math.sqrt(1.0 + 1.0 / count)
    return max(0.0, float(np.mean(scores)) + float(student.ppf(1.0 - chance, count - 1)) * spread)
