"""Whether the windows that were fitted and those held out show the same; others, where they do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.diagnose.fitting.judged import Judged
from seod.diagnose.record.windows import Cut, cut
from seod.diagnose.tuning.fitting import HELD_OUT, WINDOW_HALVES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.record.series import Series


def one_sided(fitted: HeldOut, held: HeldOut) -> bool:
    """Whether one half shows something of which there is nothing in the other."""
    less, more = sorted((fitted.adequacy, held.adequacy))
    return less < HELD_OUT.adequate and more > WINDOW_HALVES.shows_more


def finer(every: Sequence[Series], fitted: Fitted) -> tuple[Cut, Cut] | None:
    """As few windows more as let both halves show what this model does not; None if it is too rare.

    Args:
        every: The recordings.
        fitted: The model.
    """
    for more in WINDOW_HALVES.finer_cuts:
        halves = cut(every, more)
        if all(Judged.of(fitted, half).held.adequacy > WINDOW_HALVES.shows_more for half in halves):
            return halves
    return None
