"""The colour of what is left: its memory from row to row, and noise drawn like it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from account_truth import N, coloured, parts_of
from scipy.signal import freqz, lfilter

from seod.diagnose.account.residual import WindowResidual
from seod.diagnose.fitting.noise_colour import NoiseColour, colour


@pytest.mark.parametrize("memory", [(), (0.95,), (0.5, 0.3, 0.1)])
def test_noise_is_drawn_with_its_colour(memory):
    drawn = NoiseColour(memory, 1.0, 1.0).drawn(40_000, 3, np.random.default_rng(1))
    past = np.array([drawn[3 - k : -k] for k in range(1, 4)]).reshape(3, -1)
    found = np.linalg.lstsq(past.T, drawn[3:].ravel(), rcond=None)[0]
    assert found == pytest.approx([*memory, 0.0, 0.0, 0.0][:3], abs=0.02)


def test_noise_whose_fit_grows_does_not():
    assert np.abs(NoiseColour((1.01,), 1.0, math.inf).drawn(3000, 3, np.random.default_rng(1))).max() < 1e3


@pytest.mark.parametrize(("memory", "order"), [(0.0, 0), (0.95, 1), (0.99, 1)])
def test_the_colour_of_noise_is_found(memory, order):
    noise = coloured(memory, 0.2)
    found = colour(parts_of(noise, noise, np.zeros((3, N))))
    assert found.order == order
    assert found.sd == pytest.approx(0.2, rel=0.25)
    assert found.correlation == pytest.approx((1.0 + memory) / (1.0 - memory), rel=0.3)


def pieces_of(noise, count):
    """Noise as what is left of so many windows."""
    pieces = np.split(noise[: len(noise) // count * count], count)
    return [WindowResidual(0, each, each, each, each < np.inf, each, each, each, False) for each in pieces]


@pytest.mark.parametrize("of_sensor", [0.0, 0.2, 2.0])
def test_of_a_load_s_noise_below_a_sensor_s_all_is_foretold_that_can_be(of_sensor):
    """What no past foretells has the mean log spectrum's power (Kolmogorov)."""
    poles = np.array([0.999, 0.97 * np.exp(0.12j), 0.97 * np.exp(-0.12j)])
    a, random = np.real(np.poly(poles)), np.random.default_rng(5)
    load = lfilter([1e-3], a, random.normal(size=3 * N))
    noise = load + of_sensor * random.normal(size=3 * N)
    parts = pieces_of(noise, 4)
    omega = np.linspace(1e-5, np.pi, 200_001)
    power = np.abs(freqz([1e-3], a, omega)[1]) ** 2 + of_sensor**2
    least = np.exp(0.5 * np.mean(np.log(power)))
    found = colour(parts)
    white = np.concatenate([found.whitened(one.error)[found.order :] for one in parts])
    assert np.std(white) == pytest.approx(least, rel=0.01)
    drawn = np.std(white) * found.drawn(3 * N, 8, np.random.default_rng(6))
    assert np.std(np.diff(drawn, axis=0)) == pytest.approx(np.std(np.diff(noise)), rel=0.05)
    assert found.order < 8 if of_sensor == 0.0 else found.order > 8


def test_short_windows_keep_their_rows_for_short_memories():
    noise = np.concatenate([coloured(0.95, 0.2, seed) for seed in range(4)])
    assert colour(pieces_of(noise, len(noise) // 40)).memory[0] == pytest.approx(0.95, abs=0.08)


def scored_again(parts, scored):
    """The same windows, other rows of which count."""
    return [replace(one, scored=scored) for one in parts]


@pytest.mark.parametrize("count", [1, 8])
def test_the_colour_of_noise_is_found_across_holes(count):
    """Alternating noise: rows on both sides of a hole of one row are alike, neighbours are not."""
    noise = coloured(-0.9, 0.2)
    parts = parts_of(noise, noise, np.zeros((3, N)), count)
    scored = np.arange(N // count) % 20 != 0
    found = colour(scored_again(parts, scored))
    assert found.order == 1
    assert found.memory[0] == pytest.approx(-0.9, abs=0.03)


def test_a_sensor_that_repeats_readings_has_neighbours():
    readings = coloured(0.9, 0.2)[: N // 4]
    parts = parts_of(readings, np.repeat(readings, 4), np.zeros((3, N)))
    found = colour(scored_again(parts, np.arange(N // 8) % 4 == 0))
    assert found.memory == pytest.approx((0.9,), abs=0.05)


@pytest.mark.parametrize("kept", [lambda k: k < 8, lambda k: k % 3 == 0], ids=["few rows", "rows apart"])
def test_noise_of_rows_that_foretell_none_is_white(kept):
    """Half of the windows count in full, half hardly at all."""
    noise = coloured(0.9, 0.2)
    parts = parts_of(noise, noise, np.zeros((3, N)), 100)
    few = kept(np.arange(N // 100)) & (np.arange(N // 100) % 9 > 0)
    for first in (0, 1):
        some = [replace(one, scored=few) if k % 2 == first else one for k, one in enumerate(parts)]
        assert colour(some).order == 0
