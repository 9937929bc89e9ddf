"""Steps of models without physics, against the sums that define them, term by term."""

import math

import numpy as np
import pytest

from seod.diagnose.account import steps

ROWS, WINDOWS = 40, 3
SHARP = 0.05


def some(seed):
    random = np.random.default_rng(seed)
    return tuple(random.normal(0.0, 1.0, (ROWS, WINDOWS)) for _ in range(3))


def linear_terms(y, u, k, order, integrates):
    """Of one window, newest first."""
    values = [y[k - lag] - y[k - lag - 1] if integrates else y[k - lag] for lag in range(1, order + 1)]
    return [*values, *(u[k - lag] for lag in range(order + 1)), 1.0]


def bent_terms(linear, order):
    y, v, u, w = linear[0], linear[0] - linear[1], linear[order], linear[order + 1]
    out = list(linear)
    for x in (y, v, u, w):
        out += [math.tanh(x / SHARP), abs(x), x**3]
    return [*out, y * y, y * v, y * u, y * w, v * v, v * u, v * w, u * u, u * w, w * w]


@pytest.mark.parametrize("integrates", [False, True])
@pytest.mark.parametrize("order", [2, 4])
def test_terms_of_rows(order, integrates):
    y, u, _ = some(1)
    at = np.array([order + 1, order + 5, ROWS - 1])
    past = steps.past_of(y[:, :1], u[:, :1], at, order, integrates)
    wanted = [linear_terms(y[:, 0], u[:, 0], k, order, integrates) for k in at]
    np.testing.assert_allclose(past, wanted, rtol=1e-15)
    terms = steps.bent(past, order, SHARP)
    np.testing.assert_allclose(terms, [bent_terms(row, order) for row in wanted], rtol=1e-12)
    assert terms.shape[1] == past.shape[1] + steps.MORE


@pytest.mark.parametrize("integrates", [False, True])
def test_a_bent_model_goes_on_from_what_it_told(integrates):
    y, u, _ = some(2)
    order = 3
    random = np.random.default_rng(3)
    weights, sizes = (
        random.normal(0.0, 0.05, 2 * order + 2 + steps.MORE),
        random.uniform(0.5, 2.0, 2 * order + 2),
    )
    limit = np.array([1.2, 2.0, 1e9])
    wanted = y.copy()
    for w in range(WINDOWS):
        for k in range(order + integrates, ROWS):
            past = np.array(linear_terms(wanted[:, w], u[:, w], k, order, integrates)) / sizes
            now = integrates * wanted[k - 1, w] + np.dot(bent_terms(past, order), weights)
            wanted[k, w] = np.clip(now, -limit[w], limit[w])
    steps.simulate_narx(y, u, weights, sizes, order, integrates, SHARP, limit)
    np.testing.assert_allclose(y, wanted, rtol=1e-9)
    assert np.any(np.abs(wanted[:, 0]) == 1.2)


def told(y, place, k, by, integrates):
    """The state that weights change with, from its definition."""
    if by == 0:
        return place[k - 1]
    now = place[k - 1] - y[k - 2] if integrates else y[k - 1]
    speeds = now, y[k - 2] - (y[k - 3] if integrates else 0.0)
    return speeds[0] if by == 1 else speeds[0] - speeds[1]


@pytest.mark.parametrize("integrates", [False, True])
@pytest.mark.parametrize("by", [0, 1, 2])
@pytest.mark.parametrize("count", [2, 5])
def test_weights_run_straight_between_knots(by, integrates, count):
    y, u, place = some(4)
    order, first = 2, 3
    knots = np.linspace(-0.8, 1.1, count)
    random = np.random.default_rng(5)
    weights = random.normal(0.0, 0.2, (WINDOWS, 2 * order + 2, count))
    tick, limit = np.array([0.1, 0.2, 0.3]), np.array([0.7, 5.0, 1e9])
    wanted, where = y.copy(), place.copy()
    for w in range(WINDOWS):
        for k in range(first, ROWS):
            x = told(wanted[:, w], where[:, w], k, by, integrates)
            each = [np.interp(x, knots, row) for row in weights[w]]
            now = np.dot(linear_terms(wanted[:, w], u[:, w], k, order, integrates), each)
            now = np.clip(now + integrates * wanted[k - 1, w], -limit[w], limit[w])
            wanted[k, w] = now
            mean = 0.5 * (now + wanted[k - 1, w])
            where[k, w] = now if integrates else where[k - 1, w] + tick[w] * mean
    at = np.arange(first, ROWS)
    x = steps.states(y[:, :1], place[:, :1], at, by, integrates)
    np.testing.assert_allclose(x, [told(y[:, 0], place[:, 0], k, by, integrates) for k in at], rtol=1e-15)
    near = steps.nearness(x, knots)
    np.testing.assert_allclose(
        near @ weights[0].T, [[np.interp(v, knots, row) for row in weights[0]] for v in x]
    )
    steps.simulate_scheduled(y, u, place, weights, knots, order, by, integrates, first, tick, limit)
    np.testing.assert_allclose(y, wanted, rtol=1e-9)
    np.testing.assert_allclose(place, where, rtol=1e-9)
