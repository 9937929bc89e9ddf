"""What repeats when the command repeats is no noise, of whatever colour: period against period."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import t as student

from seod.diagnose.account.residual import Share
from seod.diagnose.record.command_period import command_period_s, finer_period_s, relay_period_s, rises
from seod.diagnose.tuning.account import REPEATS, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.record.series import Series
    from seod.diagnose.result import Array, Rows


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


def repeats(every: Sequence[Series], parts: Sequence[WindowResidual]) -> Share | None:
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
    period = relay_period_s(one.t, one.u)
    if period is not None:
        begins = rises(one.t, one.u)
    else:
        period = command_period_s(one.t, one.u, 0.0)
        if period is None:
            return None
        period = finer_period_s(one.t, one.u, period)
        begins = np.arange(one.t[0], one.t[-1] + period, period)
    return Cycle(begins, int(min(max(period / one.tick, REPEATS.fewest_bins), REPEATS.most_bins)))


def profile(one: WindowResidual, of: Cycle) -> Array:
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


def not_repeated(every: Sequence[Series], parts: Sequence[WindowResidual]) -> list[WindowResidual]:
    """The same without the mean of the other windows at the same phase, where there are such."""
    cycles = [cycle(one) for one in every]
    profiles = [None if (of := cycles[one.file]) is None else profile(one, of) for one in parts]
    out = []
    for k, one in enumerate(parts):
        of = cycles[one.file]
        others = [p for j, p in enumerate(profiles) if j != k and p is not None and parts[j].file == one.file]
        if of is None or not others:
            out.append(one)
            continue
        count = np.sum(np.isfinite(others), axis=0)
        mean = np.nansum(others, axis=0) / np.maximum(count, 1)
        index = of.place(one.t)
        out.append(replace(one, error=one.error - np.where(index >= 0, mean[index], 0.0)))
    return out


def _product(one: Array, other: Array) -> tuple[float, int]:
    """Sum over the phases that both windows have, and how many these are."""
    both = np.isfinite(one) & np.isfinite(other)
    return float(one[both] @ other[both]), int(both.sum())
