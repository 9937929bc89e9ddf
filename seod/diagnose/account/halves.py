"""Whether windows that were fitted and windows held out show the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import f as fisher

from seod.diagnose.account.residual import window_residuals
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.tuning.account import HALVES
from seod.diagnose.tuning.fitting import HELD_OUT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.fitting.held_out import HeldOut


def one_sided(seen: HeldOut, held: HeldOut) -> bool:
    """Whether the windows of one half show something of which there is nothing in the other."""
    less, more = sorted((seen.adequacy, held.adequacy))
    return less < HELD_OUT.adequate and more > HALVES.shows_more


def noise_is_larger(seen: HeldOut, held: HeldOut) -> bool:
    """Whether windows held out err by more than noise like that of those fitted would.

    Both are simulated alike, from the states of their first fifth. An F test of squared errors, in so many
    samples as count of noise that remembers; where the load moves faster, noise may be larger, too. Of the
    recordings that were fitted alone: in others the noise may be another.
    """
    own, known = window_residuals(seen, held_out=False), len(seen.cut.series)
    others = [one for one in window_residuals(held, held_out=True) if one.file < known]
    if not own or not others:
        return False
    ratio = _mean(others, "error") / max(_mean(own, "error"), 1e-300)
    moved = _mean(others, "velocity") / max(_mean(own, "velocity"), 1e-300)
    larger = ratio / max(1.0, moved)
    correlation = colour(own).correlation
    counts = [sum(int(one.scored.sum()) for one in some) / correlation for some in (others, own)]
    return larger > HALVES.errs_more and float(fisher.sf(larger, *counts)) < HALVES.chance


def _mean(of: Sequence[WindowResidual], name: str) -> float:
    """Mean square of windows, each for as much."""
    return float(np.mean([np.mean(getattr(one, name)[one.scored] ** 2) for one in of]))
