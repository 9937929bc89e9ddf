"""Inversions: what comes out is what an ODE solver's plant had."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from relay_truth import E_A, K_L, ideal_relay

from seod.estimate.limit_cycle.closed_form import LimitCycle, correction_factors
from seod.estimate.limit_cycle.inversion import Measured, Plant, eq8, invert, invert_eq8, sensitivity


@pytest.mark.parametrize("zeta", [0.06, 0.21, 1.0, 4.0])
@pytest.mark.parametrize(
    ("lag", "hysteresis", "load"),
    [((0.0, 0.0), 0.0, 0.0), ((0.02, 0.08), 0.1, 0.0), ((0.15, 0.15), 0.0, 0.1)],
)
def test_inverts_what_an_ode_solver_made(zeta, lag, hysteresis, load):
    omega_n = 80.0
    eps = hysteresis * K_L * E_A / (2.0 * zeta * omega_n)
    seconds = tuple(x * 2.0 * math.pi / omega_n for x in lag)
    truth = ideal_relay(zeta, omega_n, seconds, eps, load, cycles=int(5 + 3 / zeta + 4 * zeta))
    plant = invert(truth, eps, K_L, E_A)
    assert plant is not None
    assert plant == pytest.approx((omega_n, zeta), rel=2e-3)


def _limit_cycle(zeta: float, lag: float, duty: float, eps: float) -> tuple[Measured, float] | None:
    """A limit cycle of omega_n = 1, K_L = E_A = 1 with `lag` and `eps` as parts of period and amplitude."""

    def late(period: float) -> float:
        cycle = LimitCycle.of(zeta, period * duty, period * (1.0 - duty))
        rise = cycle.position(cycle.h_up - lag * period) - cycle.position(-lag * period)
        return rise - eps * cycle.peak_to_peak()

    low = 0.5
    while late(1.05 * low) < 0.0:
        low *= 1.05
    high = 1.05 * low
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if late(middle) < 0.0 else (low, middle)
    V_s = 0.5 * LimitCycle.of(zeta, high * duty, high * (1.0 - duty)).peak_to_peak()
    return Measured(high * duty, high * (1.0 - duty), lag * high, lag * high, V_s), eps * V_s


@pytest.mark.parametrize("zeta", [0.02, 0.06, 0.21, 0.45, 0.8, 1.0, 2.0, 5.0, 10.0])
def test_converges_over_the_whole_range(zeta):
    shapes = [(0.5, 0.0), (0.5, 0.1), (0.6, 0.0), (0.35, 0.05)]
    cases = [(lag, *shape) for lag in (0.0, 0.01, 0.05, 0.1) for shape in shapes]
    cases += [(0.2, 0.5, 0.0), (0.2, 0.6, 0.0)]  # with more, lag alone makes the limit cycle, not the plant
    for lag, duty, eps in cases:
        measured, hysteresis = _limit_cycle(zeta, lag, duty, eps)
        assert invert(measured, hysteresis, 1.0, 1.0) == pytest.approx((1.0, zeta), rel=1e-5), (
            lag,
            duty,
            eps,
        )


@pytest.mark.parametrize("zeta", [0.01, 14.0])
def test_says_when_zeta_is_out_of_range(zeta):
    measured, hysteresis = _limit_cycle(zeta, 0.0, 0.5, 0.0)
    assert invert(measured, hysteresis, 1.0, 1.0) is None


def test_ignoring_the_lag_would_be_wrong():
    measured, _ = _limit_cycle(0.45, 0.03, 0.5, 0.0)
    ignorant = invert(measured._replace(lag_up=0.0, lag_down=0.0), 0.0, 1.0, 1.0)
    assert ignorant is not None
    assert ignorant.omega_n < 0.95


def test_sensitivity_is_what_a_second_inversion_shows():
    measured, eps = _limit_cycle(0.45, 0.02, 0.55, 0.05)
    plant = invert(measured, eps, 1.0, 1.0)
    by = sensitivity(plant, measured, eps, 1.0, 1.0)
    for i, value in enumerate(measured):
        step = 1e-4 * max(value, 0.1)
        changed = [*measured]
        changed[i] += step
        other = invert(Measured(*changed), eps, 1.0, 1.0)
        assert math.log(other.omega_n / plant.omega_n) / step == pytest.approx(
            by.omega_n[i], rel=5e-3, abs=2e-4
        )
        assert math.log(other.zeta / plant.zeta) / step == pytest.approx(by.zeta[i], rel=5e-3, abs=2e-4)


@pytest.mark.parametrize("zeta", [0.05, 0.21, 0.8, 3.0])
def test_eq_8_inverts_its_own_polynomials(zeta):
    xi, gamma = eq8(zeta)
    omega_n = 90.0
    V_s = gamma * K_L * E_A / (2.0 * zeta * omega_n)
    assert invert_eq8(xi * omega_n, V_s, K_L, E_A) == pytest.approx((omega_n, zeta), rel=1e-8)


def test_eq_8_is_about_a_percent_off_on_the_exact_limit_cycle():
    xi, gamma = correction_factors(0.6)
    plant = invert_eq8(xi * 100.0, gamma * K_L * E_A / (2.0 * 0.6 * 100.0), K_L, E_A)
    assert plant.omega_n == pytest.approx(100.75, abs=0.1)
    assert plant.zeta / 0.6 == pytest.approx(1.003, abs=0.002)


def test_eq_8_says_when_zeta_is_out_of_range():
    assert invert_eq8(100.0, 1e-6, K_L, E_A) is None
    assert invert_eq8(100.0, 1e3, K_L, E_A) is None
    assert invert_eq8(1e-200, 1e-200, K_L, E_A) is None


_any = st.floats(min_value=-1e12, max_value=1e12, allow_nan=False)
_some = st.floats(min_value=1e-4, max_value=10.0)


@given(st.builds(Measured, _any, _any, _any, _any, _any), st.floats(0.0, 1e9), st.floats(1e-6, 1e6))
def test_nonsense_is_no_plant_or_a_finite_one(measured, hysteresis, gain):
    plant = invert(measured, hysteresis, gain, 1.0)
    assert plant is None or all(math.isfinite(x) for x in plant)


@pytest.mark.slow
@given(st.builds(Measured, _some, _some, _some, _some, _some), st.floats(0.0, 1.0), st.floats(0.01, 10.0))
@example(Measured(0.5, 7.0, 1.875, 4.625, 2.75), 0.75, 3.0)
def test_plausible_nonsense_is_no_plant_or_one_that_explains_it(measured, hysteresis, gain):
    plant = invert(measured, hysteresis, gain, 1.0)
    if plant is None:
        return
    assert isinstance(plant, Plant)
    w = plant.omega_n
    cycle = LimitCycle.of(plant.zeta, w * measured.h_up, w * measured.h_down)
    assert 0.5 * cycle.peak_to_peak() * gain / w == pytest.approx(measured.V_s, rel=1e-3)
