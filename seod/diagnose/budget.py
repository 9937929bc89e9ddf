"""How long a search may go on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

SEARCH_S: Final = 19.0
"""Processor time after which no further cause is tried: fits of what was found follow."""
TRIAL: Final = 0.04
"""Part of it that a single trial may use: some wander off to plants that are slow to simulate."""
LAST_FIT: Final = 0.1
"""Likewise of a fit to all windows."""
LOOKING: Final = 0.45
"""Likewise of a look at many sets."""


@dataclass
class Budget:
    """Processor time of a search.

    Attributes:
        clock: Tells what was used so far [s].
        seconds: That may be used.
        missed: A part of the search was left out for it.
    """

    clock: Callable[[], float]
    seconds: float = SEARCH_S
    missed: bool = False
    _begin: float = field(init=False)

    def __post_init__(self) -> None:
        self._begin = self.clock()

    @property
    def spent(self) -> bool:
        """Nothing is left; whoever asks leaves out what it was about to do."""
        over = self.clock() - self._begin > self.seconds
        self.missed |= over
        return over

    def trial(self, part: float = TRIAL) -> Callable[[], bool]:
        """Tells when one trial has had its part, or nothing is left at all."""
        over = self._after(part)
        return lambda: over() or self.spent

    def glance(self) -> Callable[[], bool]:
        """Tells when a trial has had its part that follows the search."""
        return self._after(TRIAL)

    def last_fit(self) -> Callable[[], bool]:
        """Tells when one fit of what was found has had its part; such fits follow the search."""
        return self._after(LAST_FIT)

    def looking(self) -> Callable[[], bool]:
        """Tells when no further set is simulated where no fit has seen."""
        return self._after(LOOKING)

    def _after(self, part: float) -> Callable[[], bool]:
        end = self.clock() + part * self.seconds
        return lambda: self.clock() > end

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user has to know."""
        if not self.missed:
            return ()
        return (
            f"the search ended after {self.seconds:.0f} s of processor time: not all sets of causes "
            "were tried. A shorter or more slowly sampled recording takes less",
        )
