"""The closed forms against an ODE solver, a matrix exponential, and the design's figures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from relay_truth import E_A, K_L, ideal_relay
from scipy.linalg import expm

from seod.estimate.limit_cycle.closed_form import LimitCycle, correction_factors, transition, transitions
from seod.estimate.limit_cycle.inversion import eq8


@pytest.mark.parametrize(
    ("zeta", "xi", "gamma"),
    [(0.2, 0.99872, 1.27573), (0.45, 0.99398, 1.28499), (1.0, 0.97801, 1.31663), (4.0, 0.93477, 1.41561)],
)
def test_correction_factors_are_the_exact_ones(zeta, xi, gamma):
    assert [round(x, 5) for x in correction_factors(zeta)] == [xi, gamma]


def test_eq_8_errs_as_much_as_was_measured():
    zetas = np.linspace(0.05, 4.0, 80)
    exact = np.array([correction_factors(z) for z in zetas])
    error = np.array([eq8(z) for z in zetas]) / exact - 1.0
    assert error[:, 0].min() == pytest.approx(-0.0075, abs=1e-4)
    assert error[:, 1].max() == pytest.approx(0.0103, abs=1e-4)
    assert zetas[error[:, 0].argmin()] == pytest.approx(0.6, abs=0.1)
    assert zetas[error[:, 1].argmax()] == pytest.approx(0.6, abs=0.15)


@pytest.mark.parametrize("zeta", [0.02, 0.5, 1 - 4e-6, 1 - 1e-9, 1.0, 1 + 1e-9, 1 + 4e-6, 1.02, 3.0, 10.0])
def test_transition_is_the_matrix_exponential(zeta):
    for t in (1e-3, 0.7, 3.1, 20.0):
        c, s = transition(zeta, t)
        m = expm(np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]]) * t)
        assert [[c + zeta * s, s], [-s, c - zeta * s]] == pytest.approx(m, abs=1e-10)
        assert [float(x[0]) for x in transitions(zeta, np.array([t]))] == pytest.approx([c, s], abs=1e-14)


@pytest.mark.parametrize("zeta", [0.1, 0.45, 1.0, 4.0])
@pytest.mark.parametrize(("lag", "load"), [((0.0, 0.0), 0.0), ((0.1, 0.25), 0.1), ((0.3, 0.3), -0.15)])
def test_limit_cycle_is_what_an_ode_solver_finds(zeta, lag, load):
    omega_n = 50.0
    seconds = tuple(x / omega_n for x in lag)
    truth = ideal_relay(zeta, omega_n, seconds, load=load, cycles=int(5 + 3 / zeta + 4 * zeta))
    h_up, h_down = omega_n * truth.h_up, omega_n * truth.h_down
    cycle = LimitCycle.of(zeta, h_up, h_down)
    unit = K_L * E_A / omega_n
    assert cycle.peak_to_peak() * unit / 2.0 == pytest.approx(truth.V_s, rel=1e-4)
    assert cycle.position(h_up - lag[1]) - cycle.position(-lag[0]) == pytest.approx(0.0, abs=2e-3)
    assert cycle.bias == pytest.approx(-load / E_A, abs=2e-3)


@pytest.mark.parametrize("zeta", [0.1, 1.0, 6.0])
def test_positions_are_smooth_periodic_and_the_same_one_by_one(zeta):
    cycle = LimitCycle.of(zeta, 3.0, 3.6)
    t = np.linspace(-7.0, 14.0, 500)
    y = cycle.positions(t)
    assert y == pytest.approx([cycle.position(x) for x in t], abs=1e-12)
    assert cycle.positions(t + 6.6) == pytest.approx(y, abs=1e-9)
    assert np.abs(np.diff(y, 2)).max() < 7.0 * (t[1] - t[0]) ** 2
    assert np.ptp(cycle.positions(np.linspace(0.0, 6.6, 20001))) == pytest.approx(
        cycle.peak_to_peak(), rel=1e-6
    )


def test_velocity_has_no_mean():
    cycle = LimitCycle.of(0.7, 2.0, 4.0)
    assert cycle.position(6.0 - 1e-9) == pytest.approx(0.0, abs=1e-7)
    assert math.isclose(cycle.bias, 1.0 / 3.0)
