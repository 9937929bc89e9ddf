"""Whether the windows that were fitted and those held out show the same; others, where they do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.judged import Judged
from seod.diagnose.fitting.least_squares import fit
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


def misfits(fitted: Fitted) -> bool:
    """Whether it leaves more than noise of a window that it was fitted to, as where a limit cycle grows.

    Two lags may pass for a limited rate at one amplitude, which is all that windows held out show.
    """
    return bool(np.max(fitted.error / fitted.cut.allowed**2) > WINDOW_HALVES.shows_more)


def fits_both(fitted: Fitted, held: HeldOut) -> bool:
    """Whether a fit of all windows leaves no more than noise of any, though one of the half missed the rest.

    That half told too little of the effects' size then, as where the supply pressure fell in the other alone.
    """
    if held.adequacy > WINDOW_HALVES.shows_more:
        return False
    windows = (*fitted.cut.windows, *held.cut.windows)
    order = sorted(range(len(windows)), key=lambda k: windows[k])
    every = Cut(held.cut.series, tuple(windows[k] for k in order))
    start = np.concatenate([fitted.start, held.start])[order]
    both = fit(fitted.model, every, fitted.x, start)
    return bool(np.max(both.error / every.allowed**2) < HELD_OUT.adequate)


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
