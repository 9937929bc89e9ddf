"""Terms and steps of models without physics, as machine code: a simulation asks for each row's own past.

Arrays of readings, commands and places have a column for each window, shape (rows, w).
"""

from __future__ import annotations

import numpy as np

from sim.compiled import compiled, inlined

Array = np.ndarray

BENT = 4
"""Of a row's terms those that a NARX bends and multiplies: y, its change, the command, and the one before."""
MORE = 3 * BENT + BENT * (BENT + 1) // 2
"""Terms that come so beside the linear ones: sign, size and cube of each, and each product of two."""


@inlined
def _past(y: Array, u: Array, k: int, w: int, order: int, integrates: bool, out: Array) -> None:
    for lag in range(1, order + 1):
        out[lag - 1] = y[k - lag, w] - (y[k - lag - 1, w] if integrates else 0.0)
    for lag in range(order + 1):
        out[order + lag] = u[k - lag, w]
    out[2 * order + 1] = 1.0


@inlined
def _bent(past: Array, order: int, sharp: float, out: Array) -> None:
    """Behind the linear terms."""
    count = len(past)
    out[:count] = past
    some = (past[0], past[0] - past[1], past[order], past[order + 1])
    for a in range(BENT):
        out[count] = np.tanh(some[a] / sharp)
        out[count + 1] = abs(some[a])
        out[count + 2] = some[a] ** 3
        count += 3
    for a in range(BENT):
        for b in range(a, BENT):
            out[count] = some[a] * some[b]
            count += 1


@inlined
def _state(y: Array, place: Array, k: int, w: int, by: int, integrates: bool) -> float:
    """Before row k: the place (`by` 0), the speed (1), or its change (2)."""
    if by == 0:
        now, before = place[k - 1, w], 0.0
    elif not integrates:
        now, before = y[k - 1, w], y[k - 2, w] if by == 2 else 0.0
    else:
        now, before = place[k - 1, w] - y[k - 2, w], y[k - 2, w] - y[k - 3, w] if by == 2 else 0.0
    return float(now - before)


@inlined
def _between(x: float, knots: Array) -> float:
    """Where a value is among ascending knots that are as far from each other: 0 at the first."""
    last = len(knots) - 1
    return float(min(max((x - knots[0]) / (knots[last] - knots[0]) * last, 0.0), 1.0 * last))


@compiled
def past_of(y: Array, u: Array, at: Array, order: int, integrates: bool) -> Array:
    """What a linear model foretells rows `at` of one window by, shape (n, 2 order + 2)."""
    out = np.empty((len(at), 2 * order + 2))
    for i in range(len(at)):
        _past(y, u, at[i], 0, order, integrates, out[i])
    return out


@compiled
def bent(past: Array, order: int, sharp: float) -> Array:
    """Linear terms and bent ones, shape (n, columns + MORE)."""
    out = np.empty((len(past), past.shape[1] + MORE))
    for i in range(len(past)):
        _bent(past[i], order, sharp, out[i])
    return out


@compiled
def states(y: Array, place: Array, at: Array, by: int, integrates: bool) -> Array:
    """What weights change with, before rows `at` of one window, shape (n,)."""
    out = np.empty(len(at))
    for i in range(len(at)):
        out[i] = _state(y, place, at[i], 0, by, integrates)
    return out


@compiled
def nearness(x: Array, knots: Array) -> Array:
    """Of values to knots, shape (n, k): 1 at a knot, 0 at its neighbours; beyond the ends as there."""
    out = np.zeros((len(x), len(knots)))
    for i in range(len(x)):
        at = _between(x[i], knots)
        for j in range(len(knots)):
            out[i, j] = max(0.0, 1.0 - abs(at - j))
    return out


@compiled
def simulate_narx(
    y: Array, u: Array, weights: Array, sizes: Array, order: int, integrates: bool, sharp: float, limit: Array
) -> None:
    """Into `y`, whose first rows are given. `limit` holds each window's readings, shape (w,)."""
    past = np.empty(2 * order + 2)
    terms = np.empty(2 * order + 2 + MORE)
    for w in range(y.shape[1]):
        for k in range(order + integrates, len(y)):
            _past(y, u, k, w, order, integrates, past)
            for c in range(len(past)):
                past[c] /= sizes[c]
            _bent(past, order, sharp, terms)
            now = y[k - 1, w] if integrates else 0.0
            for c in range(len(terms)):
                now += terms[c] * weights[c]
            y[k, w] = min(max(now, -limit[w]), limit[w])


@compiled
def simulate_scheduled(
    y: Array,
    u: Array,
    place: Array,
    weights: Array,
    knots: Array,
    order: int,
    by: int,
    integrates: bool,
    first: int,
    tick: Array,
    limit: Array,
) -> None:
    """Into `y` and `place`, whose rows before `first` are given.

    `weights` are each window's, by term and knot, shape (w, 2 order + 2, k); `tick` and `limit` are its time
    from sample to sample [s] and what holds its readings, shape (w,).
    """
    past = np.empty(2 * order + 2)
    for w in range(y.shape[1]):
        for k in range(first, len(y)):
            _past(y, u, k, w, order, integrates, past)
            at = _between(_state(y, place, k, w, by, integrates), knots)
            low = min(int(at), len(knots) - 2)
            now = y[k - 1, w] if integrates else 0.0
            for c in range(len(past)):
                now += past[c] * ((low + 1 - at) * weights[w, c, low] + (at - low) * weights[w, c, low + 1])
            y[k, w] = min(max(now, -limit[w]), limit[w])
            place[k, w] = y[k, w] if integrates else place[k - 1, w] + 0.5 * tick[w] * (y[k, w] + y[k - 1, w])
