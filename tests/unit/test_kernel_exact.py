"""Exact steps of the kernel, beside the exponential of the plant's matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import chosen, follow, steps
from scipy.linalg import expm

from sim.exact import SMALL, factors
from sim.matrix_steps import COST
from sim.parameters import parameters
from sim.plant import arrive, look
from sim.state import new_state

PRESSURE, VELOCITY, POSITION, ONE = range(4)
NAMES = ("pressure", "velocity", "position")
ONE_STEP = 1e9
"""Accuracy by which nothing but an event ends a step."""


def one_step(p, state, volts, h):
    """Pressure, velocity and position `h` after `state`, a command having arrived."""
    s = new_state(p)
    for name, value in zip(NAMES, state, strict=True):
        s[name] = value
    s["velocity2"], s["position2"] = s["velocity"], s["position"]
    arrive(p, s, 0.0, volts)
    look(p, s, h)
    assert s["position2"][0] - s["position"][0] == pytest.approx(0.0, abs=1e-9 * (1.0 + abs(state[2])))
    return np.array([s[name][0] for name in NAMES])


def by_matrix(K_L, omega_n, zeta, bias, state, volts, h, *, stands=False):
    A = np.zeros((4, 4))
    A[PRESSURE, ONE] = omega_n**2 * K_L * volts
    A[PRESSURE, PRESSURE] = -2.0 * zeta * omega_n
    if not stands:
        A[PRESSURE, VELOCITY] = -(omega_n**2)
        A[VELOCITY, PRESSURE], A[VELOCITY, ONE] = 1.0, -bias
        A[POSITION, VELOCITY] = 1.0
    return (expm(A * h) @ [*state, 1.0])[:ONE]


@settings(deadline=None)  # the first example compiles the kernel
@given(
    omega_n=st.floats(0.5, 700.0),
    zeta=st.floats(1e-3, 20.0) | st.sampled_from([1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.0 + 1e-13]),
    angle=st.floats(1e-6, 3.0),
    bias=st.floats(-3.0, 3.0),
    state=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    volts=st.floats(-2.0, 2.0),
)
def test_a_step_is_the_matrix_exponential(omega_n, zeta, angle, bias, state, volts):
    h, K_L, push = angle / omega_n, 1.7, bias * omega_n
    scaled = (state[0] * omega_n, state[1], state[2] / omega_n)  # each as large as the others
    p = parameters(K_L, omega_n, zeta, {"load_bias": {"acceleration": push}}, accuracy=ONE_STEP)
    assert p[0]["linear"] == 1.0
    expected = by_matrix(K_L, omega_n, zeta, push, scaled, volts, h)
    found = one_step(p, scaled, volts, h)
    sizes = np.array([omega_n, 1.0, 1.0 / omega_n]) * (1.0 + zeta) * 10.0
    assert np.all(np.abs(found - expected) < 1e-10 * sizes), (found, expected)


def by_matrix_swung(K_L, omega_n, zeta, swing, state, volts, h):
    """The same under amplitude sin(omega t + phase): two more states go round in a circle."""
    A = np.zeros((6, 6))
    A[PRESSURE, ONE] = omega_n**2 * K_L * volts
    A[PRESSURE, PRESSURE], A[PRESSURE, VELOCITY] = -2.0 * zeta * omega_n, -(omega_n**2)
    A[VELOCITY, PRESSURE], A[VELOCITY, 4] = 1.0, swing["amplitude"]
    A[POSITION, VELOCITY] = 1.0
    A[4, 5], A[5, 4] = swing["omega"], -swing["omega"]
    begins = [*state, 1.0, np.sin(swing["phase"]), np.cos(swing["phase"])]
    return (expm(A * h) @ begins)[:ONE]


@settings(deadline=None)
@given(
    omega_n=st.floats(0.5, 700.0),
    zeta=st.floats(0.01, 20.0),
    angle=st.floats(1e-6, 3.0),
    ratio=st.floats(0.01, 30.0) | st.just(1.0),
    phase=st.floats(-3.0, 3.0),
    state=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
)
def test_a_load_that_is_swung_moves_as_by_the_matrix_exponential(omega_n, zeta, angle, ratio, phase, state):
    h, swing = angle / omega_n, {"amplitude": 2.0 * omega_n, "omega": ratio * omega_n, "phase": phase}
    scaled = (state[0] * omega_n, state[1], state[2] / omega_n)
    p = parameters(1.7, omega_n, zeta, {"periodic_disturbance": swing}, accuracy=ONE_STEP)
    assert p[0]["linear"] == 1.0
    expected = by_matrix_swung(1.7, omega_n, zeta, swing, scaled, 0.7, h)
    found = one_step(p, scaled, 0.7, h)
    sizes = np.array([omega_n, 1.0, 1.0 / omega_n]) * (1.0 + zeta + 1.0 / zeta) * 10.0
    assert np.all(np.abs(found - expected) < 1e-10 * sizes), (found, expected)


def by_matrix_of(p, state, volts, h):
    """Of all six states, written apart: forces between oil, load and second inertia, one by one."""
    names = ("pressure", "velocity", "position", "velocity2", "position2", "lagged")
    K_L, omega_n, zeta = (float(p[name][0]) for name in ("K_L", "omega_n", "zeta"))
    ratio, omega, damps = (float(p[f"load_resonance_{name}"][0]) for name in ("inertia", "omega", "zeta"))
    stiffness, centre = (float(p[f"load_spring_{name}"][0]) for name in ("stiffness", "centre"))
    lag, rubs = float(p["sensor_lag_time"][0]), 2.0 * zeta * omega_n * float(p["viscous_friction_share"][0])

    def grows(z):
        a, v, x, v2, x2, lagged, one = z
        oil = omega_n**2 * (K_L * volts * one - v) - (2.0 * zeta * omega_n - rubs) * a
        second = omega**2 * (x - x2) + 2.0 * damps * omega * (v - v2)
        first = (1.0 + ratio) * (a - stiffness * (x - centre * one) - rubs * v) - ratio * second
        if ratio == 0.0:
            v2, second = v, first
        return [oil, first, v, second, v2, (x - lagged) / lag if lag > 0.0 else 0.0, 0.0]

    A = np.transpose([grows(each) for each in np.eye(7)])
    return names, (expm(A * h) @ [*state, 1.0])[:6]


@settings(deadline=None)
@given(
    omega_n=st.floats(1.0, 500.0),
    zeta=st.floats(0.02, 5.0),
    angle=st.floats(1e-4, 0.5),
    inertia=st.just(0.0) | st.floats(0.01, 3.0),
    ratio=st.floats(0.2, 8.0),
    stiff=st.just(0.0) | st.floats(-0.2, 3.0),
    lag=st.just(0.0) | st.floats(0.02, 5.0),
    share=st.floats(0.0, 1.0),
    state=st.tuples(*[st.floats(-2.0, 2.0)] * 6),
)
def test_with_more_states_a_step_is_the_matrix_exponential_too(
    omega_n, zeta, angle, inertia, ratio, stiff, lag, share, state
):
    if inertia == stiff == lag == 0.0:
        lag = 0.5
    effects = {
        "load_resonance": {"inertia": inertia, "omega": ratio * omega_n, "zeta": 0.1},
        "load_spring": {"stiffness": stiff * omega_n**2, "centre": 0.3 / omega_n},
        "sensor_lag": {"time": lag / omega_n},
        "viscous_friction": {"share": share},
    }
    h, sizes = angle / omega_n, np.array([omega_n, 1.0, 1.0 / omega_n, 1.0, 1.0 / omega_n, 1.0 / omega_n])
    begins = np.array(state) * sizes
    if inertia == 0.0:
        begins[3:5] = begins[1:3]
    p = parameters(1.7, omega_n, zeta, effects)
    p["longest_exact"] = 1.0
    names, expected = by_matrix_of(p, begins, 0.7, h)
    s = new_state(p)
    for name, value in zip(names, begins, strict=True):
        s[name] = value
    arrive(p, s, 0.0, 0.7)
    look(p, s, h)
    assert p["by_matrix"][0] != 0.0
    assert s["steps"][0] == COST
    found = np.array([s[name][0] for name in names])
    assert np.all(np.abs(found - expected) < 1e-10 * sizes * (1.0 + zeta) * 10.0), (found, expected)


def test_rows_that_never_come_in_step_are_integrated():
    """A matrix for each would cost more than it saves."""
    t_u, u = steps(1.0)
    t = np.cumsum(np.random.default_rng(5).uniform(4e-4, 6e-4, 1900))
    p = parameters(17.0, 117.0, 0.21, chosen("load_spring"))
    y, state = follow(p, t_u, u, t)
    assert state["steps"] > 0.9 * len(t)
    p["longest_exact"] = 0.0
    assert np.max(np.abs(y - follow(p, t_u, u, t)[0])) < 1e-6 * np.ptp(y)


def test_another_plant_goes_on_by_its_own_matrix():
    t = np.arange(0.01, 0.3, 0.01)
    first, second = (parameters(17.0, omega_n, 0.2, chosen("load_spring")) for omega_n in (60.0, 90.0))
    s = new_state(first)
    follow(first, *steps(0.3), t, state=s)
    fresh = s.copy()
    fresh["matrices_of"] = fresh["owed"] = 0.0
    s["t"] = s["origin"] = fresh["t"] = fresh["origin"] = 0.0
    y = follow(second, *steps(0.3, seed=2), t, state=s)[0]
    assert np.array_equal(y, follow(second, *steps(0.3, seed=2), t, state=fresh)[0])


AT_TIMES = {
    "friction that falls": ("stribeck_friction", "coulomb_friction"),
    "friction that falls, and play": ("stribeck_friction", "backlash"),
    "bristles": ("lugre_friction", "coulomb_friction"),
    "a spool of limited speed": ("valve_rate_limit", "valve_deadband"),
    "a spool that lags": ("valve_lag",),
    "a spool that lags over its overlap": ("valve_lag", "valve_deadband", "asymmetric_gain"),
    "it and a load that swings": ("valve_lag", "periodic_disturbance", "coulomb_friction"),
    "a second inertia that sticks": ("load_resonance", "coulomb_friction"),
    "a spring and bristles": ("load_spring", "lugre_friction"),
    "a sensor that lags behind what it carries": ("sensor_lag", "load_resonance", "stribeck_friction"),
    "all that swings": ("valve_rate_limit", "stribeck_friction", "periodic_disturbance"),
}


@pytest.mark.parametrize("names", AT_TIMES.values(), ids=AT_TIMES)
def test_what_is_linear_at_times_is_as_if_it_were_never(names):
    """By Runge and Kutta throughout, much more finely."""
    t_u, u = steps(1.0)
    t = np.arange(0.0005, 1.0, 0.0005)
    p, fine = (parameters(17.0, 117.0, 0.21, chosen(*names), accuracy=each) for each in (0.1, 0.01))
    fine["longest_exact"] = 0.0
    (y, state), (often, _) = (follow(each, t_u, u, t) for each in (p, fine))
    assert np.max(np.abs(y - often)) < 1e-5 * np.ptp(often)
    p["longest_exact"] = 0.0
    assert state["steps"] < 0.8 * follow(p, t_u, u, t)[1]["steps"]


@given(st.floats(0.5, 700.0), st.floats(1e-3, 20.0))
def test_power_series_and_closed_forms_meet(omega_n, zeta):
    square, d = omega_n**2, zeta * omega_n
    edge = SMALL / (2.0 * d + omega_n)
    below, above = (factors(square, d, edge * (1.0 + off)) for off in (-1e-9, 1e-9))
    assert below == pytest.approx(above, rel=1e-7)


@pytest.mark.parametrize("zeta", [0.1, 1.0, 4.0])
def test_a_load_at_rest_begins_to_move_the_right_way_however_short_the_step(zeta):
    """A relay without hysteresis would switch on what rounding makes of it."""
    p = parameters(17.0, 117.0, zeta, accuracy=ONE_STEP)
    for h in (1e-18, 1e-12, 1e-9, 1e-6):
        moved = one_step(p, (0.0, 0.0, 0.0), -0.5, h)[POSITION]
        assert moved == pytest.approx(-0.5 * 17.0 * 117.0**2 * h**3 / 6.0, rel=1e-3)


@pytest.mark.parametrize("zeta", [1e-3, 0.3, 4.0])
def test_the_pressure_on_a_load_that_sticks(zeta):
    K_L, omega_n, h = 2.0, 50.0, 0.011
    p = parameters(K_L, omega_n, zeta, {"coulomb_friction": {"level": 1e9}}, accuracy=ONE_STEP)
    state = (30.0, 0.0, 0.7)
    expected = by_matrix(K_L, omega_n, zeta, 0.0, state, -0.8, h, stands=True)
    assert one_step(p, state, -0.8, h) == pytest.approx(expected, rel=1e-11)


def test_another_plant_goes_on_from_the_same_state_by_its_own_factors():
    t = np.arange(0.01, 0.3, 0.01)
    first, second = (parameters(17.0, omega_n, 0.2) for omega_n in (60.0, 90.0))
    s = new_state(first)
    follow(first, *steps(0.3), t, state=s)
    fresh = s.copy()
    fresh["kept_square"] = fresh["kept_damping"] = 0.0
    s["t"] = s["origin"] = fresh["t"] = fresh["origin"] = 0.0
    y = follow(second, *steps(0.3, seed=2), t, state=s)[0]
    assert np.array_equal(y, follow(second, *steps(0.3, seed=2), t, state=fresh)[0])


@pytest.mark.parametrize(
    "name",
    [
        "load_spring",
        "sensor_lag",
        "stribeck_friction",
        "square_root_flow",
        "parameter_drift",
        "load_resonance",
    ],
)
def test_what_bends_the_equation_is_integrated(name):
    assert parameters(17.0, 117.0, 0.21, chosen(name))[0]["linear"] == 0.0
