"""The exact plant against other equations (a matrix exponential, an integrator) and against itself."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random
from statistics import fmean, stdev

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sim.plant import LinearPlant, Sensor

ZETAS = [0.02, 0.3, 0.999999999, 1.0, 1.000000001, 1.5, 10.0]


def states(plant: LinearPlant) -> list[float]:
    return [plant.position, plant.velocity, plant.acceleration]


def matrices(K_L: float, omega_n: float, zeta: float) -> tuple[np.ndarray, np.ndarray]:
    a = np.array([[0, 1, 0], [0, 0, 1], [0, -(omega_n**2), -2 * zeta * omega_n]])
    return a, np.array([0, 0, K_L * omega_n**2])


def moving_plant(zeta: float, omega_n: float = 110.0, K_L: float = 17.0, bias: float = 0.2) -> LinearPlant:
    plant = LinearPlant(K_L, omega_n, zeta, bias=bias, position=0.4)
    plant.velocity = -3.0
    plant.acceleration = 250.0
    return plant


@pytest.mark.parametrize("zeta", ZETAS)
@pytest.mark.parametrize("dt", [1e-6, 5e-4, 0.02, 0.3])
def test_a_step_is_the_matrix_exponential(zeta: float, dt: float) -> None:
    plant = moving_plant(zeta)
    a, b = matrices(17.0, 110.0, zeta)
    # Augmented with the held input, so that the particular solution comes from the same exponential.
    augmented = np.zeros((4, 4))
    augmented[:3, :3], augmented[:3, 3] = a, b
    expected = (expm(augmented * dt) @ [*states(plant), 0.7 - 0.2])[:3]
    plant.advance(dt, 0.7)
    assert states(plant) == pytest.approx(expected, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("zeta", [0.02, 0.45, 1.0, 4.0])
def test_a_square_wave_is_what_an_integrator_makes_of_it(zeta: float) -> None:
    plant = moving_plant(zeta, omega_n=60.0)
    a, b = matrices(17.0, 60.0, zeta)
    expected = np.array(states(plant))
    for half_period in range(6):
        volts = 0.5 if half_period % 2 else -0.5
        flow = solve_ivp(
            lambda _t, x, u=volts: a @ x + b * (u - 0.2),
            (0, 0.04),
            expected,
            method="DOP853",
            rtol=1e-11,
            atol=1e-11,
        )
        expected = flow.y[:, -1]
        for _ in range(80):
            plant.advance(0.04 / 80, volts)
    assert states(plant) == pytest.approx(expected, rel=1e-7, abs=1e-8)


@given(
    zeta=st.one_of(st.floats(0.02, 10.0), st.sampled_from(ZETAS), st.floats(0.999, 1.001)),
    omega_n=st.floats(1.0, 2000.0),
    first=st.floats(0.0, 0.1),
    second=st.floats(0.0, 0.1),
    volts=st.floats(-10.0, 10.0),
)
def test_two_steps_are_one_long_step(
    zeta: float, omega_n: float, first: float, second: float, volts: float
) -> None:
    once, twice = moving_plant(zeta, omega_n), moving_plant(zeta, omega_n)
    once.advance(first + second, volts)
    twice.advance(first, volts)
    twice.advance(second, volts)
    # Each state against its own scale: speeds of up to 200 units/s, times or over powers of omega_n.
    scale = 200.0 * (1.0 + zeta)
    assert once.velocity == pytest.approx(twice.velocity, abs=1e-11 * scale)
    assert once.acceleration == pytest.approx(twice.acceleration, abs=1e-11 * (scale * omega_n + 250.0))
    assert once.position == pytest.approx(twice.position, abs=1e-11 * (scale + 250.0 / omega_n))


@pytest.mark.parametrize("zeta", ZETAS)
def test_a_constant_voltage_ends_in_a_constant_speed(zeta: float) -> None:
    plant = LinearPlant(17.0, 100.0, zeta, bias=-0.1)
    plant.advance(100.0, 0.4)
    assert plant.velocity == pytest.approx(17.0 * 0.5)
    assert plant.acceleration == pytest.approx(0.0, abs=1e-9)
    # Settled, the position lags an ideal integrator by 2 zeta / omega_n seconds.
    assert plant.position == pytest.approx(8.5 * (100.0 - 2 * zeta / 100.0))


def test_the_voltage_of_the_bias_holds_the_load() -> None:
    plant = LinearPlant(17.0, 100.0, 0.3, bias=0.25, position=1.5)
    plant.advance(1.0, 0.25)
    assert states(plant) == [1.5, 0.0, 0.0]


def test_changed_parameters_count_at_once_even_for_the_same_step() -> None:
    changed, fresh = moving_plant(0.3), moving_plant(0.3)
    changed.advance(1e-3, 0.5)
    changed.position, changed.velocity, changed.acceleration = states(fresh)
    changed.change(9.0, 40.0, 2.0, 0.0)
    fresh = LinearPlant(9.0, 40.0, 2.0, position=0.4)
    fresh.velocity, fresh.acceleration = -3.0, 250.0
    changed.advance(1e-3, 0.5)
    fresh.advance(1e-3, 0.5)
    assert states(changed) == states(fresh)


def test_the_load_stands_at_an_end_stop_and_leaves_it_when_driven_away() -> None:
    plant = LinearPlant(17.0, 100.0, 0.3)
    plant.stops = (-0.1, 0.2)
    for _ in range(1000):
        plant.advance(1e-3, 1.0)
    assert states(plant) == [0.2, 0.0, 0.0]
    plant.advance(1e-3, -1.0)
    assert plant.position < 0.2
    for _ in range(1000):
        plant.advance(1e-3, -1.0)
    assert states(plant) == [-0.1, 0.0, 0.0]


def test_the_noise_is_white_repeatable_and_of_the_right_size() -> None:
    readings = [Sensor(0.01, 0.0, random).read(2.0) for random in [Random(7)] for _ in range(4000)]
    again = Sensor(0.01, 0.0, Random(7))
    assert readings == [again.read(2.0) for _ in range(4000)]
    assert stdev(readings) == pytest.approx(0.01, rel=0.05)
    errors = [reading - 2.0 for reading in readings]
    neighbours = fmean(a * b for a, b in pairwise(errors)) / 0.01**2
    assert abs(neighbours) < 4 / math.sqrt(4000)


@given(value=st.floats(-1e3, 1e3))
def test_a_quantised_reading_is_the_nearest_whole_step(value: float) -> None:
    reading = Sensor(0.0, 0.25, Random(1)).read(value)
    assert reading % 0.25 == 0.0
    assert abs(reading - value) <= 0.125


@pytest.mark.parametrize(
    ("zeta", "xi", "gamma"),
    [(0.2, 0.99872, 1.27573), (0.45, 0.99398, 1.28499), (1.0, 0.97801, 1.31663), (4.0, 0.93477, 1.41561)],
)
def test_under_an_ideal_relay_it_has_the_known_limit_cycle(zeta: float, xi: float, gamma: float) -> None:
    # xi = omega_s / omega_n and gamma = V_s 2 zeta omega_n / (K_L e_a), from the exact half-period map.
    plant, dt, t, volts = LinearPlant(17.0, 100.0, zeta), 1e-4, 0.0, 0.5
    upward, highest = [], 0.0
    for step in range(20_000):
        plant.advance(dt, volts)
        t += dt
        if plant.position * volts > 0.0:  # past zero: back to the crossing, so that the relay has no lag
            for _newton in range(3):
                overshoot = plant.position / plant.velocity
                plant.advance(-overshoot, volts)
                t -= overshoot
            upward += [t] if volts > 0.0 else []
            volts = -volts
        highest = max(highest, plant.position) if step > 10_000 else 0.0
    omega_s = 2 * math.pi * 10 / (upward[-1] - upward[-11])
    assert omega_s / 100.0 == pytest.approx(xi, rel=1e-4)
    assert highest * 2 * zeta * 100.0 / (17.0 * 0.5) == pytest.approx(gamma, rel=1e-4)
