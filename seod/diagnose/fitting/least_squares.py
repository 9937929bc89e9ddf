"""Least squares of simulated windows to measured ones, each with an initial state of its own.

What is minimised is the mean of the windows' log squared errors, so that one bad window has no veto: Gauss
and Newton with Levenberg's and Marquardt's damping, each window weighted by its own error. Initial states are
eliminated by small normal equations (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seod.diagnose.fitting.backlash_jumps import Softness, jumps, smooth, softness
from seod.diagnose.fitting.normal_equations import Normal, Table
from seod.diagnose.fitting.simulate import (
    LOOSE,
    POSITION,
    PRESSURE,
    VELOCITY,
    loosest,
    moves_alike_everywhere,
)
from seod.diagnose.record.coarse_sensor import beyond
from seod.diagnose.tuning.fitting import FIT
from sim.physics import dry_friction

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from seod.diagnose.fitting.model import Model
    from seod.diagnose.fitting.work import ParallelMap
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Array, Mask


@dataclass(frozen=True, slots=True)
class Fitted:
    """A model fitted to windows.

    Attributes:
        model: It.
        cut: The windows.
        x: Searched numbers, shape (p,).
        start: Initial states, shape (w, 7).
        error: Mean squared error of each window, shape (w,).
        cost: Mean of the windows' log squared errors, by rows.
    """

    model: Model
    cut: Cut
    x: Array
    start: Array
    error: Array
    cost: float

    @property
    def excess(self) -> float:
        """Geometric mean of the windows' squared errors over the noise's."""
        weights = self.cut.sizes / self.cut.sizes.sum()
        return float(np.exp(self.cost - weights @ np.log(self.cut.noise**2)))


def fit(
    model: Model,
    cut: Cut,
    x: Array,
    start: Array,
    most: int = FIT.most_steps,
    parallel: ParallelMap = map,
    free: Mask | None = None,
    ended: Callable[[], bool] = lambda: False,
    enough: float = FIT.least_improvement,
) -> Fitted:
    """Search from `x` and initial states `start`.

    `free` tells which numbers are searched, None: all; `ended` is asked before each step, and one that
    improves the mean log squared error by less than `enough` is the last.
    """
    free = np.ones(len(x), np.bool_) if free is None else free
    search = LeastSquares(model, cut, parallel, free)
    if cut.coarse and most > 1:
        near = LeastSquares(model, rounded(cut), parallel, free).run(x, start, most // 2, ended)
        most -= most // 2
        if search.costs(near.x, near.start) < search.costs(x, start):
            x, start = near.x, near.start
    return search.run(x, start, most, ended, enough)


class Place(NamedTuple):
    """Where a search is.

    Attributes:
        x: Searched numbers, shape (p,).
        start: Initial states, shape (w, 7).
        residual: Where there are samples, shape (n,).
        error: Mean squared error of each window, shape (w,).
    """

    x: Array
    start: Array
    residual: Array
    error: Array


class LeastSquares:
    """A search under way: what is measured, and what is free."""

    def __init__(self, model: Model, cut: Cut, parallel: ParallelMap, free: Mask) -> None:
        self.model, self.cut, self.parallel = model, cut, parallel
        self.y, self.good, self.slices = cut.y, cut.good, cut.slices
        self.count = np.array([np.count_nonzero(self.good[rows]) for rows in self.slices])
        self.floor = least_square(cut)
        self.soft: Softness | None = None
        low, high = model.bounds
        self.low, self.high = low, high
        self.free = np.flatnonzero(free & (low < high))
        self.reach = np.array(
            [FIT.largest_log_step if c.logarithm else FIT.largest_linear_step for c in model.coordinates]
        )
        self._last: tuple[Array, NDArray[np.void]] | None = None

    def run(
        self,
        x: Array,
        start: Array,
        most: int,
        ended: Callable[[], bool] = lambda: False,
        enough: float = FIT.least_improvement,
    ) -> Fitted:
        """At most so many steps from searched numbers and initial states."""
        at = Place(x, start, *self.tried(x, start))
        damping = FIT.first_damping
        for _ in range(most):
            if ended():
                break
            if jumps(self.kernel_parameters(at.x)):
                self.soft = softness(self.kernel_parameters(at.x), self.cut, at.start)
                at = Place(at.x, at.start, *self.tried(at.x, at.start))
            before = self.cost(at.error)
            parts = self.derivatives(*at)
            if len(self.free) and self._hardly_promises(parts, enough):
                break
            bounds = np.maximum(self.low - at.x, -self.reach), np.minimum(self.high - at.x, self.reach)
            for _ in range(FIT.dampings_tried if self.soft is None else FIT.dampings_tried_softened):
                found = self.stepped(parts, at, damping, bounds)
                if found is not None or ended():
                    break
                damping *= FIT.damping_factor
            if found is None:
                break
            at, damping = found, max(damping / FIT.damping_factor, FIT.least_damping)
            if before - self.cost(at.error) < enough:
                break
        if self.soft is not None:
            self.soft = None
            at = at._replace(error=self.tried(at.x, at.start)[1])
        return Fitted(self.model, self.cut, at.x, at.start, at.error, self.cost(at.error))

    def _hardly_promises(self, parts: Normal, enough: float) -> bool:
        """Whether no step saves a good part of what is enough of the mean log squared error.

        Not of initial states alone: how they are settled shows in the sixth digit of held-out errors.
        """
        return parts.promise() < FIT.promised_part * enough * float(self.count.sum())

    def stepped(self, parts: Normal, at: Place, damping: float, bounds: tuple[Array, Array]) -> Place | None:
        """Where a step leads; None: nowhere better.

        Where the bent step worsens things, the initial states that belong to the straight one are looked for:
        they do not change in proportion where friction holds the load.
        """
        straight = parts.step(damping, *bounds)
        better = self.better(at, *self.bent(straight, parts, at, damping, bounds))
        if better is not None or not len(self.free):
            return better
        x, start = at.x + straight[0], at.start + straight[1]
        start = settle(self.model, self.cut, x, start, self.good, FIT.settling_steps)
        settled = Place(x, start, *self.tried(x, start))
        return settled if self.cost(settled.error) < self.cost(at.error) else None

    def bent(
        self,
        straight: tuple[Array, Array],
        parts: Normal,
        at: Place,
        damping: float,
        bounds: tuple[Array, Array],
    ) -> tuple[Array, Array]:
        """A step along the bend of the valley: with the second derivative in its own direction.

        Geodesic acceleration: Transtrum, Sethna, arXiv:1201.5885. Straight where it is no small correction.
        """
        step, states = straight
        if not step.any():
            return straight
        ahead, _ = self.tried(at.x + FIT.ahead * step, at.start + FIT.ahead * states)
        second = (2.0 / FIT.ahead) * ((at.residual - ahead) / FIT.ahead - parts.along(step, states))
        turn, moved = parts.step(damping, *bounds, right=parts.projected(-0.5 * second))
        if not parts.length(turn) < FIT.bend * parts.length(step):
            return straight
        return np.clip(step + turn, *bounds), states + moved

    def cost(self, error: Array) -> float:
        """Mean log squared error; 0 where no row counts."""
        return float(self.count @ np.log(error + self.floor)) / max(float(self.count.sum()), 1.0)

    def costs(self, x: Array, start: Array) -> float:
        """Mean log squared error of searched numbers and initial states."""
        return self.cost(self.tried(x, start)[1])

    def kernel_parameters(self, x: Array) -> NDArray[np.void]:
        """The kernel's parameters; those asked for last are kept."""
        if self._last is None or not np.array_equal(x, self._last[0]):
            self._last = x.copy(), self.model.kernel_parameters(x)
        return self._last[1]

    def tried(self, x: Array, start: Array) -> tuple[Array, Array]:
        """Residual where there are samples, and each window's mean squared error."""
        residual = np.where(self.good, _weighted(self.kernel_parameters(x), self.cut, start, self.soft), 0.0)
        square = np.array([float(residual[rows] @ residual[rows]) for rows in self.slices])
        return residual, square / np.maximum(self.count, 1)

    def better(self, at: Place, step: Array, states: Array) -> Place | None:
        """After a step of the numbers and one of the initial states, if it is an improvement.

        A window that its new initial state makes worse goes a part of the way there, or keeps the old one.
        """
        x = at.x + step
        new, residual, now = self.moved(x, at.start, states, 1.0)
        for part in (FIT.state_part, 0.0):
            worse = ~(now < at.error)
            if not worse.any():
                break
            less, other, then = self.moved(x, at.start, states, part)
            for w in np.flatnonzero(worse & (then < now)):
                new[w], now[w] = less[w], then[w]
                residual[self.slices[w]] = other[self.slices[w]]
        return Place(x, new, residual, now) if self.cost(now) < self.cost(at.error) else None

    def moved(self, x: Array, start: Array, states: Array, part: float) -> tuple[Array, Array, Array]:
        """Initial states after a part of their step, with residual and errors."""
        new = start + part * states
        new[:, LOOSE] = np.clip(new[:, LOOSE], 0.0, loosest(self.kernel_parameters(x)))
        return new, *self.tried(x, new)

    def derivatives(
        self, x: Array, start: Array, residual: Array, error: Array, beside: Array | None = None
    ) -> Normal:
        """Normal equations of all windows.

        Numbers of what is `beside` the model, shape (n, k), follow the searched ones: each adds its column,
        and is anything of deviation 1.
        """
        states, sizes, record = self.model.states, self.model.state_sizes, self.kernel_parameters(x)
        ranges = np.full(len(sizes), np.inf)
        ranges[LOOSE] = loosest(record)
        sizes = np.minimum(sizes, FIT.state_step_part * ranges)
        steps = np.where(x + FIT.derivative_step > self.high, -FIT.derivative_step, FIT.derivative_step)
        shifts = POSITION in states and not self.cut.coarse and moves_alike_everywhere(record)
        moved = [column for column in states if not (shifts and column == POSITION)]
        trials = self._trials(x, start, moved, sizes, steps)
        others = self.parallel(lambda trial: _weighted(trial[0], self.cut, trial[1], self.soft), trials)
        divisors = [1.0] * len(moved) + [float(steps[k]) for k in self.free]
        columns = [
            np.where(self.good, (residual - r) / d, 0.0) for r, d in zip(others, divisors, strict=True)
        ]
        if shifts:
            shifted = self.cut.unforeseen(np.full(len(residual), sizes[POSITION]))
            columns.insert(states.index(POSITION), np.where(self.good, shifted, 0.0))
        free, unknowns, known = self.free, len(x), None
        if beside is not None:
            columns += [np.where(self.good, each, 0.0) for each in beside.T]
            known = np.r_[np.zeros(len(free)), np.ones(len(beside.T))]
            free, unknowns = np.r_[free, unknowns + np.arange(len(beside.T))], unknowns + len(beside.T)
        every = np.stack([*columns, residual], axis=1)
        if {PRESSURE, POSITION} <= set(states):
            self._hold_pressed(every, states, self._sticks(x, start))
        if LOOSE in states:
            self._hold(every, states.index(LOOSE), start[:, LOOSE], ranges[LOOSE])
        weights = 1.0 / (error + self.floor)
        products = [w * (every[rows].T @ every[rows]) for w, rows in zip(weights, self.slices, strict=True)]
        table = Table(every, weights, self.slices)
        prior = (sizes / ranges)[states] ** 2
        return Normal(np.array(products), states, sizes, free, unknowns, table, prior, known)

    def _trials(
        self, x: Array, start: Array, states: list[int], sizes: Array, steps: Array
    ) -> list[tuple[NDArray[np.void], Array]]:
        """Plants and initial states of which each one is changed: these states first, then free numbers."""
        record, trials, sticks = self.kernel_parameters(x), [], self._sticks(x, start)
        for column in states:
            moved = start.copy()
            moved[:, column] += sizes[column]
            if column == VELOCITY:  # a load that sticks has none: a little more would stop at once
                moved[sticks, column] = 0.0
            trials.append((record, moved))
        for k in self.free:
            other = x.copy()
            other[k] += steps[k]
            trials.append((self.model.kernel_parameters(other), start))
        return trials

    def _sticks(self, x: Array, start: Array) -> Mask:
        """Windows that begin with a load that sticks, shape (w,)."""
        return np.asarray((start[:, VELOCITY] == 0.0) & dry_friction(self.kernel_parameters(x)[0]))

    def _hold_pressed(self, every: Array, states: list[int], sticks: Mask) -> None:
        """Keep the pressure of windows whose load sticks at first, where it hardly shows.

        Its step would be as large as what is left over next to nothing, and would spoil the window's whole
        step: the place where the load sticks would never be fitted.
        """
        pressure, position = states.index(PRESSURE), states.index(POSITION)
        for w in np.flatnonzero(sticks):
            rows = every[self.slices[w]]
            shows, placed = (float(rows[:, k] @ rows[:, k]) for k in (pressure, position))
            if shows < FIT.hardly_shows * placed:
                rows[:, pressure] = 0.0

    def _hold(self, every: Array, k: int, loose: Array, most: float) -> None:
        """Keep windows whose looseness is at an end of its range there, where it would go beyond."""
        for w in np.flatnonzero((loose <= 0.0) | (loose >= most)):
            rows = every[self.slices[w]]
            further = np.linalg.lstsq(rows[:, : len(self.model.states)], rows[:, -1])[0][k]
            if (further < 0.0) == (loose[w] <= 0.0):
                rows[:, k] = 0.0


