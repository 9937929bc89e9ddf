"""What position and velocity control have in common, seen from the axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from seod.loop.excite import Controller, Relay


class Mode(Protocol):
    """Set point, the relay's input and the bias behind it; see `position` and `velocity`."""

    quantity: str
    """What the sensor measures, for messages."""
    approaches: bool
    """The axis has to be brought to where it oscillates."""
    has_ends: bool
    """A relay that no longer switches drives the axis to the end of its travel."""
    reference: float
    """Set point in force [unit of the sensor]."""
    t_sample: float
    """Time of the newest sample [s]."""
    bias: float
    """Voltage behind the relay [V]."""

    @property
    def error(self) -> float:
        """Reference - measurement [unit of the sensor]."""

    @property
    def signal(self) -> float:
        """The relay's input [unit of the position]."""

    @property
    def swing(self) -> float | None:
        """What swings in the limit cycle [unit of the position]; None while it cannot be told."""

    def start(self, y: float) -> None:
        """The axis is started where the sensor reads `y`."""

    def sense(self, t: float, y: float, filtered: float) -> None:
        """Take a new sample of time `t` [s], as it is and low-passed."""

    def hold(self, t: float, rest: bool) -> Controller:
        """The controller that brings the axis to its reference, or to `rest`."""

    def arrived(self, t: float) -> bool:
        """Whether it is there, or has tried for long enough."""

    def absorb(self, K_L: float) -> None:
        """The gain was found to be this, and has been so all the time [unit/s/V]."""

    def relay_on(self, t: float) -> None:
        """The relay takes over."""

    def advance(self, t: float, K_L: float, relay: Relay | None) -> None:
        """Once a tick, before the controller: move reference and bias on; `relay` is None while it is off."""
