"""Position control (Fig. 2): a relay on the position's error, about where the axis stood at start."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seod.loop.excite import Controller, PositionHold, Relay

if TYPE_CHECKING:
    from seod.config.axis import AxisConfig

SETTLED_S = 0.05
"""A hold is over once the axis has stayed within the tolerance for this long."""


class Settling:
    """Tells when something has stayed small for long enough, or the time for it is over."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.begin(-math.inf)

    def begin(self, t: float) -> None:
        """Wait from `t` [s] on."""
        self.entered = t
        self.since = math.inf

    def done(self, t: float, small: bool) -> bool:
        """Take one tick."""
        if not small:
            self.since = math.inf
        elif self.since == math.inf:
            self.since = t
        return t - self.since >= SETTLED_S or t - self.entered >= self.timeout


class PositionMode:
    """See `seod.loop.mode.Mode`.

    Args:
        config: The axis.
        settings: Its settings in force; the axis changes them.
    """

    quantity = "position"
    approaches = False
    has_ends = True

    def __init__(self, config: AxisConfig, settings: dict[str, float]) -> None:
        self.config = config
        self.settings = settings
        self.reference = 0.0
        self.bias = settings["bias"]
        self.y = self.filtered = self.t_sample = math.nan
        self.K_L = math.nan
        self.settling = Settling(config.hold.timeout)

    @property
    def error(self) -> float:
        """The relay's input e = reference - filtered position [axis unit]."""
        return self.reference - self.filtered

    signal = error

    @property
    def swing(self) -> float:
        """The position as it is."""
        return self.y

    def start(self, y: float) -> None:
        """Oscillate about where it stands."""
        self.reference = self.filtered = y

    def sense(self, t: float, y: float, filtered: float) -> None:
        """Take a sample."""
        self.t_sample, self.y, self.filtered = t, y, filtered

    def hold(self, t: float, rest: bool) -> Controller:  # noqa: ARG002 - reference and rest are one
        """Proportional control back to the reference."""
        self.settling.begin(t)
        hold = self.config.hold
        return PositionHold(hold.bandwidth / self.K_L, hold.output or self.settings["e_a"])

    def arrived(self, t: float) -> bool:
        """Whether it stands where it stood at start."""
        tolerance = self.config.hold.tolerance or 0.1 * self.config.limits.amplitude
        return self.settling.done(t, abs(self.error) <= tolerance)

    def absorb(self, K_L: float) -> None:
        """Nothing but the hold depends on it."""

    def relay_on(self, t: float) -> None:
        """Nothing to prepare."""

    def advance(self, t: float, K_L: float, relay: Relay | None) -> None:  # noqa: ARG002 - a mode's form
        """The bias is the one that is set."""
        self.K_L = K_L
        self.bias = self.settings["bias"]
