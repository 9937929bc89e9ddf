"""A sensor's curve over part of a turn: named, with its size and shape, from records of closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Legendre
from scipy.optimize import least_squares
from scipy.signal import lsim

from seod.data import Recording
from seod.diagnose.pipeline import Options, diagnose

K_L, OMEGA_N, ZETA = 3.0, 30.0, 0.4
TICK, N, NOISE = 2e-3, 5000, 2e-3
T = np.arange(N) * TICK


def servo(seed):
    """Command and position [rad] of Eq. 1 that goes to places within half a turn, by scipy's exponential."""
    random = np.random.default_rng(seed)
    places = np.repeat(random.uniform(-1.3, 1.3, N // 125), 125)
    gain, square = 6.0, OMEGA_N**2
    loop = [1.0, 2.0 * ZETA * OMEGA_N, square, gain * K_L * square / 3.0]
    x = lsim(([gain * K_L * square / 3.0], loop), places, T, interp=False)[1]
    return gain / 3.0 * (places - x), x


def offset_of(x, u):
    """The position by the commands as they were held: the record's own truth."""
    held = lsim(([K_L * OMEGA_N**2], [1.0, 2.0 * ZETA * OMEGA_N, OMEGA_N**2, 0.0]), u, T, interp=False)[1]
    assert np.std(held - x) < 0.2 * np.std(x)
    return held


def told_of(reads, seed=3):
    u, x = servo(seed)
    x = offset_of(x, u)
    y = reads(x) + np.random.default_rng(seed).normal(0.0, NOISE, N)
    one = Recording((Path("servo.csv"),), T, u, y, None, None, None, np.arange(N), {}, {}, ())
    return x, diagnose([one], (), Options("position")).as_json()


SHAPES = {
    "an eccentric encoder": lambda x: x + 0.05 * np.sin(x + 0.7),
    "a lever": lambda x: 1.8 * np.sin((x + 0.2) / 1.8),
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_a_curve_over_part_of_a_turn_is_named_with_its_shape(shape):
    x, told = told_of(SHAPES[shape])
    assert (told["verdict"], [one["name"] for one in told["effects"]]) == ("effects", ["sensor_nonlinearity"])
    parts = {name: of["value"] for name, of in told["effects"][0]["parameters"].items()}
    middle, half = parts["centre"], parts["half"]
    curve = Legendre([0.0, 0.0, *(parts[f"order_{n}"] for n in range(2, 7))])
    places = np.linspace(np.quantile(x, 0.01), np.quantile(x, 0.99), 91)
    true = SHAPES[shape](places)
    assert middle - half < np.min(true) < np.max(true) < middle + half

    def off(line):
        """Of the model, whose positions are a line over those of the load."""
        at = line[0] + line[1] * places
        return at + curve((at - middle) / half) - true

    best = least_squares(off, [0.0, told["extended"]["K_L"] / K_L])
    assert best.x[1] == pytest.approx(told["extended"]["K_L"] / K_L, rel=0.01)
    bent = true - np.polyval(np.polyfit(places, true, 1), places)
    assert np.max(np.abs(best.fun)) < 0.1 * np.max(np.abs(bent))


@pytest.mark.slow
def test_a_straight_sensor_has_no_curve():
    told = told_of(lambda x: 1.02 * x + 0.1)[1]
    assert (told["verdict"], told["effects"]) == ("clean", [])
