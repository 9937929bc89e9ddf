"""The linearised plant's K_L, omega_n and zeta: closed forms, limits, equivalences."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.linear import small_signal
from sim.parameters import parameters

Effects = dict[str, dict[str, float]]


@given(K_L=st.floats(0.1, 100.0), omega_n=st.floats(5.0, 500.0), zeta=st.floats(0.05, 3.0))
def test_without_effects_it_is_equation_1(K_L: float, omega_n: float, zeta: float) -> None:
    signal = small_signal(parameters(K_L, omega_n, zeta))
    assert (signal.K_L, signal.omega_n) == pytest.approx((K_L, omega_n), rel=1e-15)
    assert signal.zeta == pytest.approx(zeta, rel=1e-14)
    s = 1j * np.geomspace(0.1, 10.0, 5) * omega_n
    velocity = K_L * omega_n**2 / (s**2 + 2.0 * zeta * omega_n * s + omega_n**2)
    assert signal.response(s.imag) == pytest.approx(velocity / s, rel=1e-9)


def numbers(effects: Effects, **at: float) -> tuple[float, float, float]:
    signal = small_signal(parameters(17.0, 117.0, 0.21, effects), **at)
    return signal.K_L, signal.omega_n, signal.zeta


def test_a_wide_open_orifice_damps() -> None:
    flow: Effects = {"square_root_flow": {"supply": 400.0}}
    assert numbers(flow) == pytest.approx((17.0, 117.0, 0.21))
    # No load: half of the relative pressure is lost in relative flow; the laminar part bends that by 1e-4.
    lost = 0.5 * 17.0 * 0.3 / 400.0
    assert numbers(flow, volts=0.3) == pytest.approx((17.0, 117.0, 0.21 + 0.5 * 117.0 * lost), rel=1e-3)
    assert numbers(flow, supply=0.5)[0] == pytest.approx(17.0 * math.sqrt(0.5), rel=1e-3)


def test_air_softens_the_oil() -> None:
    air: Effects = {"pressure_dependent_stiffness": {"air": 1.0}}
    softer = 2.0 / (1.0 + 1.0 / 0.25)
    expected = (17.0, 117.0 * math.sqrt(softer), 0.21 * math.sqrt(softer))
    assert numbers(air, supply=0.5) == pytest.approx(expected)


def test_friction_that_falls_with_speed_undamps() -> None:
    friction: Effects = {"stribeck_friction": {"level": 20.0, "speed": 1.5}}
    slope = -2.0 * 1.2 / 1.5**2 * 20.0 * math.exp(-((1.2 / 1.5) ** 2))
    square = 117.0**2 + 2.0 * 0.21 * 117.0 * slope
    damping = 2.0 * 0.21 * 117.0 + slope
    expected = (17.0 * 117.0**2 / square, math.sqrt(square), damping / 2.0 / math.sqrt(square))
    assert numbers(friction, speed=1.2) == pytest.approx(expected)
    assert numbers(friction, speed=-1.2) == pytest.approx(expected)
    assert numbers(friction) == pytest.approx((17.0, 117.0, 0.21))


@pytest.mark.parametrize("zeta", [0.05, 0.21, 0.9, 1.0, 1.3, 4.0])
def test_the_pair_is_found_among_other_poles(zeta: float) -> None:
    weak: Effects = {"load_spring": {"stiffness": 1e-3}}
    stiff: Effects = {"load_resonance": {"inertia": 0.5, "omega": 5e4, "zeta": 0.05}}
    apart: Effects = {"load_resonance": {"inertia": 0.5, "omega": 1.0, "zeta": 1e-3}}
    for effects in (weak, stiff):
        signal = small_signal(parameters(17.0, 117.0, zeta, effects))
        assert (signal.K_L, signal.omega_n, signal.zeta) == pytest.approx((17.0, 117.0, zeta), rel=1e-3)
    # The first inertia alone: 1 / 1.5 of the whole.
    signal = small_signal(parameters(17.0, 117.0, zeta, apart))
    expected = 17.0, 117.0 * math.sqrt(1.5), zeta / math.sqrt(1.5)
    assert (signal.K_L, signal.omega_n, signal.zeta) == pytest.approx(expected, rel=5e-3)


def test_a_stiffer_spring_takes_the_pair_along() -> None:
    signal = small_signal(
        parameters(17.0, 117.0, 0.05, {"load_spring": {"stiffness": 9000.0}}), direction=0.0
    )
    assert signal.omega_n == pytest.approx(math.sqrt(117.0**2 + 9000.0), rel=1e-2)
    assert signal.K_L * signal.omega_n**2 == pytest.approx(17.0 * 117.0**2)
    slow = 2.0 * 0.05 * 117.0 * 9000.0 / (117.0**2 + 9000.0)
    assert abs(signal.poles).min() == pytest.approx(slow, rel=1e-2)


def test_in_other_units_only_the_gain_is_another() -> None:
    effects: Effects = {
        "square_root_flow": {"supply": 300.0},
        "load_bias": {"acceleration": 50.0},
        "coulomb_friction": {"level": 20.0},
    }
    degrees = {name: {of: value * 57.3 for of, value in values.items()} for name, values in effects.items()}
    one = small_signal(parameters(17.0, 117.0, 0.21, effects), speed=2.0)
    other = small_signal(parameters(17.0 * 57.3, 117.0, 0.21, degrees), speed=2.0 * 57.3)
    expected = (one.K_L * 57.3, one.omega_n, one.zeta, one.steady.volts)
    assert (other.K_L, other.omega_n, other.zeta, other.steady.volts) == pytest.approx(expected)


def test_a_null_shift_is_a_load_bias() -> None:
    shift = 0.1
    bias = 117.0 * 17.0 * shift / (2.0 * 0.21)
    one = small_signal(parameters(17.0, 117.0, 0.21, {"null_shift": {"voltage": shift}}), volts=0.4)
    other = small_signal(parameters(17.0, 117.0, 0.21, {"load_bias": {"acceleration": bias}}), volts=0.4)
    assert one.steady.speed == pytest.approx(other.steady.speed)
    assert pytest.approx(other.A) == one.A


TOO_HEAVY: Effects = {"square_root_flow": {"supply": 50.0}, "load_bias": {"acceleration": 60.0}}


@pytest.mark.parametrize(
    ("record", "at", "message"),
    [
        (
            parameters(
                17.0, 117.0, 0.2, {"square_root_flow": {"supply": 50.0}, "load_bias": {"acceleration": 60.0}}
            ),
            {},
            "the load needs 60 unit/s^2, the supply has 50 unit/s^2",
        ),
        (parameters(17.0, 117.0, 0.0), {}, "zeta must be above 0"),
        (parameters(17.0, 117.0, 0.2), {"direction": 0.5}, "direction must be -1, 0 or 1"),
        (parameters(17.0, 117.0, 0.2), {"supply": 0.0}, "supply above 0"),
    ],
)
def test_what_cannot_be_linearised_is_said(record: np.ndarray, at: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("^", r"\^")):
        small_signal(record, **at)


def test_asking_for_a_truth_does_not_import_the_compiler() -> None:
    program = (
        "import sys; from sim.linear import small_signal; from sim.parameters import parameters;"
        "small_signal(parameters(17.0, 117.0, 0.21), volts=0.1);"
        "print(sorted({'numba', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "[]\n"
