"""An ARX whose weights change with position, speed or its change: a linear model with scheduled gains.

Bamieh and Giarre, Int. J. of Robust and Nonlinear Control 12, 2002. What it changes with, how often and its
order are those with which parts of the windows are simulated best by fits of the others.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.account import steps
from seod.diagnose.account.arx import farthest, fitted_arx, past_of, side_by_side
from seod.diagnose.tuning.account import SCHEDULED, YARDSTICK

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from seod.diagnose.account.arx import Arx, Run
    from seod.diagnose.result import Array, Rows

STATES: Final = ("position", "speed", "change of speed")
"""That weights may change with."""


class Form(NamedTuple):
    """What weights change with.

    Attributes:
        linear: The ARX whose terms have such weights; of a position by its changes.
        by: Which of `STATES`.
        knots: Values of it, ascending, between which weights run straight, shape (k,).
    """

    linear: Arx
    by: int
    knots: Array

    @property
    def reach(self) -> int:
        """Samples that a step looks back."""
        return max(self.linear.order + 1, len(STATES))

    def terms(self, y: Array, u: Array, place: Array, at: Rows) -> Array:
        """Each linear term times the nearness of each knot, shape (n, columns)."""
        past, near = past_of(y, u, at, self.linear), steps.nearness(self.state(y, place, at), self.knots)
        count = past.shape[1] * near.shape[1]
        return np.asarray((past[:, :, None] * near[:, None, :]).reshape(len(past), count))

    def state(self, y: Array, place: Array, at: Rows) -> Array:
        """The value that weights change with, before samples `at`, shape (n,)."""
        return np.asarray(steps.states(y[:, None], place[:, None], at, self.by, self.linear.integrates))


class ScheduledArx(NamedTuple):
    """A form with its weights, shape (columns,), or of each window, shape (w, columns)."""

    form: Form
    weights: Array

    def simulated(self, runs: Sequence[Run]) -> list[Array]:
        """Windows from their first samples as measured, side by side."""
        form, linear = self.form, self.form.linear
        y, u, place = (side_by_side(some) for some in zip(*((r.y, r.u, r.place) for r in runs), strict=True))
        shape = len(runs), 2 * linear.order + 2, len(form.knots)
        weights = np.broadcast_to(self.weights, (len(runs), self.weights.shape[-1])).reshape(shape)
        how = linear.order, form.by, linear.integrates, form.reach
        ticks = np.array([run.tick for run in runs])
        steps.simulate_scheduled(y, u, place, weights, form.knots, *how, ticks, farthest(runs))
        return [y[: len(run.y), w] for w, run in enumerate(runs)]


class Scheduled(NamedTuple):
    """The form that foretells parts of the windows best.

    Attributes:
        model: Fitted to all of them.
        parts: Of each its window, its samples, and what a fit of others simulates, shape (n,).
        squared: Mean squared error of the latter.
    """

    model: ScheduledArx
    parts: list[tuple[int, Run, Array]]
    squared: float


def fitted_scheduled_arx(
    runs: Sequence[Run | None], *, sees_speed: bool, tells_its_place: bool
) -> Scheduled | None:
    """None where windows have too few samples."""
    of, parts = _parts(runs)
    best: Scheduled | None = None
    for form in _forms(parts, sees_speed=sees_speed, tells_its_place=tells_its_place):
        products = np.array([_products(form, part) for part in parts])
        total, fold = products.sum(axis=0), np.arange(len(parts)) % SCHEDULED.folds
        # not `total` less its own: of a term that only one fold has, rounding would be left
        unseen = [products[fold != k].sum(axis=0) for k in range(int(fold.max()) + 1)]
        ridges, count = YARDSTICK.ridges, len(parts)
        others = np.concatenate([[_solved(rest, ridge) for rest in unseen] for ridge in ridges])
        each = (np.arange(len(ridges))[:, None] * len(unseen) + fold).ravel()
        every = ScheduledArx(form, others[each]).simulated(parts * len(ridges))
        for k, ridge in enumerate(ridges):
            simulated = every[k * count : (k + 1) * count]
            error = _squared(parts, simulated)
            if best is None or error < best.squared:
                told = list(zip(of, parts, simulated, strict=True))
                best = Scheduled(ScheduledArx(form, _solved(total, ridge)), told, error)
    return best


def _forms(parts: Sequence[Run], *, sees_speed: bool, tells_its_place: bool) -> Iterator[Form]:
    rows = sum(len(part.y) for part in parts)
    every = [fitted_arx(parts, order, not sees_speed) for order in YARDSTICK.orders] if parts else []
    for linear in (one for one in every if one is not None):
        for by in range(0 if tells_its_place else 1, len(STATES)):
            form = Form(linear, by, np.empty(0))
            values = [form.state(p.y, p.place, np.arange(form.reach, len(p.y))) for p in parts]
            low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
            for count in SCHEDULED.knots:
                if low < high and rows > YARDSTICK.rows_each * count * (2 * linear.order + 2):
                    yield form._replace(knots=np.linspace(low, high, count))


def _parts(runs: Sequence[Run | None]) -> tuple[list[int], list[Run]]:
    """Windows, or parts of them: as many as there are folds at least; which window each is of."""
    every = [(w, run) for w, run in enumerate(runs) if run is not None]
    total = sum(len(run.y) for _, run in every)
    long = min(SCHEDULED.most_rows, max(SCHEDULED.fewest_rows, total / SCHEDULED.folds))
    of, out = [], []
    for w, run in every[:: max(1, math.ceil(total / SCHEDULED.rows))]:
        for rows in np.array_split(np.arange(len(run.y)), max(1, round(len(run.y) / long))):
            if len(rows) >= SCHEDULED.fewest_rows:
                first = np.arange(len(rows)) < SCHEDULED.begin * len(rows)
                kept = run.y[rows], run.u[rows], run.good[rows], first, run.rows[rows], run.place[rows]
                of.append(w)
                out.append(type(run)(*kept, run.tick))
    return (of, out) if len(out) > 1 else ([], [])


def _products(form: Form, part: Run) -> Array:
    """Of the terms and the sample, or its change, each with each."""
    at = np.arange(form.reach, len(part.y))
    at = at[np.logical_and.reduce([part.good[at - k] for k in range(form.reach + 1)])]
    now = part.y[at] - (part.y[at - 1] if form.linear.integrates else 0.0)
    columns = np.column_stack([form.terms(part.y, part.u, part.place, at), now])
    return np.asarray(columns.T @ columns)


def _solved(products: Array, ridge: float) -> Array:
    size = np.sqrt(np.maximum(products.diagonal()[:-1], 1e-300))
    scaled = products[:-1, :-1] / np.outer(size, size) + ridge * np.eye(len(size))
    return np.asarray(np.linalg.solve(scaled, products[:-1, -1] / size) / size)


def _squared(parts: Sequence[Run], simulated: Sequence[Array]) -> float:
    """Mean squared error of parts, beyond their beginning."""
    pairs = zip(parts, simulated, strict=True)
    return float(np.mean(np.concatenate([(one.y - y)[one.good & ~one.first] ** 2 for one, y in pairs])))
