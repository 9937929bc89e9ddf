"""A plant of the grid of a relay's recording, and the sets of effects whose search may begin there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from sim.effects import STIFFEST

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.diagnose.coordinates import Values

CONTACTS: Final = frozenset({"coulomb_friction", "stribeck_friction", "backlash"})
"""Effects that the grid has."""
DELAYS: Final = frozenset({"transport_delay", "valve_lag", "sensor_lag"})
"""Effects that may stand for its delay."""
SLIGHT: Final = 0.05
"""Delay over the time of a radian of omega_n, up to which a plant may stand for one without."""
GIVE: Final = 0.04
STIFF: Final = 0.1
"""What bristles give way by, over half the swing; a share of it by which they begin to settle."""
BENT: Final = "lugre_friction.give"
RUBS: Final = "coulomb_friction"
SHAKEN: Final = "periodic_disturbance"
BEGUN: Final = DELAYS | CONTACTS | {SHAKEN, "lugre_friction"}
"""Effects that may be tried from a cell; bristles give way so little that they begin as plain friction."""


class Cell(NamedTuple):
    """A plant: what it leaves of the recording, its parameters, a delay, and its effects' parameters.

    `half` is half of its swing without the effects; `shares` are what `sizes` were in the grid.
    """

    cost: float
    K_L: float
    omega_n: float
    zeta: float
    delay: float
    half: float
    sizes: Values
    shares: Values

    @property
    def causes(self) -> frozenset[str]:
        """Its effects."""
        return frozenset(place.split(".")[0] for place in self.sizes)

    def begins(self, names: Iterable[str]) -> bool:
        """Whether a set of these effects may begin here."""
        late, own = not DELAYS.isdisjoint(names), self.causes
        return (
            CONTACTS.intersection(names) == own & CONTACTS
            and (late or self.delay * self.omega_n < SLIGHT)
            and (not late or self.delay > 0.0)
            and own - CONTACTS <= set(names)
        )

    def values(self) -> Values:
        """As a start, with the times of all that may stand for the delay."""
        own = {"K_L": self.K_L, "omega_n": self.omega_n, "zeta": self.zeta}
        own |= self.sizes
        if self.causes == {RUBS}:
            own |= bristles(self.sizes["coulomb_friction.level"], self.half)
        return own | {f"{name}.time": self.delay for name in DELAYS if self.delay > 0.0}

    def on_bristles(self) -> Cell:
        """Where to settle with bristles that bear its friction."""
        return self._replace(shares=self.shares | {BENT: STIFF})


def bristles(level: float, half: float, share: float = 1.0) -> Values:
    """That bear a friction, of a load that swings so far either way."""
    stiff = min(level / (share * GIVE * half), STIFFEST * level)
    return {"lugre_friction.stiffness": stiff, "lugre_friction.damping": 0.5 * math.sqrt(stiff)}
