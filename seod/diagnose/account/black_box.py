"""What command and state foretell of a residual: a linear model of many forces, tried window by window.

Its terms stand in `black_box_terms`. Ridge regression, each window foretold by a fit of the others, in errors
half a period of the plant ahead. No two windows of a sweep are alike: there each fold of a window is foretold
by all others, those beside it among them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.account.black_box_terms import columns_of, shapes_of, sizes_of
from seod.diagnose.account.chance import limit, may_pass, noises_like, usable
from seod.diagnose.account.residual import compared, fewer_shown, horizon, mean_square
from seod.diagnose.fitting.noise_colour import WHITE, NoiseColour, colour
from seod.diagnose.tuning.account import BLACK_BOX, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import Plant, WindowResidual
    from seod.diagnose.fitting.repeats import Share
    from seod.diagnose.result import Array, Mask, Rows


class Foretold(NamedTuple):
    """What is foretold of windows which the fit has not seen.

    Attributes:
        share: Its mean square.
        rest: What is left of the windows.
        detectable: Mean square of a systematic part that would have been shown beside what is left, over its
            mean square; infinite where none of those tried would.
    """

    share: Share
    rest: list[WindowResidual]
    detectable: float


class Fold(NamedTuple):
    """Rows of a window that are foretold together."""

    window: int
    rows: Rows


def foretold(
    parts: Sequence[WindowResidual], plant: Plant, *, swept: bool = False, in_loop: bool
) -> Foretold | None:
    """Of the windows held out, each by a fit of all others; None of a single window.

    It is a share of errors half a period of the plant ahead: less what noise makes of those before. What a
    wrong force moves in that time stands out of the sensor's noise, and what had been moved before, which in
    a position drifts on without an end, does not hide it.

    Whether it is more than chance is asked of all windows: this fit has seen none of those that it foretells.
    What chance shows is known by noises of the same colour, foretold likewise. The same is asked of the
    residual with a known part added to it, of several shapes, sizes and signs.
    For noise all that is left is taken, then the rest of it: the one by which more shows counts.
    In a loop commands answer within half a period: there it has to show one row ahead, too.
    """
    if len(parts) < 2 or not any(one.held_out for one in parts):
        return None
    how = _How(swept, in_loop)
    first = _foretold(parts, plant, usable(colour(parts), parts), how)
    if mean_square(first.rest) >= mean_square(parts):
        return first
    second = _foretold(parts, plant, usable(colour(first.rest), parts), how)
    return max(first, second, key=lambda one: one.share.score - one.share.limit)


class _How(NamedTuple):
    """How it is asked.

    Attributes:
        swept: Of a sweep.
        in_loop: Commands answer to what disturbs the load.
    """

    swept: bool
    in_loop: bool

    @property
    def chance(self) -> float:
        """Probability with which noise alone may pass."""
        return may_pass(in_loop=self.in_loop)


def _foretold(parts: Sequence[WindowResidual], plant: Plant, noise: NoiseColour, how: _How) -> Foretold:
    sizes = sizes_of(parts)
    asked = _Asked(_added(parts, plant, sizes), [noises_like(one, noise, k) for k, one in enumerate(parts)])
    folds = _folds(parts, noise, swept=how.swept)
    products = []
    for w, one in enumerate(parts):
        white = columns_of(one, plant, sizes, asked.beside(w), noise)
        products += [_products(white[each.rows]) for each in folds if each.window == w]
    weights = _weights(products, asked.targets)
    plain: list[Errors] = []
    ahead: list[Errors] = []
    next_row: list[Errors] = []
    for w, one in enumerate(parts):
        by_others = [(each.rows, weights[p]) for p, each in enumerate(folds) if each.window == w]
        white = columns_of(one, plant, sizes, asked.beside(w), noise)
        known = np.where(noise.has_past(one.scored)[:, None], white, 0.0)
        later = noise.ahead_of_white(known, horizon(one, plant))
        plain.append(_before_and_after(columns_of(one, plant, sizes, asked.beside(w), WHITE), by_others))
        ahead.append(_before_and_after(later, by_others))
        if how.in_loop:
            next_row.append(_before_and_after(known, by_others))
    count = _segments(parts, plant)
    shares = _shares(ahead, len(asked.added), count, how.chance)
    if how.in_loop:
        pairs = zip(shares, _shares(next_row, len(asked.added), count, how.chance), strict=True)
        shares = [fewer_shown(*pair) for pair in pairs]
    own, *others = shares
    asked_of = [w for w, one in enumerate(parts) if one.held_out]
    found = _saved([ahead[w] for w in asked_of], 0, count)
    found = _of_all(found, [ahead[w] for w in asked_of], [plain[w] for w in asked_of])
    rest = _left(parts, plain)
    return Foretold(
        replace(found, score=own.score, limit=own.limit),
        rest,
        _detectable([one.significant for one in others]),
    )


def _of_all(share: Share, ahead: Sequence[Errors], plain: Sequence[Errors]) -> Share:
    """A share of errors ahead as one of all that is left, but no more than what is foretold moves in all."""
    rows = sum(int(np.count_nonzero(one.counts)) for one in plain)
    over = sum(_energy(one.before, one) for one in plain) / max(
        sum(_energy(one.before, one) for one in ahead), 1e-300
    )
    most = sum(_energy(one.before - one.after, one) for one in plain) / rows
    return replace(share, square=min(share.square * over, most), sd=share.sd * over)


def _energy(errors: Array, of: Errors) -> float:
    return float(np.sum(errors[0][of.counts] ** 2))


class _Asked(NamedTuple):
    """Of which it is asked whether they are foretold.

    Attributes:
        added: What is added to the residual: which shape, and how much of it; first nothing.
        noises: Of each window noise like what is left; shape (n, noises).
    """

    added: list[tuple[int, float]]
    noises: list[Array]

    @property
    def targets(self) -> int:
        """Residuals with what is added, and noises."""
        return len(self.added) + BLACK_BOX.noises

    def beside(self, window: int) -> tuple[list[tuple[int, float]], Array]:
        """Those of a window."""
        return self.added, self.noises[window]


def _left(parts: Sequence[WindowResidual], of: Sequence[Errors]) -> list[WindowResidual]:
    """Windows with what is not foretold of them."""
    pairs = zip(parts, of, strict=True)
    return [replace(one, error=each.after[0], scored=each.counts) for one, each in pairs]


def _segments(parts: Sequence[WindowResidual], plant: Plant) -> int:
    """Parts of each window that are compared: long enough to be independent of each other."""
    alike = BLACK_BOX.horizons * float(np.mean([horizon(one, plant) for one in parts]))
    longest = float(np.mean([one.scored.sum() for one in parts])) / alike
    return int(min(max(1.0, longest), math.ceil(SYSTEMATIC.segments / len(parts))))


def _shares(of: Sequence[Errors], asked: int, count: int, chance: float) -> list[Share]:
    """Whether residuals are foretold better than noises of the same colour, which come last, would be."""
    last = len(of[0].before)
    noises = [_saved(of, k, count).score for k in range(last - BLACK_BOX.noises, last)]
    most = limit(np.array(noises), chance)
    return [replace(_saved(of, k, count), limit=most) for k in range(asked)]


def _saved(of: Sequence[Errors], k: int, count: int) -> Share:
    before, after = [one.before[k] ** 2 for one in of], [one.after[k] ** 2 for one in of]
    return compared(before, after, [one.counts for one in of], count)


class Errors(NamedTuple):
    """A residual, and those with a known part added, before and after what is foretold; shape (k, n)."""

    before: Array
    after: Array
    counts: Mask


def _before_and_after(columns: Array, by_others: Sequence[tuple[Rows, Array]]) -> Errors:
    """Errors where folds are foretold: rows, and the coefficients of each residual by other folds."""
    asked = by_others[0][1].shape[0]
    before, counts = columns[:, -asked:].T, np.zeros(len(columns), np.bool_)
    after = np.zeros_like(before)
    for rows, weights in by_others:
        after[:, rows] = before[:, rows] - weights @ columns[rows, :-asked].T
        counts[rows] = True
    return Errors(before, after, counts)


def _folds(parts: Sequence[WindowResidual], noise: NoiseColour, *, swept: bool) -> list[Fold]:
    """Windows, or of a sweep parts of them, each longer than what does not repeat is alike."""
    every = [np.flatnonzero(noise.has_past(one.scored)) for one in parts]
    if not swept:
        return [Fold(w, rows) for w, rows in enumerate(every)]
    length = BLACK_BOX.alike * noise.correlation
    out = []
    for w, rows in enumerate(every):
        count = int(min(max(1.0, len(rows) / length), BLACK_BOX.most_folds))
        out += [Fold(w, each) for each in np.array_split(rows, count)]
    return out


def _detectable(shown: Sequence[bool]) -> float:
    """Least of the sizes tried from which on the added parts are mostly shown, over what is left."""
    of_size = np.array(shown).reshape(len(BLACK_BOX.added), -1).mean(axis=1) >= BLACK_BOX.mostly
    least = math.inf
    for size, enough in reversed(list(zip(BLACK_BOX.added, of_size, strict=True))):
        if not enough:
            break
        least = size
    return least


def _added(parts: Sequence[WindowResidual], plant: Plant, sizes: dict[str, float]) -> list[tuple[int, float]]:
    """Shapes that are added to the residual, and how much of each; first nothing.

    Sizes ascend; each has all shapes with both signs.
    """
    shapes = [shapes_of(one, plant, sizes)[one.scored] for one in parts]
    counts = sum(len(each) for each in shapes)
    own = np.sqrt(np.maximum(sum(np.sum(each**2, axis=0) for each in shapes) / counts, 1e-300))
    rms = math.sqrt(mean_square(parts))
    scales = [(k, sign * rms / float(size)) for k, size in enumerate(own) for sign in (1.0, -1.0)]
    return [(0, 0.0)] + [(k, math.sqrt(part) * of) for part in BLACK_BOX.added for k, of in scales]


def _products(columns: Array) -> Array:
    """Of a window's columns and residuals, each with each."""
    return np.asarray(columns.T @ columns)


