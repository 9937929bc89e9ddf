"""What a sensor's first-order lag does to a limit cycle, and how to take it back.

1 / (tau s + 1) delays a harmonic of frequency w by atan(w tau) / w (for slow ones tau itself) and makes it
smaller by sqrt(1 + (w tau)^2). The limit cycle is taken for its fundamental; its third harmonic is a percent
or two of the position, so what that leaves grows with (w tau)^2: measured in `docs/estimators.md`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from seod.estimate.limit_cycle.inversion import Measured


class Lag(NamedTuple):
    """Delay [s], and by how many times larger the motion is than what is seen of it."""

    delay: float
    ratio: float

    def removed(self, seen: Measured) -> Measured:
        """The limit cycle as it is: it crossed earlier than was seen, and is larger."""
        return seen._replace(
            lag_up=seen.lag_up + self.delay, lag_down=seen.lag_down + self.delay, V_s=seen.V_s * self.ratio
        )


def first_order(tau: float, omega: float) -> Lag:
    """The lag of time constant `tau` [s] at frequency `omega` [rad/s]."""
    x = omega * tau
    return Lag(math.atan(x) / omega, math.hypot(1.0, x)) if omega > 0.0 else Lag(tau, 1.0)
