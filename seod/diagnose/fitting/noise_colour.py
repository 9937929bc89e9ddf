"""The colour of what does not repeat: an autoregression, its order by windows that it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter, oaconvolve, sosfilt, zpk2sos

from seod.diagnose.record.memory import has_past, unforeseen
from seod.diagnose.tuning.fitting import NOISE_COLOUR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.result import Array, Mask


class Residual(Protocol):
    """What is left of one window: of each row how much, and whether the row counts; shape (n,)."""

    @property
    def error(self) -> Array:
        """Measured less simulated [unit of y]."""

    @property
    def scored(self) -> Mask:
        """Rows that count."""


@dataclass(frozen=True, slots=True)
class NoiseColour:
    """Noise as an autoregression.

    Attributes:
        memory: Coefficients, newest first; shape (order,), empty for white noise.
        sd: Standard deviation of the noise [unit of y].
        correlation: Correlation time [samples]: of so many samples one counts for a mean. 1 of white noise.
    """

    memory: tuple[float, ...]
    sd: float
    correlation: float

    @property
    def order(self) -> int:
        """Of the autoregression."""
        return len(self.memory)

    def whitened(self, x: Array) -> Array:
        """Rows of `x`, shape (n, ...), less what this noise would make of those before."""
        return unforeseen(x, self.memory)

    def ahead_of_white(self, white: Array, rows: int) -> Array:
        """Of what was whitened, shape (n, ...), what noise does not make of rows so many before."""
        response = self._remembered(np.eye(rows, 1))
        return np.asarray(oaconvolve(white, response, axes=0)[: len(white)])

    def drawn(self, n: int, count: int, random: np.random.Generator) -> Array:
        """Such noises; shape (n, count)."""
        return self._remembered(random.normal(size=(2 * n, count)))[n:]

    def _remembered(self, white: Array) -> Array:
        """The noise that white noise, shape (n, count), makes.

        None grows: roots outside of the unit circle are taken onto it. By second-order sections: a polynomial
        of many roots is not what its roots were.
        """
        roots = np.roots(np.r_[1.0, -np.array(self.memory)])
        steady = roots / np.maximum(np.abs(roots), 1.0)
        if not len(steady):
            return white
        return np.asarray(sosfilt(zpk2sos(np.zeros(len(steady)), steady, 1.0), white, axis=0))

    def has_past(self, scored: Mask) -> Mask:
        """Rows that count, and all those before each by which it is foretold; shape (n,)."""
        return has_past(scored, self.order)


WHITE: Final = NoiseColour((), 1.0, 1.0)


def colour(parts: Sequence[Residual], longest: Sequence[int] = NOISE_COLOUR.longest) -> NoiseColour:
    """Of what is left of windows; each second one is foretold by a fit of the others, and the reverse.

    Noise of a load below a sensor's own is an autoregression of many rows: the sensor's hides in each what
    the load has moved. Noise of a sensor alone is one of few, so that many are not always tried.
    Rows are foretold by their neighbours only, not across rows that do not count. Where so few neighbours are
    left that nothing can be foretold it is white.

    Args:
        parts: What is left.
        longest: Orders up to which it is looked for, one after the other.
    """
    windows = [_segments(one) for one in parts]
    runs = [run for window in windows for run in window]
    sd = math.sqrt(sum(float(run @ run) for run in runs) / sum(map(len, runs)))
    memory = np.empty(0)
    for most in longest if sd > 0.0 else ():
        if len(memory) and most * len(runs) > NOISE_COLOUR.given_up * sum(map(len, runs)):
            break
        memory = _memory(windows, most)
        if 2 * len(memory) <= most:
            break
    return NoiseColour(tuple(memory.tolist()), sd, _correlation(memory))


def _memory(windows: Sequence[Sequence[Array]], longest: int) -> Array:
    """Coefficients, no more than `longest`."""
    halves = (windows[::2], windows[1::2]) if len(windows) > 1 else _halved(windows[0])
    fewest = min(sum(_count(window, longest) for window in half) for half in halves)
    most = min(longest, fewest // NOISE_COLOUR.rows_each - 1)
    both = [[run for window in half for run in window if len(run) > longest] for half in halves]
    if most < 1 or not all(both):
        return np.empty(0)
    first, second = (_Triangle.of(half, longest) for half in both)
    best, least = 0, math.inf
    for order in (each for each in NOISE_COLOUR.orders if each <= most):
        cost = sum(other.cost(one.memory(order)) for one, other in ((first, second), (second, first)))
        if cost < least - NOISE_COLOUR.enough:
            best, least = order, cost
    return first.with_rows_of(second).memory(best)


def _segments(one: Residual) -> list[Array]:
    """What is left of a window but for its mean, cut where rows between neighbours do not count.

    Neighbours of a sensor that repeats its readings are as far apart as these last.
    """
    rows = np.flatnonzero(one.scored)
    left, steps = one.error[rows] - np.mean(one.error[rows]), np.diff(rows)
    holes = steps >= 2.0 * np.median(steps) if len(steps) else []
    return np.split(left, np.flatnonzero(holes) + 1)


def _count(window: Sequence[Array], longest: int) -> int:
    """Rows of a window, less those that holes leave without all of their past."""
    *others, most = sorted(map(len, window))
    return most + sum(max(0, each - longest) for each in others)


def _halved(window: Sequence[Array]) -> tuple[list[list[Array]], list[list[Array]]]:
    """One window as two."""
    sizes = [len(run) for run in window]
    begins = np.cumsum([0, *sizes[:-1]])
    pairs = [np.split(run, [max(0, sum(sizes) // 2 - at)]) for run, at in zip(window, begins, strict=True)]
    return [[first for first, _ in pairs]], [[second for _, second in pairs]]


@dataclass(frozen=True, slots=True)
class _Triangle:
    """Rows, each after its past, as the triangle of their QR factors: fits of all orders are in it.

    Attributes:
        factor: Columns are samples so many rows before, nearest first, and last the sample that follows.
        rows: How many.
    """

    factor: Array
    rows: int

    @classmethod
    def of(cls, runs: Sequence[Array], longest: int) -> _Triangle:
        factor, rows = np.empty((0, longest + 1)), 0
        for run in runs:
            newest_first = sliding_window_view(run, longest + 1)[:, ::-1]
            rows += len(newest_first)
            for first in range(0, len(newest_first), NOISE_COLOUR.at_once):
                block = np.roll(newest_first[first : first + NOISE_COLOUR.at_once], -1, axis=1)
                factor = _triangular(np.vstack([factor, block]))
        return cls(factor, rows)

    def with_rows_of(self, other: _Triangle) -> _Triangle:
        """Of the rows of both."""
        both = np.vstack([self.factor, other.factor])
        return _Triangle(_triangular(both), self.rows + other.rows)

    def memory(self, order: int) -> Array:
        """Coefficients of least squares, newest first; shape (order,)."""
        past, now = self.factor[:, :order], self.factor[:, -1]
        return np.asarray(np.linalg.lstsq(past, now)[0]) if order else np.empty(0)

    def cost(self, memory: Array) -> float:
        """Negative log likelihood of the samples with the variance that is their own, but for a constant."""
        error = self.factor[:, -1] - self.factor[:, : len(memory)] @ memory
        return 0.5 * self.rows * math.log(max(float(error @ error) / self.rows, 1e-300))


def _triangular(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _correlation(memory: Array) -> float:
    """Spectrum at 0 over the variance, by the impulse response."""
    if not len(memory):
        return 1.0
    steady = 1.0 - float(memory.sum())
    poles = np.roots(np.r_[1.0, -memory])
    slowest = float(np.max(np.abs(poles)))
    if slowest >= 1.0 or steady <= 0.0:
        return math.inf
    length = min(NOISE_COLOUR.most_rows, math.ceil(NOISE_COLOUR.decays / (1.0 - slowest)))
    response = lfilter([1.0], np.r_[1.0, -memory], np.eye(1, length)[0])
    return max(1.0, 1.0 / steady**2 / float(response @ response))
