"""Whether the rig is still what its model says: an error of each segment, and news when that changes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.diagnose.record.noise import noise_sd

if TYPE_CHECKING:
    from seod.model_monitor.window import Array, Segment

SIGNIFICANT: Final = 6.0
"""Of the statistic: noise alone makes it standard normal, the noise's own estimate about twice as wide."""
TOLERANCE: Final = 0.05
"""Error over the movement's standard deviation that counts; real models are never better than 1 or 2 %."""
IN_A_ROW: Final = 3
"""Segments that must agree before it is said."""


@dataclass(frozen=True, slots=True)
class ModelError:
    """Of one segment.

    Attributes:
        t: End of the segment [s].
        rms: Error of the simulation [axis unit, of a speed per s].
        nrmse: The same over the standard deviation of the samples.
        noise: Standard deviation of the samples' noise, from their high differences.
        statistic: (rms^2 / noise^2 - 1) sqrt(n / 2): a few units at most while the model holds.
        beyond: Both the noise and `TOLERANCE` are exceeded.
        model: `linear` or `kernel`.
    """

    t: float
    rms: float
    nrmse: float
    noise: float
    statistic: float
    beyond: bool
    model: str

    def as_message(self, axis: str, left: bool) -> dict[str, Any]:
        """The `model_error` notification; `left` is the standing verdict."""
        return {
            "axis": axis,
            "t": self.t,
            "rms": self.rms,
            "nrmse": self.nrmse,
            "noise": self.noise,
            "statistic": self.statistic,
            "significant": SIGNIFICANT,
            "tolerance": TOLERANCE,
            "left": left,
            "model": self.model,
        }


def judge(segment: Segment, residual: Array, resolution: float, model: str) -> ModelError | None:
    """The error of a segment; None where nothing moves, so that nothing is told.

    Args:
        segment: Samples.
        residual: Measured less simulated, shape (n,).
        resolution: One count of the sensor [axis unit].
        model: Its name.
    """
    rms = math.sqrt(float(np.mean(residual**2)))
    seen = noise_sd(segment.t, segment.y, np.ones(len(segment.t), np.bool_))
    noise = max(seen if math.isfinite(seen) else 0.0, resolution / math.sqrt(12.0))
    moved = float(np.std(segment.y))
    if not (math.isfinite(rms) and moved > 3.0 * noise > 0.0):
        return None
    statistic = ((rms / noise) ** 2 - 1.0) * math.sqrt(0.5 * len(residual))
    beyond = statistic > SIGNIFICANT and rms > TOLERANCE * moved
    return ModelError(float(segment.t[-1]), rms, rms / moved, noise, statistic, beyond, model)


class Verdict:
    """Changes only after several segments in a row."""

    def __init__(self) -> None:
        self.left = False
        self._against = 0

    def add(self, error: ModelError) -> bool:
        """Take the next error; whether the verdict has changed by it."""
        self._against = self._against + 1 if error.beyond is not self.left else 0
        if self._against < IN_A_ROW:
            return False
        self.left, self._against = error.beyond, 0
        return True
