"""What repeats when the command repeats is no noise, of whatever colour: period against period."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from scipy.stats import t as student

from seod.diagnose.fitting.noise_colour import Residual
from seod.diagnose.record.command_period import command_period_s, finer_period_s, relay_period_s, rises
from seod.diagnose.tuning.account import REPEATS, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Rows


@dataclass(frozen=True, slots=True)
class Share:
    """How much of what is left is systematic, at least, by one way of asking.

    Attributes:
        square: Mean square of the systematic part [unit^2]; may be below 0 by chance.
        sd: Its standard deviation.
        score: What is shown, over its own standard deviation (Student's t).
        limit: Score from which on it is more than chance.
    """

    square: float
    sd: float
    score: float
    limit: float

    @property
    def significant(self) -> bool:
        """Whether there is more than chance would show."""
        return self.square > 0.0 and self.score > self.limit


class PlacedResidual(Residual, Protocol):
    """What is left of one window, and where that is."""

    @property
    def file(self) -> int:
        """Which recording."""

    @property
    def t(self) -> Array:
        """[s]; shape (n,)."""


class Cycle(NamedTuple):
    """A command that repeats.

    Attributes:
        begins: Of its periods [s], shape (m,).
        bins: Parts of a period in which residuals are compared.
    """

    begins: Array
    bins: int

    def place(self, t: Array) -> Rows:
        """The part of its period in which each time is, shape (n,); -1 outside."""
        turns = np.interp(t, self.begins, np.arange(float(len(self.begins))), left=-1.0, right=-1.0)
        part = np.minimum((np.mod(turns, 1.0) * self.bins).astype(int), self.bins - 1)
        return np.where(turns < 0.0, -1, part)


def repeats(every: Sequence[Series], parts: Sequence[PlacedResidual]) -> Share | None:
    """Mean product of the residuals of different windows at the same phase; None where no command repeats.

    A parabola is taken off each window: what drifts does not count. Of noise, whatever its colour, the mean
    is 0.
    """
    cycles = [cycle(one) for one in every]
    profiles = [(one.file, profile(one, of)) for one in parts if (of := cycles[one.file]) is not None]
    pairs = [
        _product(one, other)
        for k, (file, one) in enumerate(profiles)
        for of, other in profiles[:k]
        if of == file
    ]
    products, counts = np.array([each for each in pairs if each[1] > 0]).reshape(-1, 2).T
    if len(profiles) < REPEATS.fewest_windows or len(products) < REPEATS.fewest_windows:
        return None
    square = float(products.sum() / counts.sum())
    scatter = float(np.sum((products - square * counts) ** 2)) * len(products) / (len(products) - 1)
    limit = float(student.ppf(1.0 - SYSTEMATIC.chance, len(profiles) - 1))
    sd = math.sqrt(scatter) / float(counts.sum())
    return Share(square, sd, square / max(sd, 1e-300), limit)


def cycle(one: Series) -> Cycle | None:
    """Of a recording's command; None where it does not repeat."""
    period = relay_period_s(one.t, one.u_of_rows)
    if period is not None:
        begins = rises(one.t, one.u_of_rows)
    else:
        period = command_period_s(one.t, one.u_of_rows, 0.0)
        if period is None:
            return None
        period = finer_period_s(one.t, one.u_of_rows, period)
        begins = np.arange(one.t[0], one.t[-1] + period, period)
    return Cycle(begins, int(min(max(period / one.tick, REPEATS.fewest_bins), REPEATS.most_bins)))


def profile(one: PlacedResidual, of: Cycle) -> Array:
    """Mean residual of a window over the phase, a parabola taken off; shape (bins,), nan without a row."""
    index = of.place(one.t)
    rows = np.flatnonzero(one.scored & (index >= 0))
    if len(rows) < REPEATS.fewest_rows:
        return np.full(of.bins, np.nan)
    t = one.t[rows]
    rest = one.error[rows] - np.polynomial.Polynomial.fit(t, one.error[rows], 2)(t)
    count = np.bincount(index[rows], minlength=of.bins)
    total = np.bincount(index[rows], weights=rest, minlength=of.bins)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _product(one: Array, other: Array) -> tuple[float, int]:
    """Sum over the phases that both windows have, and how many these are."""
    both = np.isfinite(one) & np.isfinite(other)
    return float(one[both] @ other[both]), int(both.sum())
