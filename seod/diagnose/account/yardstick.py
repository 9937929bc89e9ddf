"""How well models without physics do: ARX and NARX, simulated freely over the same held-out windows.

Both are fitted by least squares to the windows to fit, one step ahead, of a record with fewer samples. Order
and rate are those with which they simulate these windows best. Their state at the beginning of a window is
fitted to its first fifth, as that of the plant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import lfilter, lfiltic

from seod.diagnose.account.residual import compared, fewer_shown
from seod.diagnose.fitting.held_out import nrmse
from seod.diagnose.tuning.account import SYSTEMATIC, YARDSTICK

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from seod.diagnose.account.noise_colour import NoiseColour
    from seod.diagnose.account.residual import Share
    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Mask, Rows


class Run(NamedTuple):
    """A window with fewer samples; arrays of shape (n,).

    Attributes:
        y: Measured, means over rows [unit].
        u: Command, likewise [V].
        good: Where there is a sample.
        first: Those of the window's first fifth.
        rows: Where each stands among the window's rows: its middle.
    """

    y: Array
    u: Array
    good: Mask
    first: Mask
    rows: Array


@dataclass(frozen=True, slots=True)
class Reached:
    """What is reached on the held-out windows without physics.

    Attributes:
        arx: NRMSE of the linear model.
        narx: Of the nonlinear one.
        simulated: The better one's readings, windows end to end, shape (n,).
    """

    arx: float
    narx: float
    simulated: Array


class Arx(NamedTuple):
    """y_t by `order` values of y, and commands, before; with `integrates` the change of y by its changes."""

    order: int
    integrates: bool
    weights: Array

    def simulated(self, runs: Sequence[Run]) -> list[Array]:
        """Windows, each from a beginning that is fitted to its first fifth."""
        return [self._simulated(run) for run in runs]

    def _simulated(self, run: Run) -> Array:
        n, order = len(run.y), self.order
        a, b, constant = self.weights[:order], self.weights[order:-1], self.weights[-1]
        poles = np.r_[1.0, -a]
        steady = np.full(n, constant + b.sum() * run.u[0])
        forced = lfilter(b, poles, run.u - run.u[0]) + lfilter([1.0], poles, steady)
        begun = [lfiltic([1.0], poles, row) for row in np.eye(order)]
        free = [lfilter([1.0], poles, np.zeros(n), zi=each)[0] for each in begun]
        if self.integrates:
            forced = np.cumsum(forced)
            free = [*(np.cumsum(each) for each in free), np.ones(n)]
        columns = np.column_stack(free)
        known = run.first & run.good
        begin = np.linalg.lstsq(columns[known], (run.y - forced)[known], rcond=1e-8)[0]
        return np.asarray(forced + columns @ begin)


class Narx(NamedTuple):
    """An ARX whose terms are bent, multiplied and squared too; begins as that ARX does."""

    arx: Arx
    sizes: Array
    weights: Array

    def simulated(self, runs: Sequence[Run]) -> list[Array]:
        """Windows from the beginning of the linear model's simulation, side by side."""
        order, add = self.arx.order, float(self.arx.integrates)
        begun = self.arx.simulated(runs)
        y, u = _side_by_side(begun), _side_by_side([run.u for run in runs])
        limit = np.array([YARDSTICK.gone_beyond * np.ptp(run.y) + np.max(np.abs(run.y)) for run in runs])
        for k in range(order + self.arx.integrates, len(y)):
            step = _bent(_past(y, u, k, self.arx) / self.sizes) @ self.weights
            y[k] = np.clip(add * y[k - 1] + step, -limit, limit)
        return [y[: len(one), w] for w, one in enumerate(begun)]


def _side_by_side(some: Sequence[Array]) -> Array:
    """As columns, the last values of shorter ones again; shape (longest, w)."""
    longest = max(len(one) for one in some)
    return np.column_stack([np.r_[one, np.full(longest - len(one), one[-1])] for one in some])


def beaten(held: HeldOut, other: Reached, noise: NoiseColour, *, predicted: bool = False) -> Share:
    """By how much a model without physics comes nearer: the difference of the mean squared errors.

    Whether that is more than chance is asked of errors made white, too: where a loop acts on what disturbs
    the load, a command tells of it, and a model that forgets comes nearer than the plant.
    """
    own, others = held.error, held.cut.y - other.simulated
    scored, slices = held.scored & held.sure, held.cut.slices
    count = math.ceil(SYSTEMATIC.segments / len(slices))
    kept = [scored[p] for p in slices]

    def compared_through(made: Callable[[Array], Array], rows: Sequence[Mask]) -> Share:
        before, after = (
            [made(np.where(some, x[p], 0.0)) ** 2 for some, p in zip(kept, slices, strict=True)]
            for x in (own, others)
        )
        return compared(before, after, rows, count)

    nearer = compared_through(lambda x: x, kept)
    shown = compared_through(noise.whitened, [noise.has_past(some) for some in kept])
    least = shown if predicted else fewer_shown(nearer, shown)
    return replace(nearer, score=least.score, limit=least.limit)


def yardstick(to_fit: Cut, held_out: Cut) -> Reached | None:
    """None where the windows are too short for it."""
    best: tuple[float, int, Arx] | None = None
    for stride in sorted({_stride(to_fit, rate) for rate in YARDSTICK.rates}):
        runs = _runs(to_fit, stride)
        for order in YARDSTICK.orders:
            for integrates in (False, True):
                arx = _fitted_arx(runs, order, integrates)
                error = math.inf if arx is None else _error(arx, to_fit, runs)[0]
                if arx is not None and (best is None or error < best[0]):
                    best = error, stride, arx
    if best is None:
        return None
    _, stride, arx = best
    runs, asked = _runs(to_fit, stride), _runs(held_out, stride)
    tried = [_fitted_narx(runs, arx, ridge) for ridge in YARDSTICK.ridges]
    narx = min(tried, key=lambda one: _error(one, to_fit, runs)[0])
    plain, bent = _error(arx, held_out, asked), _error(narx, held_out, asked)
    return Reached(plain[0], bent[0], min(plain, bent, key=lambda each: each[0])[1])


