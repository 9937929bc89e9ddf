"""An offset of the sensor that moves slowly, as part of noise that remembers.

Within a recording such an offset goes up and down once or twice. A fit takes it for a slow movement, and
bends numbers to follow it. What is left does not show it then, nor do parts of the recording that all are
bent the same way. So numbers are told as if there were one, as large as the noise: half-waves over the
recording, each with the deviation of the noise (Bayesian linear model; Kay, Fundamentals of Statistical
Signal Processing, vol. 1, 11.6).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.tuning.fitting import SLOW_OFFSET

if TYPE_CHECKING:
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array


def slow_part(noise: NoiseColour, cut: Cut) -> float:
    """Deviation of the offset that may be in such noise of windows [unit of y]; 0 where it is white.

    Or where a coarse sensor's rounding hides most of it.
    """
    return SLOW_OFFSET.part * noise.sd if noise.memory and not cut.coarse else 0.0


def half_waves(cut: Cut, first: int = 0) -> Array | None:
    """Of each recording, from the `first` on, 0: a constant; shape (n, k). None where noise has none."""
    if cut.slow == 0.0:
        return None
    columns = []
    for of in sorted({k for k, _, _ in cut.windows}):
        one = cut.series[of]
        angle = math.pi * (cut.gathered("t") - one.t[0]) / (one.t[-1] - one.t[0])
        own = np.repeat([k == of for k, _, _ in cut.windows], cut.sizes)
        columns += [
            cut.unforeseen(cut.slow * np.cos(k * angle) * own) for k in range(first, SLOW_OFFSET.most + 1)
        ]
    return np.stack(columns, axis=1)
