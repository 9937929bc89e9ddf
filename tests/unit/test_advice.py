"""Controller advice against the closed loop's own poles and a frequency grid."""

import math

import numpy as np
import pytest

from seod.estimate.advice import advise, gain_for, gain_limit, of_estimate
from seod.estimate.plant.free_motion import Dynamics


@pytest.mark.parametrize(("omega_n", "zeta"), [(60.0, 0.1), (100.0, 0.7), (20.0, 2.0)])
def test_without_delay_the_limit_is_two_zeta_omega_n_and_puts_poles_on_the_axis(omega_n, zeta):
    limit = gain_limit(Dynamics(omega_n, zeta))
    assert limit == pytest.approx(2.0 * zeta * omega_n)
    poles = np.roots([1.0 / omega_n**2, 2.0 * zeta / omega_n, 1.0, limit])
    assert max(poles.real) == pytest.approx(0.0, abs=1e-6 * omega_n)


@pytest.mark.parametrize("zeta", [0.1, 0.25, 0.6, 1.5])
@pytest.mark.parametrize("delay", [0.0, 0.004])
def test_margins_hold_exactly_on_a_grid(zeta, delay):
    plant = Dynamics(60.0, zeta, delay)
    gain = gain_for(plant, 2.0, math.radians(45.0))
    w = np.geomspace(0.01, 2000.0, 400_001)
    loop = gain * np.exp(-1j * w * delay) / (1j * w * (1 - (w / 60.0) ** 2 + 2j * zeta * w / 60.0))
    phase = np.unwrap(np.angle(loop))
    phase_margin = np.degrees(math.pi + phase[np.abs(loop) >= 1.0].min())
    gain_margin = 1.0 / np.abs(loop[np.argmax(phase < -math.pi)])
    assert phase_margin > 45.0 - 0.1
    assert gain_margin > 2.0 - 1e-3
    assert phase_margin < 45.2 or gain_margin < 2.002 or np.sum(np.diff(np.abs(loop) >= 0.999) != 0) > 1


def test_the_worst_corner_counts():
    value = {"omega_n": 60.0, "zeta": 0.4, "K_L": 12.0, "delay": 0.0}
    sure, unsure = advise(value, {}), advise(value, {"zeta": 0.04, "K_L": 0.6})
    assert sure.controller_gain_limit == pytest.approx(2 * 0.4 * 60.0 / 12.0)
    assert unsure.controller_gain_limit == pytest.approx(2 * (0.4 - 1.96 * 0.04) * 60.0 / (12.0 + 1.96 * 0.6))
    assert advise(value, {"zeta": 0.3}) is None


def test_only_a_valid_estimate_gives_advice():
    message = {
        "quality": "ok", "zeta": 0.4, "zeta_sd": 0.0, "omega_n": 60.0, "omega_n_sd": None, "K_L": -12.0,
        "K_L_sd": None, "delay_s": None,
    }  # fmt: skip
    assert of_estimate(message)["velocity_gain_limit"] == pytest.approx(48.0)
    assert of_estimate(message | {"quality": "settling"}) is None
    assert of_estimate(message | {"zeta": None}) is None
    assert of_estimate(None) is None


def swung(plant, gain, K_L, steps=9000):
    """Position loop u = K_p (1 - position) through the delay, by Runge and Kutta's method: t, position."""
    omega_n, zeta, delay = plant.omega_n, plant.zeta, plant.delay
    h = 120.0 / gain / steps
    late = round(delay / h)
    h = delay / late if late else h
    state = np.zeros(3)
    past = [0.0] * (late + 2)

    def slope(s, seen):
        u = gain / K_L * (1.0 - seen)
        return np.array([s[1], s[2], omega_n**2 * (K_L * u - s[1]) - 2.0 * zeta * omega_n * s[2]])

    out = []
    for _ in range(steps):
        old, new = (past[-late - 1], past[-late]) if late else (None, None)
        k1 = slope(state, state[0] if old is None else old)
        middle = state + 0.5 * h * k1
        between = None if old is None else 0.5 * (old + new)
        k2 = slope(middle, middle[0] if between is None else between)
        middle = state + 0.5 * h * k2
        k3 = slope(middle, middle[0] if between is None else between)
        end = state + h * k3
        k4 = slope(end, end[0] if new is None else new)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        past.append(state[0])
        out.append(state[0])
    return np.arange(1, steps + 1) * h, np.array(out)


PLANTS = [Dynamics(60.0, 0.25, 0.004), Dynamics(60.0, 0.6, 0.0), Dynamics(100.0, 1.3, 0.006)]


@pytest.mark.parametrize("plant", PLANTS)
def test_the_loop_itself_begins_to_swing_at_the_limit(plant):
    limit = gain_limit(plant)
    for part, grows in ((0.97, False), (1.03, True)):
        _, y = swung(plant, part * limit, 12.0)
        n = len(y) // 3
        early, late = np.ptp(y[n : 2 * n]), np.ptp(y[2 * n :])
        assert (late > early) == grows


@pytest.mark.parametrize("plant", PLANTS)
def test_with_both_margins_the_loop_settles_with_a_moderate_overshoot(plant):
    gain = gain_for(plant, 2.0, math.radians(45.0))
    t, y = swung(plant, gain, 12.0)
    assert y.max() < 1.30
    assert np.abs(y[t > 60.0 / gain] - 1.0).max() < 0.02
    y = swung(plant, 1.94 * gain, 12.0)[1]  # the gain's margin
    n = len(y) // 3
    assert np.ptp(y[2 * n :]) < np.ptp(y[n : 2 * n])


@pytest.mark.parametrize("correlation", [-0.98, 0.0, 0.98])
def test_plants_of_a_correlated_estimate_have_the_margins(correlation):
    """The worst corner is safe for 97.5 % of them at least, whichever way zeta and K_L go together."""
    value = {"omega_n": 60.0, "zeta": 0.4, "K_L": 12.0, "delay": 0.002}
    sd = {"omega_n": 1.2, "zeta": 0.03, "K_L": 0.9, "delay": 0.0003}
    advice = advise(value, sd)
    names = list(value)
    table = np.diag([sd[name] ** 2 for name in names])
    table[1, 2] = table[2, 1] = correlation * sd["zeta"] * sd["K_L"]
    drawn = np.random.default_rng(4).multivariate_normal([value[name] for name in names], table, 400)
    kept = 0
    for omega_n, zeta, K_L, delay in drawn:
        plant = Dynamics(omega_n, zeta, delay)
        kept += advice.controller_gain * K_L <= gain_for(plant, 2.0, math.radians(45.0))
    assert kept >= 0.965 * len(drawn)
