"""Controller advice against the closed loop's own poles and a frequency grid."""

import math

import numpy as np
import pytest

from seod.estimate.advice import advise, gain_for, gain_limit, of_estimate
from seod.estimate.plant_response import Dynamics


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
