"""Whether what a set of effects leaves is noise of any colour, so that no further effect is looked for.

Such noise remembers: an autoregression foretells a part of it. In what this does not foretell, every sample
tells something of its own, so that chance can be reckoned: a direction that has nothing to do with the noise
takes up one part in `n` of it, and `n` times the log of what it saves is distributed as chi squared (the
likelihood ratio; Wilks, Ann. Math. Statist. 9, 1938).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import beta, chi2

from seod.diagnose.causes.table import CAUSES, further_causes, remote
from seod.diagnose.fitting.held_out import nrmse
from seod.diagnose.fitting.least_squares import weighted
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.fitting.repeats import repeats
from seod.diagnose.fitting.slow_offset import half_waves, slow_part
from seod.diagnose.fitting.uncertainty import at_limits
from seod.diagnose.search.first_order_gain import ParentResidual
from seod.diagnose.search.refine import refined
from seod.diagnose.starts.effect_starts import effect_starts
from seod.diagnose.starts.twins import twins
from seod.diagnose.tuning.fitting import NOISE_COLOUR
from seod.diagnose.tuning.search import NOISE_ALONE
from seod.diagnose.tuning.starts import LINES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.noise_colour import NoiseColour
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Mask
    from seod.diagnose.search.screen import Screen


@dataclass(frozen=True, slots=True)
class _Left:
    """What is left of a window; shape (n,)."""

    file: int
    t: Array
    error: Array
    scored: Mask


def noise_alone(found: Fitted, screen: Screen) -> bool:
    """Whether noise is left, of which no effect promises to save any: on the windows for trying, then on all.

    Asked also where no more than the noise is left: that is known to some percent, of which an effect may be.
    """
    if _leaves_much(found) or not nothing_promised(found, screen):
        return False
    return found.cut is screen.every or nothing_promised(refined(found, screen.every, screen), screen)


def _leaves_much(found: Fitted) -> bool:
    """Whether so much of the movement is left that no memory decides whether it is noise."""
    cut = found.cut
    error = np.where(cut.good, weighted(found.model, cut, found.x, found.start), 0.0)
    return nrmse([(cut.y[p], cut.y[p] - error[p], cut.good[p]) for p in cut.slices]) > NOISE_ALONE.much


def nothing_promised(found: Fitted, screen: Screen, *, beside_slow: bool = False) -> bool:
    """Whether no further effect promises to save more of what is left than chance would, and nothing repeats.

    Nor beside the set's twin. Or, `beside_slow`, more than an offset of the sensor that moves slowly would.
    """
    if not _promises_nothing(found, screen, beside_slow=beside_slow):
        return False
    return all(_promises_nothing(one, screen, beside_slow=beside_slow) for one in twins([found]))


def _promises_nothing(found: Fitted, screen: Screen, *, beside_slow: bool) -> bool:
    """Likewise of a set alone.

    Nobody can tell where no row counts, or where a coarse sensor's rounding hides the error of most. And a
    plant at an end of its range is none that leaves noise.
    """
    cut, left = found.cut, _left(found)
    if not left or at_limits(found):
        return False
    long, short = (
        replace(found, cut=_remembering(cut, colour(left, longest)))
        for longest in (NOISE_COLOUR.longest, NOISE_COLOUR.longest[:1])
    )
    ahead, near = (
        ParentResidual(one, half_waves(one.cut, first=1) if beside_slow else None) for one in (long, short)
    )
    return not _promised(ahead, near, screen) and not _repeated(left, cut)


def in_its_noise(found: Fitted) -> Cut:
    """The windows with the noise that a set leaves; as they are where it is white, or nobody can tell."""
    left = _left(found)
    return _remembering(found.cut, colour(left)) if left else found.cut


def _left(found: Fitted) -> list[_Left]:
    """What is left of each window; none where no row counts, or rounding hides the error of most."""
    cut = found.cut
    error = np.where(cut.good, weighted(found.model, cut, found.x, found.start), 0.0)
    if np.count_nonzero(error) <= NOISE_ALONE.telling * np.count_nonzero(cut.good):
        return []
    return _parts(cut, error)


def _parts(cut: Cut, error: Array) -> list[_Left]:
    """By windows in which any row counts; of errors end to end, shape (n,)."""
    return [
        _Left(k, cut.series[k].t[first:last], error[rows], cut.good[rows])
        for (k, first, last), rows in zip(cut.windows, cut.slices, strict=True)
        if cut.good[rows].any()
    ]


def _repeated(left: Sequence[_Left], cut: Cut) -> bool:
    """Whether what is left repeats with the command: harmonics, too, are foretold by what was before."""
    again = repeats(cut.series, left)
    return again is not None and again.significant


def _remembering(cut: Cut, noise: NoiseColour) -> Cut:
    """The windows with this noise, unless it is white, or too few rows have all of their past."""
    if not noise.memory:
        return cut
    remembering = cut.remembering(noise.memory, slow_part(noise, cut))
    if np.count_nonzero(remembering.good) < NOISE_ALONE.telling * np.count_nonzero(cut.good):
        return cut
    return remembering


def _promised(long: ParentResidual, short: ParentResidual, screen: Screen) -> bool:
    """Whether an effect more promises to save more than chance would of one of so many.

    `short` is what a set leaves by noise of a short memory: a long one would foretell a wave.
    """
    found, ahead = long.parent, {False: long, True: short}
    rows = {wave: np.count_nonzero(one.good) for wave, one in ahead.items()}
    trials = [
        (name, start)
        for name in further_causes(found.model.scales, found.model.names)
        for start in effect_starts(found, name, screen.every)
        if not remote(start)
    ]
    chance = NOISE_ALONE.chance / max(len(trials), 1)
    of_wave = float(chi2.isf(NOISE_ALONE.chance / (LINES.finer * rows[True]), 2))  # the largest of so many
    promises = screen.parallel(
        lambda one: (_waves(one[0]), ahead[_waves(one[0])].promise(*one, each_size=True)), trials
    )
    if any(
        rows[wave] * one.saves > (of_wave if wave else chi2.isf(chance, one.numbers))
        for wave, one in promises
    ):
        return True
    raw = ParentResidual(replace(found, cut=found.cut.remembering(())))
    most = [
        (name, directions)
        for name, directions in screen.parallel(lambda one: (one[0], raw.directions(*one)), trials)
        if _part(directions, raw.remaining[:, None])[0] > NOISE_ALONE.most
    ]
    return bool(most) and _hides_in_memory(raw, most)


def _hides_in_memory(raw: ParentResidual, most: Sequence[tuple[str, Array]]) -> bool:
    """Whether one of the effects that make up most of what is left would not make up as much of noise.

    A memory that is fitted to all that is left foretells an effect, too. Noise of that colour has its
    frequencies, but not its phases, unless it is a wave. Without a wave the past foretells the rest better,
    or the wave is nearly all that is left: no noise keeps its phase through all windows.
    """
    own, noises = _foretold(raw, raw.remaining), _noises(raw)
    for name, directions in most:
        if _waves(name):
            rest = raw.remaining - directions @ (directions.T @ raw.remaining)
            part = 1.0 - float(rest @ rest) / float(raw.remaining @ raw.remaining)
            hides = part > NOISE_ALONE.line_alone or own - _foretold(raw, rest) > NOISE_ALONE.line_saves
        else:
            hides = _chance_of_part(directions, raw.remaining, noises) < NOISE_ALONE.by_noise
        if hides:
            return True
    return False


def _foretold(raw: ParentResidual, remaining: Array) -> float:
    """Log of the mean square that noise fitted to what remains, shape (n,), does not foretell of it."""
    left = _parts(raw.parent.cut, raw.unweighted(remaining))
    noise = colour(left)
    seen = [noise.whitened(one.error)[noise.has_past(one.scored)] for one in left]
    return float(np.log(max(float(np.mean(np.concatenate(seen) ** 2)), 1e-300)))


def _noises(raw: ParentResidual) -> Array:
    """Of the colour of all that is left, less what the parent can do about them; shape (n, noises)."""
    noise, random = colour(_left(raw.parent)), np.random.default_rng(NOISE_ALONE.seed)
    drawn = [noise.drawn(int(rows), NOISE_ALONE.noises, random) for rows in raw.parent.cut.sizes]
    return raw.beyond(np.concatenate(drawn) * raw.good[:, None])


def _chance_of_part(directions: Array, remaining: Array, noises: Array) -> float:
    """With what chance an effect makes up as much of noise as of what remains: parts are beta distributed."""
    own, of_noises = _part(directions, remaining[:, None])[0], _part(directions, noises)
    mean, variance = float(np.mean(of_noises)), float(np.var(of_noises))
    both = mean * (1.0 - mean) / max(variance, 1e-300) - 1.0
    return float(beta.sf(own, mean * both, (1.0 - mean) * both))


def _part(directions: Array, of: Array) -> Array:
    """Part of each column's square, shape (n, k), that lies in these directions; shape (k,)."""
    return np.asarray(np.sum((directions.T @ of) ** 2, axis=0) / np.maximum(np.sum(of**2, axis=0), 1e-300))


def _waves(name: str) -> bool:
    return CAUSES[name].wave is not None
