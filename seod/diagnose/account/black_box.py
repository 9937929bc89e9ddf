"""What command and state foretell of a residual: a linear model of many forces, tried window by window.

The forces act on the load, the volts on the valve, of the fitted plant, so that what they do to the reading
drifts as it does; further terms act on the reading itself. Ridge regression, each window foretold by a fit of
the others, in errors half a period of the plant ahead. No two windows of a sweep are alike: there each fold
of a window is foretold by all others, those beside it among them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import cont2discrete, lfilter

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
        white = _columns(one, plant, sizes, asked.beside(w), noise)
        products += [_products(white[each.rows]) for each in folds if each.window == w]
    weights = _weights(products, asked.targets)
    plain: list[Errors] = []
    ahead: list[Errors] = []
    next_row: list[Errors] = []
    for w, one in enumerate(parts):
        by_others = [(each.rows, weights[p]) for p, each in enumerate(folds) if each.window == w]
        white = _columns(one, plant, sizes, asked.beside(w), noise)
        known = np.where(noise.has_past(one.scored)[:, None], white, 0.0)
        later = noise.ahead_of_white(known, horizon(one, plant))
        plain.append(_before_and_after(_columns(one, plant, sizes, asked.beside(w), WHITE), by_others))
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
    shapes = [_shapes(one, plant, sizes)[one.scored] for one in parts]
    counts = sum(len(each) for each in shapes)
    own = np.sqrt(np.maximum(sum(np.sum(each**2, axis=0) for each in shapes) / counts, 1e-300))
    rms = math.sqrt(mean_square(parts))
    scales = [(k, sign * rms / float(size)) for k, size in enumerate(own) for sign in (1.0, -1.0)]
    return [(0, 0.0)] + [(k, math.sqrt(part) * of) for part in BLACK_BOX.added for k, of in scales]


def _shapes(one: WindowResidual, plant: Plant, sizes: dict[str, float]) -> Array:
    """Systematic parts that are none of the black box's own terms, shape (n, shapes).

    As a load or a valve off the list would make them, without what a state at the beginning would do.
    """
    u, v, x = (getattr(one, name) / sizes[name] for name in ("u", "velocity", "position"))
    angle = float(np.median(np.diff(one.t))) * plant.omega_n
    wave, limit = np.sin(BLACK_BOX.unlisted_wave * math.pi * x), BLACK_BOX.unlisted_limit
    forces = _through(_load(plant), [np.sign(v) * np.sqrt(np.abs(v)), wave], angle)
    volts = _through(_valve(plant), [np.clip(u, -limit, limit), u * np.sqrt(np.abs(u)) * x], angle)
    return _without_beginning(np.column_stack([*forces, *volts]), one, plant, angle, WHITE)


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


def sizes_of(parts: Sequence[WindowResidual]) -> dict[str, float]:
    """Largest values over all windows."""
    names = ("u", "pressure", "velocity", "position")
    return {
        name: max(1e-300, *(float(np.max(np.abs(getattr(one, name)))) for one in parts)) for name in names
    }


def _columns(
    one: WindowResidual,
    plant: Plant,
    sizes: dict[str, float],
    asked: tuple[Sequence[tuple[int, float]], Array],
    noise: NoiseColour,
) -> Array:
    """All terms, the residual with what is added, and noises, without what a state at the beginning would do.

    All as they come through what makes this noise white. Shape (n, terms + asked).
    """
    added, noises = asked
    tick = float(np.median(np.diff(one.t)))
    u, p, v, x = (getattr(one, name) / sizes[name] for name in ("u", "pressure", "velocity", "position"))
    angle = tick * plant.omega_n
    forces = _through(_load(plant), _forces(p, v, x), angle)
    volts = _through(_valve(plant), _volts(u, p, x, angle), angle)
    error = np.where(one.scored, one.error, 0.0)
    columns = np.column_stack([*forces, *volts, *_readings(p, v, x), error])
    shapes = _shapes(one, plant, sizes)
    more = [columns[:, -1] + size * shapes[:, k] for k, size in added[1:]]
    return _without_beginning(np.column_stack([columns, *more, noises]), one, plant, angle, noise)


def _without_beginning(
    columns: Array, one: WindowResidual, plant: Plant, angle: float, noise: NoiseColour
) -> Array:
    """Columns, made white, less what is as a state at the window's beginning moves the reading."""
    kept, white = noise.has_past(one.scored), noise.whitened(columns)
    basis, _ = np.linalg.qr(noise.whitened(_free(len(one.t), plant, angle))[kept])
    white[kept] -= basis @ (basis.T @ white[kept])
    return white


