"""What command and state foretell of a residual: a linear model of many forces, tried window by window.

The forces act on the load, the volts on the valve, of the fitted plant, so that what they do to the reading
drifts as it does; further terms act on the reading itself. Ridge regression, each window foretold by a fit of
the others. No two windows of a sweep are alike: there each fold of a window is foretold by all others, those
beside it among them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import cont2discrete, lfilter

from seod.diagnose.account.noise_colour import WHITE, NoiseColour, colour
from seod.diagnose.account.residual import compared, fewer_shown, mean_square
from seod.diagnose.tuning.account import BLACK_BOX, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import Plant, Share, WindowResidual
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
    parts: Sequence[WindowResidual], plant: Plant, *, swept: bool = False, predicted: bool = False
) -> Foretold | None:
    """Of the windows held out, each by a fit of all others; None of a single window.

    Whether it is more than chance is asked of all windows: this fit has seen none of those that it foretells.
    The same is asked of the residual with a known part added to it, of several shapes, sizes and signs.
    It has to show in errors as they are, and in what noise does not foretell of them: first all that is left
    is taken for noise, then the rest of it. Of a model that was fitted to these (`predicted`) in these alone.
    """
    if len(parts) < 2 or not any(one.held_out for one in parts):
        return None
    how = {"swept": swept, "predicted": predicted}
    first = _foretold(parts, plant, _usable(colour(parts), parts), **how)
    if mean_square(first.rest) >= mean_square(parts):
        return first
    return _foretold(parts, plant, _usable(colour(first.rest), parts), **how)


def _usable(noise: NoiseColour, parts: Sequence[WindowResidual]) -> NoiseColour:
    """White noise where a window has no row with all of its past."""
    return noise if all(noise.has_past(one.scored).any() for one in parts) else WHITE


def _foretold(
    parts: Sequence[WindowResidual], plant: Plant, noise: NoiseColour, *, swept: bool, predicted: bool
) -> Foretold:
    sizes = sizes_of(parts)
    added = _added(parts, plant, sizes)
    folds = _folds(parts, noise, swept=swept)
    products = []
    for w, one in enumerate(parts):
        columns = _columns(one, plant, sizes, added, noise)
        products += [_products(columns[each.rows]) for each in folds if each.window == w]
    targets = products[0].shape[0] - len(added)
    weights = [_weights([_of(each, targets, k) for each in products]) for k in range(len(added))]
    rest, plain, white = [], [], []
    for w, one in enumerate(parts):
        by_others = [
            (each.rows, np.array([some[p] for some in weights]))
            for p, each in enumerate(folds)
            if each.window == w
        ]
        columns = _columns(one, plant, sizes, added, WHITE)
        plain.append(_before_and_after(columns[:, : targets + 1], [(r, x[:1]) for r, x in by_others]))
        rest.append(replace(one, error=plain[-1].after[0], scored=plain[-1].counts))
        white.append(_before_and_after(_columns(one, plant, sizes, added, noise), by_others))
    pairs = zip(parts, white, strict=True)
    unforeseen = [replace(one, error=each.after[0], scored=each.counts) for one, each in pairs]
    count = _segments(unforeseen)
    own = _share(white, 0, count)
    own = own if predicted else fewer_shown(_share(plain, 0, _segments(rest)), own)
    shown = [_share(white, k, count).significant for k in range(1, len(added))]
    held_out = [each for one, each in zip(parts, plain, strict=True) if one.held_out]
    new = _share(held_out, 0, _segments(rest))
    return Foretold(replace(new, score=own.score, limit=own.limit), rest, _detectable(shown))


def _segments(rest: Sequence[WindowResidual]) -> int:
    """Parts of each window that are compared: long enough to be independent of each other."""
    alike = BLACK_BOX.correlations * colour(rest).correlation
    longest = float(np.mean([one.scored.sum() for one in rest])) / alike
    return int(min(max(1.0, longest), math.ceil(SYSTEMATIC.segments / len(rest))))


def _share(of: Sequence[Errors], k: int, count: int) -> Share:
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
    """What is added to the residual: which shape, and how much of it; first nothing.

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


def _of(products: Array, targets: int, k: int) -> Array:
    """Products of the columns and of one residual."""
    rows = np.r_[np.arange(targets), targets + k]
    return np.asarray(products[np.ix_(rows, rows)])


def _products(columns: Array) -> Array:
    """Of a window's columns and residuals, each with each."""
    return np.asarray(columns.T @ columns)


def _weights(products: Sequence[Array]) -> Array:
    """Coefficients for each window by the others, shape (w, p); with the penalty that foretells best."""
    tried = [_ridge(products, ridge) for ridge in BLACK_BOX.ridges]
    return tried[int(np.argmax([_gain(products, weights) for weights in tried]))]


def _ridge(products: Sequence[Array], ridge: float) -> Array:
    total = np.sum(products, axis=0)
    size = np.sqrt(np.maximum(total.diagonal()[:-1], 1e-300))
    found = []
    for own in products:
        others = total - own
        scaled = others[:-1, :-1] / np.outer(size, size) + ridge * np.eye(len(size))
        found.append(np.linalg.solve(scaled, others[:-1, -1] / size) / size)
    return np.array(found)


def _gain(products: Sequence[Array], weights: Array) -> float:
    """What coefficients save of the sum of squares."""
    pairs = zip(products, weights, strict=True)
    return sum(float(2.0 * x @ own[:-1, -1] - x @ own[:-1, :-1] @ x) for own, x in pairs)


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
    added: Sequence[tuple[int, float]],
    noise: NoiseColour,
) -> Array:
    """All terms, and the residual with what is added, without what a state at the beginning would do.

    All as they come through what makes this noise white. Shape (n, p + len(added)).
    """
    tick = float(np.median(np.diff(one.t)))
    u, p, v, x = (getattr(one, name) / sizes[name] for name in ("u", "pressure", "velocity", "position"))
    angle = tick * plant.omega_n
    forces = _through(_load(plant), _forces(p, v, x), angle)
    volts = _through(_valve(plant), _volts(u, p, x, angle), angle)
    error = np.where(one.scored, one.error, 0.0)
    columns = np.column_stack([*forces, *volts, *_readings(p, v, x), error])
    shapes = _shapes(one, plant, sizes)
    more = [columns[:, -1] + size * shapes[:, k] for k, size in added[1:]]
    return _without_beginning(np.column_stack([columns, *more]), one, plant, angle, noise)


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
    """An offset, and movements of the plant that is left alone; shape (n, 3 or 4)."""
    _, poles, _ = cont2discrete(_valve(plant), angle)
    begins = np.eye(len(poles) - 1, n)
    return np.column_stack([np.ones(n), *lfilter([1.0], poles, begins, axis=-1)])
