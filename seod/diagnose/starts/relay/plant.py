"""A plant of the grid of a relay's recording, and the sets of effects whose search may begin there."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.causes.table import CAUSES, DELAYS, IN_GRID, SETTLED, grid_of, settled_from
from seod.diagnose.tuning.starts import PLANT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from seod.diagnose.causes.scales import Values


class GridPlant(NamedTuple):
    """A plant: what it leaves of the recording, its parameters, a delay, and its effects' parameters.

    `half` is the limit cycle's amplitude without the effects; `shares` are what `sizes` were in the grid.
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
            own.intersection(IN_GRID) == set(names).intersection(IN_GRID)
            and (late or self.delay * self.omega_n < PLANT.slight_delay)
            and (not late or self.delay > 0.0)
            and own.difference(IN_GRID) <= set(names)
        )

    def values(self) -> Values:
        """As a start, with the times of all that may stand for the delay."""
        own = {"K_L": self.K_L, "omega_n": self.omega_n, "zeta": self.zeta}
        own |= self.sizes
        for rich in SETTLED:
            if self.causes == {CAUSES[rich].needs}:
                own |= settled_from(rich, self.sizes, self.half)
        return own | {f"{name}.time": self.delay for name in DELAYS if self.delay > 0.0}

    def enriched(self, rich: str) -> GridPlant:
        """Where to settle with a cause that acts beside its own."""
        return self._replace(shares=self.shares | (grid_of(rich).settles or {}))
