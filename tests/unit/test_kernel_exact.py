"""Exact steps of the kernel, beside the exponential of the plant's matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import apart, chosen, follow, steps
from scipy.linalg import expm

from sim.parameters import NEAR, parameters
from sim.plant import arrive, look
from sim.state import new_state

SPOOL, PRESSURE, VELOCITY, POSITION, ONE = range(5)
ONE_STEP = 1e9
"""Accuracy by which nothing but an event ends a step."""


def one_step(p, state, volts, h):
    """Spool, pressure, velocity and position `h` after `state`, a command having arrived."""
    s = new_state(p)
    for name, value in zip(("spool", "pressure", "velocity", "position"), state, strict=True):
        s[name] = value
    s["velocity2"], s["position2"] = s["velocity"], s["position"]
    if p[0]["valve_lag_time"] == 0.0:
        s["spool"] = volts
    arrive(p, s, 0.0, volts)
    look(p, s, h)
    assert s["position2"][0] - s["position"][0] == pytest.approx(0.0, abs=1e-9 * (1.0 + abs(state[3])))
    return np.array([s[name][0] for name in ("spool", "pressure", "velocity", "position")])


def by_matrix(K_L, omega_n, zeta, lag, bias, state, volts, h, *, stands=False):
    A = np.zeros((5, 5))
    if lag > 0.0:
        A[SPOOL, SPOOL], A[SPOOL, ONE] = -1.0 / lag, volts / lag
    A[PRESSURE, SPOOL] = omega_n**2 * K_L
    A[PRESSURE, PRESSURE] = -2.0 * zeta * omega_n
    if not stands:
        A[PRESSURE, VELOCITY] = -(omega_n**2)
        A[VELOCITY, PRESSURE], A[VELOCITY, ONE] = 1.0, -bias
        A[POSITION, VELOCITY] = 1.0
    begin = np.array([*state, 1.0])
    if lag == 0.0:
        begin[SPOOL] = volts
    return (expm(A * h) @ begin)[:ONE]


@settings(deadline=None)  # the first example compiles the kernel
@given(
    omega_n=st.floats(0.5, 700.0),
    zeta=st.floats(1e-3, 20.0) | st.sampled_from([1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.0 + 1e-13]),
    angle=st.floats(1e-4, 3.0),
    lags=st.just(0.0) | st.floats(0.05, 20.0),
    bias=st.floats(-3.0, 3.0),
    state=st.tuples(*[st.floats(-2.0, 2.0)] * 4),
    volts=st.floats(-2.0, 2.0),
)
def test_a_step_is_the_matrix_exponential(omega_n, zeta, angle, lags, bias, state, volts):
    h, K_L = angle / omega_n, 1.7
    lag, push = lags * h, bias * omega_n
    scaled = (state[0], state[1] * omega_n, state[2], state[3] / omega_n)  # each as large as the others
    effects = {"valve_lag": {"time": max(lag, 1e-5)}} if lag > 0.0 else {}
    lag = effects.get("valve_lag", {}).get("time", 0.0)
    p = parameters(K_L, omega_n, zeta, {**effects, "load_bias": {"acceleration": push}}, accuracy=ONE_STEP)
    if p[0]["linear"] == 0.0:
        return
    expected = by_matrix(K_L, omega_n, zeta, lag, push, scaled, volts, h)
    found = one_step(p, scaled, volts, h)
    sizes = np.array([1.0, omega_n, 1.0, 1.0 / omega_n]) * (1.0 + zeta) * 10.0
    assert np.all(np.abs(found - expected) < 1e-9 * sizes), (found, expected)


@pytest.mark.parametrize("lag", [0.0, 2e-3, 0.05])
@pytest.mark.parametrize("zeta", [1e-3, 0.3, 4.0])
def test_the_pressure_on_a_load_that_sticks(zeta, lag):
    K_L, omega_n, h = 2.0, 50.0, 0.011
    effects = {"coulomb_friction": {"level": 1e9}}
    if lag > 0.0:
        effects["valve_lag"] = {"time": lag}
    p = parameters(K_L, omega_n, zeta, effects, accuracy=ONE_STEP)
    state = (0.4, 30.0, 0.0, 0.7)
    expected = by_matrix(K_L, omega_n, zeta, lag, 0.0, state, -0.8, h, stands=True)
    assert one_step(p, state, -0.8, h) == pytest.approx(expected, rel=1e-11)


def test_a_lag_as_quick_as_the_load_is_integrated_and_fits_between_its_neighbours():
    omega_n, zeta, t = 40.0, 1.3, np.arange(0.01, 0.6, 0.01)
    slow = omega_n * (zeta - np.sqrt(zeta**2 - 1.0))
    readings, linear = [], []
    for off in (-30.0, 0.0, 30.0):
        effects = {"valve_lag": {"time": (1.0 + off * NEAR) / slow}}
        p = parameters(3.0, omega_n, zeta, effects, accuracy=0.01)
        linear.append(bool(p[0]["linear"]))
        readings.append(follow(p, *steps(0.6), t)[0])
    assert linear == [True, False, True]
    assert apart(0.5 * (readings[0] + readings[2]), readings[1]) < 1e-8


def test_another_plant_goes_on_from_the_same_state_by_its_own_factors():
    t, s = np.arange(0.01, 0.3, 0.01), None
    first, second = (parameters(17.0, omega_n, 0.2) for omega_n in (60.0, 90.0))
    s = new_state(first)
    follow(first, *steps(0.3), t, state=s)
    fresh = s.copy()
    fresh["kept_omega_n"] = fresh["kept_zeta"] = 0.0
    s["t"] = s["origin"] = fresh["t"] = fresh["origin"] = 0.0
    y = follow(second, *steps(0.3, seed=2), t, state=s)[0]
    assert np.array_equal(y, follow(second, *steps(0.3, seed=2), t, state=fresh)[0])
    again = follow(
        parameters(17.0, 90.0, 0.2, {"load_resonance": {"inertia": 1e-12, "omega": 10.0}}, accuracy=0.01),
        *steps(0.3),
        t,
    )[0]
    assert apart(follow(second, *steps(0.3), t)[0], again) < 1e-6


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
