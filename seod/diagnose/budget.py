"""How long a search may go on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

SEARCH_S: Final = 15.0
"""Processor time after which no further cause is tried, of a long recording; fits of the best follow."""
FURTHER_S: Final = 15.0
"""The same that a short one may use beyond: what follows takes less."""
LONG: Final = 120_000
"""Samples of a long recording."""
TRIAL: Final = 0.04
"""Part of it that a single trial may use: some wander off to plants that are slow to simulate."""
LAST_FIT: Final = 0.12
"""Likewise of a fit to all windows that follows the search."""
LOOKING: Final = 0.65
"""Likewise of a look at many sets."""


def further_s(rows: int) -> float:
    """What a search in so many samples may use beyond that of a long recording [s]."""
    return FURTHER_S * (1.0 - min(1.0, rows / LONG))


@dataclass
class Budget:
    """Processor time of a search.

    Attributes:
        clock: Tells what was used so far [s].
        seconds: That may be used; what follows the search has parts of it.
        further: That the search may use beyond.
        missed: A part of the search was left out for it.
    """

    clock: Callable[[], float]
    seconds: float = SEARCH_S
    further: float = 0.0
    missed: bool = False
    _begin: float = field(init=False)

    def __post_init__(self) -> None:
        self._begin = self.clock()

    @property
    def total(self) -> float:
        """That the search may use."""
        return self.seconds + self.further

    @property
    def spent(self) -> bool:
        """Nothing is left; whoever asks leaves out what it was about to do."""
        over = self.clock() - self._begin > self.total
        self.missed |= over
        return over

    def excuse(self, since: float) -> None:
        """What was used since then, by the clock, does not count."""
        self._begin += self.clock() - since

    def trial(self, part: float = TRIAL) -> Callable[[], bool]:
        """Tells when one trial has had its part, or nothing is left at all."""
        over = self._after(part * self.total)
        return lambda: over() or self.spent

    def share(self, part: float) -> Callable[[], bool]:
        """Tells when this part of what is left now was used; what is left out then, is missed."""
        over = self._after(part * (self._begin + self.total - self.clock()))

        def told() -> bool:
            ended = over()
            self.missed |= ended
            return ended

        return told

    def glance(self) -> Callable[[], bool]:
        """Tells when a trial has had its part that follows the search."""
        return self._after(TRIAL * self.seconds)

    def last_fit(self) -> Callable[[], bool]:
        """Tells when one fit of what was found has had its part; such fits follow the search."""
        return self._after(LAST_FIT * self.seconds)

    def looking(self) -> Callable[[], bool]:
        """Tells when no further set is simulated where no fit has seen."""
        return self._after(LOOKING * self.seconds)

    def _after(self, seconds: float) -> Callable[[], bool]:
        end = self.clock() + seconds
        return lambda: self.clock() > end

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user has to know."""
        if not self.missed:
            return ()
        return (
            f"the search ended after {self.total:.0f} s of processor time: not all sets of causes "
            "were tried. A shorter or more slowly sampled recording takes less",
        )