def _weights(products: Sequence[Array], asked: int) -> Array:
    """Coefficients of the terms for each fold by the others, shape (folds, asked, terms).

    The last `asked` columns are foretold, each with the penalty that foretells it best.
    """
    tried = np.array([_ridge(products, ridge, asked) for ridge in BLACK_BOX.ridges])
    gains = np.array([_gain(products, weights) for weights in tried])
    return np.asarray(tried[np.argmax(gains, axis=0), :, np.arange(asked)].swapaxes(0, 1))


def _ridge(products: Sequence[Array], ridge: float, asked: int) -> Array:
    """Coefficients with one penalty, shape (folds, asked, terms)."""
    total = np.sum(products, axis=0)
    size = np.sqrt(np.maximum(total.diagonal()[:-asked], 1e-300))
    found = []
    for own in products:
        others = total - own
        scaled = others[:-asked, :-asked] / np.outer(size, size) + ridge * np.eye(len(size))
        found.append(np.linalg.solve(scaled, others[:-asked, -asked:] / size[:, None]).T / size)
    return np.array(found)


def _gain(products: Sequence[Array], weights: Array) -> Array:
    """What coefficients save of the sum of squares, shape (asked,)."""
    asked = weights.shape[1]
    saved = np.zeros(asked)
    for own, x in zip(products, weights, strict=True):
        saved += np.sum(x * (2.0 * own[:-asked, -asked:].T - x @ own[:-asked, :-asked]), axis=1)
    return saved
