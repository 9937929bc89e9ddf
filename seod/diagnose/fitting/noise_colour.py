"""The colour of what does not repeat: an autoregression, its order by windows that it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from scipy.signal import lfilter

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

    def drawn(self, n: int, count: int, random: np.random.Generator) -> Array:
        """Such noises; shape (n, count)."""
        roots = np.roots(np.r_[1.0, -np.array(self.memory)])
        poles = np.real(np.poly(roots / np.maximum(np.abs(roots), 1.0)))  # none that grows
        return np.asarray(lfilter([1.0], poles, random.normal(size=(2 * n, count)), axis=0)[n:])

    def has_past(self, scored: Mask) -> Mask:
        """Rows that count, and all those before each by which it is foretold; shape (n,)."""
        return has_past(scored, self.order)


WHITE: Final = NoiseColour((), 1.0, 1.0)


def colour(parts: Sequence[Residual]) -> NoiseColour:
    """Of what is left of windows; each second one is foretold by a fit of the others, and the reverse.

    Rows are foretold by their neighbours only, not across rows that do not count. Where so few neighbours are
    left that nothing can be foretold it is white.
    """
    windows = [_segments(one) for one in parts]
    runs = [run for window in windows for run in window]
    sd = math.sqrt(sum(float(run @ run) for run in runs) / sum(len(run) for run in runs))
    halves = (windows[::2], windows[1::2]) if len(windows) > 1 else _halved(windows[0])
    most = min(
        NOISE_COLOUR.longest,
        min(sum(map(_count, half)) for half in halves) // NOISE_COLOUR.rows_each - 1,
    )
    both = [[run for window in half for run in window] for half in halves]
    if not sd > 0.0 or most < 1 or not all(map(_long, both)):
        return NoiseColour((), sd, 1.0)
    best, least = 0, math.inf
    for order in range(most + 1):
        cost = sum(
            _minus_log_likelihood(_regressed(one, order), other, order) for one, other in (both, both[::-1])
        )
        if cost < least - NOISE_COLOUR.enough:
            best, least = order, cost
    return NoiseColour(tuple(_regressed(runs, best).tolist()), sd, _correlation(_regressed(runs, best)))


def _segments(one: Residual) -> list[Array]:
    """What is left of a window but for its mean, cut where rows between neighbours do not count.

    Neighbours of a sensor that repeats its readings are as far apart as these last.
    """
    rows = np.flatnonzero(one.scored)
    left, steps = one.error[rows] - np.mean(one.error[rows]), np.diff(rows)
    holes = steps >= 2.0 * np.median(steps) if len(steps) else []
    return np.split(left, np.flatnonzero(holes) + 1)


def _count(window: Sequence[Array]) -> int:
    """Rows of a window, less those that holes leave without all of their past."""
    *others, longest = sorted(map(len, window))
    return longest + sum(max(0, each - NOISE_COLOUR.longest) for each in others)


def _halved(window: Sequence[Array]) -> tuple[list[list[Array]], list[list[Array]]]:
    """One window as two."""
    sizes = [len(run) for run in window]
    begins = np.cumsum([0, *sizes[:-1]])
    pairs = [np.split(run, [max(0, sum(sizes) // 2 - at)]) for run, at in zip(window, begins, strict=True)]
    return [[first for first, _ in pairs]], [[second for _, second in pairs]]


def _long(runs: Sequence[Array]) -> list[Array]:
    """Those in which a row has all of its past."""
    return [run for run in runs if len(run) > NOISE_COLOUR.longest]


def _rows(runs: Sequence[Array], order: int) -> tuple[Array, Array]:
    """Earlier samples, shape (n, order), and the sample that follows."""
    long = _long(runs)
    past = [[run[NOISE_COLOUR.longest - k : len(run) - k] for k in range(1, order + 1)] for run in long]
    now = np.concatenate([run[NOISE_COLOUR.longest :] for run in long])
    return np.concatenate([np.array(each).T for each in past]) if order else np.empty((len(now), 0)), now


def _regressed(runs: Sequence[Array], order: int) -> Array:
    past, now = _rows(runs, order)
    return np.asarray(np.linalg.lstsq(past, now)[0]) if order else np.empty(0)


def _minus_log_likelihood(memory: Array, runs: Sequence[Array], order: int) -> float:
    """Negative log likelihood of samples with the variance that is their own, but for a constant."""
    past, now = _rows(runs, order)
    return 0.5 * len(now) * math.log(max(float(np.mean((now - past @ memory) ** 2)), 1e-300))


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