def rounded(cut: Cut) -> Cut:
    """The same, rounding as white noise: from afar it leads to the right place, not quite into it."""
    every = [
        replace(recording, slack=0.0, level=recording.noise, allowed=recording.noise)
        for recording in cut.series
    ]
    return replace(cut, series=every)


def least_square(cut: Cut) -> Array:
    """Of each window's mean squared error what makes no difference; a coarse sensor's may be none at all."""
    some = np.array([cut.series[k].slack > 0.0 for k, _, _ in cut.windows])
    part = np.where(some, FIT.negligible_coarse, FIT.negligible)
    return np.asarray((part * cut.noise) ** 2 + 1e-300)


def weighted(model: Model, cut: Cut, x: Array, start: Array) -> Array:
    """Residual, less where the reading jumps; shape (n,). Its square is finite."""
    return _weighted(model.kernel_parameters(x), cut, start, None)


def _weighted(record: NDArray[np.void], cut: Cut, start: Array, soft: Softness | None) -> Array:
    ramp, level = soft or Softness.least(cut)
    seen, more = smooth(record, cut, start, ramp)
    residual = cut.y - seen
    if cut.coarse:
        residual = beyond(residual, cut.slack)
    if more.any():
        residual /= np.sqrt(1.0 + more / np.repeat(level, cut.sizes) ** 2)
    return cut.unforeseen(np.fmin(np.fmax(residual, -1e100), 1e100))  # of what is no number, one of them


def settle(model: Model, cut: Cut, x: Array, start: Array, rows: Mask, most: int = FIT.states_steps) -> Array:
    """Initial states fitted to these `rows` only, the parameters given; shape (w, 7)."""
    search = LeastSquares(model, cut, map, np.zeros(len(x), np.bool_))
    search.good = search.good & rows
    search.count = np.array([np.count_nonzero(search.good[rows]) for rows in search.slices])
    return search.run(x, start, most).start