def _stride(cut: Cut, rate: float) -> int:
    one = cut.series[cut.windows[0][0]]
    return max(1, round(one.period_s / rate / one.tick))


def _runs(cut: Cut, stride: int) -> list[Run | None]:
    """Each window with a sample for so many rows; None where few are left."""
    out: list[Run | None] = []
    y, u, good, started = cut.y, cut.gathered("u"), cut.good, cut.started()
    for rows in cut.slices:
        count = (rows.stop - rows.start) // stride
        kept = slice(rows.start, rows.start + count * stride)
        out.append(
            _run(y[kept], u[kept], good[kept], started[kept], stride) if count >= YARDSTICK.fewest else None
        )
    return out


def _run(y: Array, u: Array, good: Mask, started: Mask, stride: int) -> Run | None:
    shape = len(y) // stride, stride
    if not (good & started).any():
        return None
    filled = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good])
    return Run(
        filled.reshape(shape).mean(axis=1),
        u.reshape(shape).mean(axis=1),
        np.asarray(good.reshape(shape).all(axis=1)),
        np.asarray(started.reshape(shape).all(axis=1)),
        np.asarray((np.arange(shape[0]) + 0.5) * stride - 0.5),
    )


def _past(y: Array, u: Array, at: Rows | int, arx: Arx) -> Array:
    """What a linear model foretells samples `at` by, shape (n, columns)."""
    lags = range(1, arx.order + 1)
    before = [y[at - k] - y[at - k - 1] if arx.integrates else y[at - k] for k in lags]
    return np.column_stack([*before, *(u[at - k] for k in range(arx.order + 1)), np.ones_like(y[at - 1])])


def _rows(runs: Sequence[Run | None], arx: Arx) -> tuple[Array, Array]:
    """Of all windows, the past of each sample and the sample, or its change."""
    first, past, now = arx.order + arx.integrates, [], []
    for run in runs:
        if run is None or len(run.y) <= first:
            continue
        at = np.arange(first, len(run.y))
        good = np.logical_and.reduce([run.good[at - k] for k in range(first + 1)])
        at = at[good]
        past.append(_past(run.y, run.u, at, arx))
        now.append(run.y[at] - (run.y[at - 1] if arx.integrates else 0.0))
    return (np.concatenate(past), np.concatenate(now)) if past else (np.empty((0, 1)), np.empty(0))


def _fitted_arx(runs: Sequence[Run | None], order: int, integrates: bool) -> Arx | None:
    empty = Arx(order, integrates, np.empty(0))
    past, now = _rows(runs, empty)
    if len(now) < YARDSTICK.rows_each * (2 * order + 2):
        return None
    weights = np.asarray(np.linalg.lstsq(past, now, rcond=1e-10)[0])
    if not np.all(np.isfinite(weights)):
        return None
    poles = np.roots(np.r_[1.0, -weights[:order]])
    return empty._replace(weights=weights) if np.all(np.abs(poles) < 1.0 + YARDSTICK.unstable) else None


def _bent(past: Array) -> Array:
    """Linear terms; bent ones; products of the newest value of y, its change, and the commands."""
    width = (past.shape[1] - 2) // 2
    y, v, u, w = past[:, 0], past[:, 0] - past[:, 1], past[:, width], past[:, width + 1]
    some = y, v, u, w
    bends = [f(s) for s in some for f in (_sign, np.abs)] + [s**3 for s in some]
    return np.column_stack([past, *bends, *(a * b for a, b in combinations_with_replacement(some, 2))])


def _sign(x: Array) -> Array:
    return np.tanh(x / YARDSTICK.sharp)


def _fitted_narx(runs: Sequence[Run | None], arx: Arx, ridge: float) -> Narx:
    """What the linear model leaves one step ahead, by ridge regression on all terms."""
    past, now = _rows(runs, arx)
    sizes = np.maximum(np.max(np.abs(past), axis=0), 1e-300)
    terms = _bent(past / sizes)
    linear = np.zeros(terms.shape[1])
    linear[: past.shape[1]] = arx.weights * sizes
    size = np.sqrt(np.maximum(np.mean(terms**2, axis=0), 1e-300))
    scaled = terms / size
    products = scaled.T @ scaled / len(now) + ridge * np.eye(len(size))
    right = scaled.T @ (now - terms @ linear) / len(now)
    return Narx(arx, sizes, linear + np.linalg.solve(products, right) / size)


def _error(model: Arx | Narx, cut: Cut, runs: Sequence[Run | None]) -> tuple[float, Array]:
    """NRMSE over the scored rows of windows, and the readings; where none can be made, the mean."""
    y, scored = cut.y, cut.good & ~cut.started()
    simulated = np.array([float(np.mean(y[cut.good]))] * len(y))
    kept = [(rows, run) for rows, run in zip(cut.slices, runs, strict=True) if run is not None]
    for (rows, run), own in zip(kept, model.simulated([run for _, run in kept]) if kept else [], strict=True):
        simulated[rows] = np.interp(np.arange(rows.stop - rows.start), run.rows, own)
    return nrmse([(y[p], simulated[p], scored[p]) for p in cut.slices]), simulated
