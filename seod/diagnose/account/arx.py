"""Windows with fewer samples, and a linear model of them that knows no physics."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import lfilter, lfiltic

from seod.diagnose.account import steps
from seod.diagnose.tuning.account import YARDSTICK

if TYPE_CHECKING:
    from collections.abc import Sequence

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
        place: Position, or the integral of a speed, likewise [unit].
        tick: Between two samples [s].
    """

    y: Array
    u: Array
    good: Mask
    first: Mask
    rows: Array
    place: Array
    tick: float


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


def runs_of(cut: Cut, stride: int) -> list[Run | None]:
    """Each window with a sample for so many rows; None where few are left."""
    out: list[Run | None] = []
    y, u, good, started = cut.y, cut.gathered("u"), cut.good, cut.started()
    places = [one.travelled if one.sees_speed else one.y for one in cut.series]
    for (k, begin, _), rows in zip(cut.windows, cut.slices, strict=True):
        count = (rows.stop - rows.start) // stride
        kept = slice(rows.start, rows.start + count * stride)
        place = places[k][begin : begin + count * stride]
        of = y[kept], u[kept], good[kept], started[kept], place, cut.series[k].tick
        out.append(_run(*of, stride) if count >= YARDSTICK.fewest else None)
    return out


def _run(y: Array, u: Array, good: Mask, started: Mask, place: Array, tick: float, stride: int) -> Run | None:
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
        place.reshape(shape).mean(axis=1),
        tick * stride,
    )


def past_of(y: Array, u: Array, at: Rows, arx: Arx) -> Array:
    """What a linear model foretells samples `at` by, shape (n, columns)."""
    return np.asarray(steps.past_of(y[:, None], u[:, None], at, arx.order, arx.integrates))


def rows_of(runs: Sequence[Run | None], arx: Arx) -> tuple[Array, Array]:
    """Of all windows, the past of each sample and the sample, or its change."""
    first, past, now = arx.order + arx.integrates, [], []
    for run in runs:
        if run is None or len(run.y) <= first:
            continue
        at = np.arange(first, len(run.y))
        good = np.logical_and.reduce([run.good[at - k] for k in range(first + 1)])
        at = at[good]
        past.append(past_of(run.y, run.u, at, arx))
        now.append(run.y[at] - (run.y[at - 1] if arx.integrates else 0.0))
    return (np.concatenate(past), np.concatenate(now)) if past else (np.empty((0, 1)), np.empty(0))


def fitted_arx(runs: Sequence[Run | None], order: int, integrates: bool) -> Arx | None:
    """By least squares one step ahead; None where samples are few, or it is not stable."""
    empty = Arx(order, integrates, np.empty(0))
    past, now = rows_of(runs, empty)
    if len(now) < YARDSTICK.rows_each * (2 * order + 2):
        return None
    weights = np.asarray(np.linalg.lstsq(past, now, rcond=1e-10)[0])
    if not np.all(np.isfinite(weights)):
        return None
    poles = np.roots(np.r_[1.0, -weights[:order]])
    return empty._replace(weights=weights) if np.all(np.abs(poles) < 1.0 + YARDSTICK.unstable) else None


def side_by_side(some: Sequence[Array]) -> Array:
    """As columns, the last values of shorter ones again; shape (longest, w)."""
    longest = max(len(one) for one in some)
    return np.column_stack([np.r_[one, np.full(longest - len(one), one[-1])] for one in some])


def farthest(runs: Sequence[Run]) -> Array:
    """Readings at which a simulation of each window is held: it has run away; shape (w,)."""
    return np.array([YARDSTICK.gone_beyond * np.ptp(run.y) + np.max(np.abs(run.y)) for run in runs])
