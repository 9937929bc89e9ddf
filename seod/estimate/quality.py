"""What makes an answer trustworthy: settling, noise, clipping; one word and one advice for a person."""

from __future__ import annotations

import math
from statistics import median
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

ASYMMETRY_MAX: Final = 0.1
"""Duty of the relay may differ from 1/2 by this: a load bias of 0.2 e_a."""
NOISE_MAX: Final = 0.1
"""Standard deviation of the samples' noise, as part of the amplitude, above which an answer is `noisy`."""
NO_OSCILLATION_NOISE: Final = 0.33
"""The same, above which nothing can be said to oscillate."""
CHATTER_MAX: Final = 0.25
"""Part of the half cycles that may begin with a relay that chatters."""
SAMPLES_MIN: Final = 4
"""Fewest samples in a half cycle."""
AGREEMENT: Final = 0.003
"""What the newer half of the window may differ from the older one, as a part; scatter adds to it."""
ONCE_SETTLED: Final = 4.0
"""Factor on what may differ, and on a tick more, once settled: a sampled relay's period wanders by ticks."""

STANDS: Final = "the actuator does not move: raise e_a (friction or deadband), check supply and output"
DRIFTS: Final = "the position runs one way and the relay does not turn it: raise e_a, check bias and polarity"
SECOND_PHASE: Final = "the relay is in its second phase: wait, or take `wave`, which looks at both"
ADVICE: Final[dict[str, str]] = {
    "settling": "wait: successive cycles do not agree yet",
    "no_oscillation": (
        "the oscillation is lost in noise, hysteresis or friction: raise e_a, or lower the relay's hysteresis"
    ),
    "asymmetric": "the relay's halves are unequal: set the relay's bias against the valve null shift or load",
    "nonlinear": "what repeats in each cycle is no linear plant's (friction, backlash, pressure limit, "
    "an unknown lag): compare values of e_a by `seod ramp`, check the sensor's lag and delay",
    "noisy": "sensor noise moves the relay: give the relay a hysteresis of about three times the noise, "
    "or raise e_a",
    "saturated": "the sensor's signal is clipped at a peak: lower e_a, or widen the sensor's range",
    "stale": "no new samples: check the sensor and its bus",
    "out_of_range": "no zeta from 0.02 to 10 explains this limit cycle: check K_L, e_a and the known delay",
}


def agree(values: Sequence[float], allowed: float = AGREEMENT, slack: float = 1.0) -> bool:
    """Whether cycles repeat: the newer half of `values` differs from the older no more than by scatter.

    The scatter comes from second differences, which a steady trend leaves at zero, and from their median,
    which the first wild cycles do not move: so a transient cannot excuse itself.

    Args:
        values: Logarithms, one for each half cycle, each over a whole cycle, so that neighbours overlap.
        allowed: Difference allowed besides 2.5 of its standard errors.
        slack: Factor on both; above 1 to keep an answer once it was settled.
    """
    if len(values) < 3:
        return False
    half = len(values) // 2
    older, newer = sum(values[:half]) / half, sum(values[-half:]) / half
    bends = [abs(a - 2.0 * b + c) for a, b, c in zip(values, values[1:], values[2:], strict=False)]
    scatter = median(bends) / (0.6745 * math.sqrt(2.0))
    return abs(newer - older) <= slack * (allowed + 2.5 * scatter * math.sqrt(4.0 / half))


def clipped(y: Sequence[float]) -> bool:
    """Whether a half cycle's samples lie flat at their highest or lowest value.

    A coarse sensor has flat peaks too, but it stays nearly as long (0.83 times, for a sine) on the next
    step. Flat for more than twice as long, and for a tenth of the half cycle, is clipped.
    """
    levels = sorted(set(y))
    return len(levels) > 2 and any(
        _longest_run(y, at) > max(2 + 2 * y.count(next_level), 0.1 * len(y))
        for at, next_level in ((levels[0], levels[1]), (levels[-1], levels[-2]))
    )


def _longest_run(y: Sequence[float], value: float) -> int:
    longest = run = 0
    for sample in y:
        run = run + 1 if sample == value else 0
        longest = max(longest, run)
    return longest


class NoiseMeter:
    """White noise of equally spaced samples, from third differences, which a smooth motion hardly has."""

    def __init__(self) -> None:
        self._last: list[float] = []
        self._mean = 0.0
        self._weight = 0.0

    def update(self, y: float, memory: float) -> None:
        """Take a sample; `memory` is the number of samples averaged over."""
        self._last.append(y)
        if len(self._last) == 4:
            a, b, c, d = self._last
            self._weight = min(self._weight + 1.0, memory)
            self._mean += (abs(d - 3.0 * c + 3.0 * b - a) - self._mean) / self._weight
            del self._last[0]

    def skip(self) -> None:
        """A sample is missing here."""
        self._last.clear()

    @property
    def sd(self) -> float:
        """Standard deviation of the noise, in the samples' unit."""
        return self._mean / (math.sqrt(20.0) * math.sqrt(2.0 / math.pi))
