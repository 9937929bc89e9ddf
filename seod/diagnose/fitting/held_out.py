"""How well a fitted model simulates what it was not fitted to, as the contract has it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seod.diagnose.fitting.backlash_jumps import sure
from seod.diagnose.fitting.initial_states import measured_places, simulated_states
from seod.diagnose.fitting.least_squares import least_square, settle, weighted
from seod.diagnose.fitting.simulate import POSITION, inside, simulate
from seod.diagnose.record.coarse_sensor import beyond
from seod.diagnose.record.windows import Cut, hardly_settle, one_window_each
from seod.diagnose.tuning.fitting import HELD_OUT
from seod.diagnose.tuning.record import WINDOWS

if TYPE_CHECKING:
    from seod.diagnose.fitting.model import Model
    from seod.diagnose.result import Array, Mask, Rows


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A model's simulation of windows; arrays end to end, shape (n,), but as said.

    Attributes:
        cut: The windows.
        simulated: As measured.
        states: `sim.windows.INSIDE`, shape (n, 5).
        start: Initial states, shape (w, 7).
        scored: Rows that count: samples after the window's first fifth.
        sure: Rows that hang on no jump; only of these it is asked whether more than noise is left.
    """

    cut: Cut
    simulated: Array
    states: Array
    start: Array
    scored: Mask
    sure: Mask

    @property
    def error(self) -> Array:
        """Measured minus simulated, as far as it says anything."""
        error = beyond(self.cut.y - self.simulated, self.cut.slack)
        return np.clip(np.nan_to_num(error, nan=1e150), -1e150, 1e150)

    @property
    def square(self) -> Array:
        """Mean squared error of each window, shape (w,)."""
        asked, error = self.scored & self.sure, self.error
        error = np.where(asked, error, 0.0)
        return np.array([float(error[p] @ error[p]) / max(int(asked[p].sum()), 1) for p in self.cut.slices])

    @property
    def rms(self) -> float:
        """Of the errors, as far as they say anything [unit]: rounding, which `nrmse` counts, says nothing."""
        return float(np.sqrt(np.mean(self.error[self.scored] ** 2)))

    @property
    def counts(self) -> Rows:
        """Rows of each window that count, shape (w,)."""
        return np.array([self.scored[p].sum() for p in self.cut.slices])

    @property
    def adequacy(self) -> float:
        """Mean squared error over the noise's: 1 where nothing but noise is left."""
        return float(self.counts @ (self.square / self.cut.allowed**2) / self.counts.sum())

    @property
    def log_error(self) -> float:
        """Mean log squared error of the windows: where it is 0.01 less, the error is half a percent less."""
        return float(np.mean(np.log(self.square + least_square(self.cut))))

    @property
    def nrmse(self) -> float:
        """As in the contract."""
        y = self.cut.y
        return nrmse([(y[p], self.simulated[p], self.scored[p]) for p in self.cut.slices])

    @property
    def floor(self) -> float:
        """NRMSE of a perfect model."""
        y = self.cut.y
        noisy = sum(s**2 * count for s, count in zip(self.cut.floor, self.counts, strict=True))
        return math.sqrt(noisy / max(_spread([(y[p], self.scored[p]) for p in self.cut.slices]), 1e-300))


def nrmse(windows: list[tuple[Array, Array, Mask]]) -> float:
    """sqrt(sum e^2 / sum (y - mean)^2) of (measured, simulated, which rows count), mean per window."""
    error = sum(float(np.sum((y - s)[scored] ** 2)) for y, s, scored in windows)
    spread = _spread([(y, scored) for y, _, scored in windows])
    return math.sqrt(error / spread) if spread > 0.0 and math.isfinite(error) else math.inf


def _spread(windows: list[tuple[Array, Mask]]) -> float:
    return sum(float(np.sum((y[scored] - np.mean(y[scored])) ** 2)) for y, scored in windows if scored.any())


