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
    from seod.diagnose.result import Array


def one_sided(seen: HeldOut, held: HeldOut) -> bool:
    """Whether the windows of one half show something of which there is nothing in the other."""
    less, more = sorted((seen.adequacy, held.adequacy))
    return less < HELD_OUT.adequate and more > HALVES.shows_more


def noise_is_larger(seen: HeldOut, held: HeldOut) -> bool:
    """Whether windows held out err by more than noise like that of those fitted would.

    Both are simulated alike, from the states of their first fifth. An F test of squared errors, in so many
    samples as count of noise that remembers, beside an offset that moves slowly, which such noise may have;
    where the load moves faster, noise may be larger, too. Of the recordings that were fitted alone: in others
    the noise may be another.
    """
    own, known = window_residuals(seen, held_out=False), len(seen.cut.series)
    others = [one for one in window_residuals(held, held_out=True) if one.file < known]
    if not own or not others:
        return False
    noise = colour(own)
    bends = HALVES.slow_bends if noise.memory else 0
    ratio = _mean_square(others, bends) / max(_mean_square(own, bends), 1e-300)
    moved = _speed(others) / max(_speed(own), 1e-300)
    larger = ratio / max(1.0, moved)
    counts = [sum(int(one.scored.sum()) for one in some) / noise.correlation for some in (others, own)]
    return larger > HALVES.errs_more and float(fisher.sf(larger, *counts)) < HALVES.chance


def _mean_square(of: Sequence[WindowResidual], bends: int) -> float:
    """Of windows' errors, each for as much, less a polynomial of that degree in each where it is not 0."""
    return float(np.mean([np.mean(_less_slow(one.error[one.scored], bends) ** 2) for one in of]))


def _less_slow(error: Array, bends: int) -> Array:
    """Without what moves slowly, as an offset of the sensor in noise that remembers."""
    if not bends:
        return error
    at = np.linspace(-1.0, 1.0, len(error))
    return np.asarray(error - np.polynomial.Polynomial.fit(at, error, bends)(at))


def _speed(of: Sequence[WindowResidual]) -> float:
    """Mean square of the load's speed, each window for as much."""
    return float(np.mean([np.mean(one.velocity[one.scored] ** 2) for one in of]))