def _forces(p: Array, v: Array, x: Array) -> list[Array]:
    """What may brake the load."""
    sign = np.tanh(v / BLACK_BOX.sharp)
    waves = [wave(k * math.pi * x) for k in range(1, BLACK_BOX.waves + 1) for wave in (np.cos, np.sin)]
    return [
        np.ones_like(v),
        *(sign, sign * np.exp(-np.abs(v) / BLACK_BOX.stribeck), v, v * np.abs(v), v**3),
        *(x, x * np.abs(x), x * x, x**3),
        *(sign * x, sign * np.abs(p), v * x, v * x * x, v * p),
        *waves,
    ]


def _volts(u: Array, p: Array, x: Array, angle: float) -> list[Array]:
    """What may be added to the command."""
    hinges = [np.sign(s) * np.maximum(np.abs(s) - part, 0.0) for s in (u, p) for part in BLACK_BOX.hinges]
    rows = [min(max(1, round(lag / angle)), len(u) - 1) for lag in BLACK_BOX.lags]
    lagged = [np.r_[np.full(k, u[0]), u[:-k]] for k in rows]
    change = np.gradient(p) / angle
    return [
        *(u, np.abs(u), u * np.abs(u), u * u, u**3, np.tanh(u / BLACK_BOX.sharp)),
        *(np.abs(p), p * np.abs(p), p * p, p**3, u * p, np.abs(u) * p, u * np.abs(p), u * p * p),
        *(u * x, p * x, change * x, change, change * np.abs(p)),
        *hinges,
        *lagged,
    ]


def _readings(p: Array, v: Array, x: Array) -> list[Array]:
    """What may be added to the reading."""
    waves = [wave(k * math.pi * x) for k in range(1, BLACK_BOX.waves + 1) for wave in (np.cos, np.sin)]
    return [np.tanh(v / BLACK_BOX.sharp), v, p, np.abs(v), np.abs(x), x * x, x**3, v * x, v * x * x, *waves]


def _load(plant: Plant) -> tuple[Array, Array]:
    """From a force against the load to the reading, but for a factor: -(s + 2 zeta) / (s^2 + ...) of Eq. 1.

    Time is counted in 1 / omega_n.
    """
    return np.array([-1.0, -2.0 * plant.zeta]), _poles(plant)


def _valve(plant: Plant) -> tuple[Array, Array]:
    """Likewise from volts: Eq. 1."""
    return np.ones(1), _poles(plant)


def _poles(plant: Plant) -> Array:
    poles = np.array([1.0, 2.0 * plant.zeta, 1.0])
    return poles if plant.sees_speed else np.r_[poles, 0.0]


def _through(transfer: tuple[Array, Array], inputs: Sequence[Array], angle: float) -> list[Array]:
    """What inputs that are held between samples do, from rest; `angle` is omega_n times the interval."""
    number, poles, _ = cont2discrete(transfer, angle)
    return list(lfilter(number.ravel(), poles, np.array(inputs), axis=-1))


def _free(n: int, plant: Plant, angle: float) -> Array:
    """An offset, and movements of the plant that is left alone; shape (n, 3).

    A position that is left alone ends anywhere: its offset is among them.
    """
    _, poles, _ = cont2discrete(_valve(plant), angle)
    left_alone = lfilter([1.0], poles, np.eye(len(poles) - 1, n), axis=-1)
    return np.column_stack([np.ones(n), *left_alone] if plant.sees_speed else [*left_alone])
