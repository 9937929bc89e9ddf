"""Times of a relay's switches, and numbers, to first order: a linear model whose numbers have deviations.

Before the data each is about where it is expected (Bayesian linear model; Kay, Fundamentals of Statistical
Signal Processing, vol. 1, 11.6). The evidence says how likely the data are by such times.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from seod.diagnose.result import Array, Rows

without_end = np.errstate(over="ignore", invalid="ignore")
"""For simulations of unstable plants: whether their numbers are finite is asked where they are used."""


class WindowColumns(NamedTuple):
    """Weighted columns of a window, shapes (n, ...).

    What its own states, its switches, all switches up and down, and the searched numbers change in the
    simulation, over their deviations; and what is left without any lead, shape (n,).
    """

    states: Array
    switches: Array
    kinds: Array
    numbers: Array
    left: Array


class LinearLeads(NamedTuple):
    """The windows, which numbers are free, bounds of their step, and the root of how many rows are one."""

    windows: list[WindowColumns]
    free: Rows
    low: Array
    high: Array
    wide: float


class SolvedLeads(NamedTuple):
    """Leads of each window over their deviation, the step of free numbers, and the log of the evidence."""

    leads: list[Array]
    step: Array
    evidence: float


@without_end
def solved_leads(parts: LinearLeads, *, together: bool) -> SolvedLeads:
    """Least squares with a time for each switch, or, `together`, with one for all up and one for all down.

    Each lead has the deviation 1 about 1 before the data, each searched number 1 about where it is.
    """
    wide, every, log_volume = parts.wide, [], 0.0
    if not all(np.isfinite(each).all() for one in parts.windows for each in one):  # simulations without end
        still = [np.zeros(one.switches.shape[1]) for one in parts.windows]
        return SolvedLeads(still, np.zeros(len(parts.free)), -math.inf)
    for one in parts.windows:
        states = one.states / np.maximum(np.linalg.norm(one.states, axis=0), 1e-300)
        others = np.hstack([one.numbers, one.kinds]) if together else one.numbers
        known = np.hstack([states, one.switches]) if not together else states
        size = known.shape[1] - states.shape[1]
        known = np.vstack([known, np.hstack([np.zeros((size, states.shape[1])), wide * np.eye(size)])])
        others = np.vstack([others, np.zeros((size, others.shape[1]))])
        left = np.r_[one.left, np.zeros(size)]
        base = np.linalg.qr(known)[0]
        every.append((known, others, left, others - base @ (base.T @ others), left - base @ (base.T @ left)))
        if size:
            base = np.linalg.qr(states)[0]
            apart = (one.switches - base @ (base.T @ one.switches)) / wide
            log_volume += np.linalg.slogdet(np.eye(size) + apart.T @ apart)[1]
    matrix = sum(others.T @ others for *_, others, _ in every) + wide**2 * np.eye(every[0][3].shape[1])
    right = sum(others.T @ left for *_, others, left in every)
    step = np.linalg.solve(matrix, right)
    squared = sum(float(left @ left) for *_, left in every) - float(right @ step)
    log_volume += np.linalg.slogdet(matrix / wide**2)[1]
    step[: len(parts.low)] = np.clip(step[: len(parts.low)], parts.low, parts.high)
    leads = []
    for one, (known, others, left, _, _) in zip(parts.windows, every, strict=True):
        own = np.linalg.lstsq(known, left - others @ step, rcond=1e-12)[0]
        leads.append(own[one.states.shape[1] :])
    return SolvedLeads(leads, step[: len(parts.free)], -0.5 * (squared / wide**2 + log_volume))