def simulate_held_out(model: Model, x: Array, cut: Cut, *near: Array) -> HeldOut:
    """Simulate windows from initial states fitted to the first fifth of each.

    Of several fits, from the simulation of the whole recording and from `near`, each window takes what fits
    its first fifth best. Where that has too few rows, windows are those of one run of the whole recording.
    """
    if hardly_settle(cut):
        return _in_one_run(model, x, cut)
    first = cut.started() & cut.good
    record, best = model.kernel_parameters(x), None
    for begin in (simulated_states(model, x, cut), *near):
        start = settle(model, cut, x, begin, first)
        error = np.where(first, weighted(model, cut, x, start), 0.0)
        square = np.array([float(error[p] @ error[p]) for p in cut.slices])
        if best is None:
            best, least = start, square
        else:
            better = square < least
            best[better], least[better] = start[better], square[better]
    assert best is not None  # noqa: S101 - the first is always there
    simulated, states = inside(record, cut, best)
    scored = cut.good & ~cut.started()
    return HeldOut(cut, simulated, states, best, scored, sure(record, cut, simulated, states))


def _in_one_run(model: Model, x: Array, cut: Cut) -> HeldOut:
    """Windows of one run of each recording, whose initial state is fitted to rows that are not held out.

    Of a recording that is held out altogether it is fitted to the first fifth of the first window.
    """
    ends = [len(one.t) for one in cut.series]
    every = Cut(cut.series, one_window_each(cut.series))
    rows = every.good & np.concatenate([_settles(cut, k) for k in range(len(ends))])
    start = settle(model, every, x, measured_places(every), rows)
    record = model.kernel_parameters(x)
    simulated, states = inside(record, every, start)
    begins = np.concatenate([[0], np.cumsum(ends)])
    at = np.concatenate([np.arange(begins[k] + a, begins[k] + b) for k, a, b in cut.windows])
    begun = measured_places(cut)
    begun[:, : POSITION + 1] = states[[begins[k] + a for k, a, _ in cut.windows], : POSITION + 1]
    clear = sure(record, every, simulated, states)
    scored = cut.good & ~cut.started()
    return HeldOut(cut, simulated[at], states[at], begun, scored, clear[at])


def _settles(cut: Cut, k: int) -> Mask:
    """Rows of a series to which the initial state of one run is fitted."""
    one = cut.series[k]
    seen = np.ones(len(one.t), np.bool_)
    for of, first, last in cut.windows:
        seen[first:last] &= of != k
    begins = one.t - one.t[0] < WINDOWS.settling_part * one.window_s
    return seen if np.count_nonzero(seen) > HELD_OUT.rows_to_settle * len(seen) else begins


def whole(model: Model, x: Array, cut: Cut, k: int) -> tuple[Array, Mask]:
    """One simulation of a whole series, and which rows of it count: those after its first windows' fifth."""
    one = cut.series[k]
    every = Cut(cut.series, ((k, 0, len(one.t)),))
    first = one.good & (one.t - one.t[0] < WINDOWS.settling_part * one.window_s - WINDOWS.at_edge * one.tick)
    begun = Cut(cut.series, ((k, 0, int(np.max(np.flatnonzero(first), initial=1)) + 1),))
    start = settle(model, begun, x, measured_places(every), first[: begun.windows[0][2]])
    return simulate(model.kernel_parameters(x), every, start), one.good & ~first


def wholes(model: Model, x: Array, cut: Cut) -> tuple[list[Array], float, bool]:
    """Of each series the simulation; NRMSE of them all; whether one of them left its recording."""
    simulated, scored, diverged = [], [], False
    for k, one in enumerate(cut.series):
        y, counts = whole(model, x, cut, k)
        off = np.abs(y - one.y)[counts]
        diverged |= not bool(np.all(off < HELD_OUT.diverged * np.ptp(one.y[one.good])))
        simulated.append(y)
        scored.append((one.y, y, counts))
    return simulated, nrmse(scored), diverged
