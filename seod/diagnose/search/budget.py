"""How long a search may go on: by what it simulates, so that the answer is the same on every machine."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal

from seod.diagnose.fitting.work import used_s
from seod.diagnose.tuning.search import BUDGET

if TYPE_CHECKING:
    from collections.abc import Callable

Effort = Literal["quick", "normal", "thorough"]

EFFORTS: Final[dict[Effort, float]] = {
    "quick": BUDGET.quick,
    "normal": BUDGET.normal,
    "thorough": BUDGET.thorough,
}
"""Of the work of a search, what may be used."""


@dataclass
class Budget:
    """Work of a search.

    Attributes:
        clock: Tells what was used so far [s of a usual machine].
        seconds: That may be used; what follows the search has parts of it.
        further: That the search may use beyond.
        safety: A clock of the wall, and how long by it the search may last [s].
        missed: A part of the search was left out for it.
        stopped: The clock of the wall ended it: another machine may have gone on.
    """

    clock: Callable[[], float] = used_s
    seconds: float = BUDGET.search_s
    further: float = 0.0
    safety: tuple[Callable[[], float], float] = (time.monotonic, math.inf)
    missed: bool = False
    stopped: bool = False
    _begin: float = field(init=False)
    _stop: float = field(init=False)

    def __post_init__(self) -> None:
        self._begin = self.clock()
        wall, patience = self.safety
        self._stop = wall() + patience

    @classmethod
    def of(cls, rows: int, effort: Effort) -> Budget:
        """For recordings of so many samples."""
        part = EFFORTS[effort]
        patience = BUDGET.safety_s if math.isfinite(part) else math.inf
        further = BUDGET.further_s * (1.0 - min(rows / BUDGET.long_rows, 1.0))
        return cls(
            seconds=part * BUDGET.search_s,
            further=min(part, 1.0) * further,
            safety=(time.monotonic, patience),
        )

    def anew(self) -> Budget:
        """The same, of which nothing was used; the clock of the wall goes on."""
        other = replace(self, missed=False)
        other._stop = self._stop
        return other

    @property
    def total(self) -> float:
        """That the search may use."""
        return self.seconds + self.further

    @property
    def spent(self) -> bool:
        """Nothing is left; whoever asks leaves out what it was about to do."""
        over = self.clock() - self._begin > self.total or self.too_late()
        self.missed |= over
        return over

    def excuse(self, since: float) -> None:
        """What was used since then, by the clock, does not count."""
        self._begin += self.clock() - since

    def trial(self, part: float = BUDGET.trial_part) -> Callable[[], bool]:
        """Tells when one trial has had its part, or nothing is left at all."""
        over = self._after(part * self.total)
        return lambda: over() or self.spent

    def share(self, part: float) -> Callable[[], bool]:
        """Tells when this part of what is left now was used; what is left out then, is missed."""
        over = self._after(part * (self._begin + self.total - self.clock()))

        def is_over() -> bool:
            ended = over()
            self.missed |= ended
            return ended

        return is_over

    def later_trial(self) -> Callable[[], bool]:
        """Tells when a trial has had its part that follows the search."""
        return self._after(BUDGET.trial_part * self.seconds)

    def last_fit(self) -> Callable[[], bool]:
        """Tells when one fit of what was found has had its part; such fits follow the search."""
        return self._after(BUDGET.last_fit_part * self.seconds)

    def drift(self) -> Callable[[], bool]:
        """Tells when it is no longer asked whether a load drifts."""
        return self._after(BUDGET.drift_part * self.seconds)

    def whole_recording_fits(self) -> Callable[[], bool]:
        """Tells when no further set is fitted to whole recordings, or looked at where no fit has seen."""
        return self._after(BUDGET.whole_recording_fits_part * self.total)

    def _after(self, seconds: float) -> Callable[[], bool]:
        end = self.clock() + seconds
        return lambda: self.clock() > end or self.too_late()

    def too_late(self) -> bool:
        """Tells when the clock of the wall has ended the search."""
        self.stopped |= self.safety[0]() > self._stop
        return self.stopped

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user has to know."""
        if self.stopped:
            return (
                f"the search was stopped after {self.safety[1]:.0f} s by the clock: this machine was "
                "too slow or too busy for it, another one may find more",
            )
        if self.missed:
            return (
                "the search ended before all sets of causes were tried: --effort thorough tries them all, a "
                "shorter or more slowly sampled recording takes less",
            )
        return ()
