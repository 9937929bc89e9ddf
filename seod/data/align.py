"""Rows of a recording from samples and commands that come at times of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from seod.data.source import Floats


def held(t: Floats, t_x: Floats, x: Floats) -> Floats:
    """The newest `x` at each of the times `t`; nan before the first.

    Args:
        t: Times [s], shape (n,).
        t_x: When `x` came [s], increasing, shape (m,).
        x: Values, shape (m,).
    """
    if not len(x):
        return np.full(len(t), np.nan)
    index = np.searchsorted(t_x, t, side="right") - 1
    return np.where(index >= 0, x[index], np.nan)


def commands(t: Floats, t_x: Floats, x: Floats) -> tuple[Floats, Floats, int]:
    """What left after each sample and before the next, and when.

    Args:
        t: When samples were taken [s], increasing, shape (n,).
        t_x: When commands left [s], increasing, shape (m,).
        x: Commands, shape (m,).

    Returns:
        u and t_u, shape (n,): the last command between a sample and the next one, else the one that still
        holds, with t_u = t; and how many commands have no row, another having followed before the next
        sample.
    """
    if not len(x) or not len(t):
        return np.full(len(t), np.nan), t.copy(), 0
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    ends = np.append(t[1:], t[-1] + usual)
    last = np.searchsorted(t_x, ends, side="left") - 1
    fresh = (last >= 0) & (t_x[last] >= t)
    counts = np.diff(np.searchsorted(t_x, np.append(t, ends[-1]), side="left"))
    u = np.where(last >= 0, x[last], np.nan)
    return u, np.where(fresh, t_x[last], t), int(np.maximum(counts - 1, 0).sum())
