"""What is left is larger where the load moves more: noise is not. The truth is integrated here."""

from dataclasses import replace

import numpy as np
import pytest
from account_truth import K_L, OMEGA_N, ZETA, N, by_heun, coloured, multisine, parts_of
from diagnose_truth import RATE, recording

from seod.diagnose.account.account import systematic
from seod.diagnose.account.residual import Plant
from seod.diagnose.account.with_movement import comes_with_movement
from seod.diagnose.fitting.noise_colour import colour
from seod.diagnose.record.series import series

PLANT = Plant(OMEGA_N, ZETA, sees_speed=False)
CHANCE = 0.002


def operation(seed=5):
    """Moves of a machine, each of another length, size and direction, with rests between them."""
    u, random = np.zeros(N), np.random.default_rng(seed)
    at = 100
    while at < N - 300:
        length = int(random.integers(60, 300))
        u[at : at + length] = random.choice([-1.0, 1.0]) * random.uniform(0.1, 1.0)
        at += length + int(random.integers(100, 900))
    return u


def moved(u, volume=0.0):
    """States of Eq. 1 whose oil is as stiff as 1 + volume * position makes it."""

    def slope(w, volts):
        p, v, x = w
        stiff = OMEGA_N**2 / (1.0 + volume * np.tanh(x))
        return np.array([stiff * (K_L * volts - v) - 2.0 * ZETA * OMEGA_N * p, p, v])

    return by_heun(slope, u)


def level(error):
    """But for what each window begins with."""
    return np.concatenate([each - each.mean() for each in np.split(error, 8)])


def part_of(u, error, states):
    parts = parts_of(u, error, states)
    return comes_with_movement(parts, PLANT, colour(parts), CHANCE)


@pytest.fixture(scope="module")
def machine():
    """Commands, Eq. 1's states, and what a volume that changes with the position changes."""
    u = operation()
    plain = moved(u)
    return u, plain, level(moved(u, volume=0.4)[2] - plain[2])


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99])
def test_noise_is_as_large_at_rest(machine, memory):
    u, states, _ = machine
    assert [part_of(u, coloured(memory, 1.0, seed), states) for seed in range(30, 38)] == [0.0] * 8


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_what_a_wrong_plant_leaves_is_not(machine, memory):
    u, states, effect = machine
    size = float(np.std(effect))
    assert 0.6 < part_of(u, effect + coloured(memory, 0.1 * size), states) <= 1.0


def test_a_recording_that_moves_more_may_have_more_noise():
    """Two recordings of one rig, each with as much noise for its movement: no wrong plant."""
    parts = []
    for file, size in enumerate((1.0, 0.2)):
        u = size * multisine()
        each = parts_of(u, coloured(0.9, 0.1 * size, 40 + file), moved(u))
        parts += [replace(one, file=file) for one in each]
    assert comes_with_movement(parts, PLANT, colour(parts), CHANCE) == 0.0


def test_under_a_command_without_rest_nothing_is_said():
    """All periods of a multisine move alike: what is left there is shown by what repeats."""
    u = multisine()
    states = moved(u)
    noise = coloured(0.9, 0.1)
    assert part_of(u, noise + level(moved(u, volume=0.4)[2] - states[2]), states) < 0.5


def test_a_few_periods_say_nothing(machine):
    u, states, effect = machine
    few = parts_of(u, effect + coloured(0.0, 0.1 * float(np.std(effect))), states)[:1]
    assert comes_with_movement(few, PLANT, colour(few), CHANCE) == 0.0


def test_it_is_not_asked_of_a_sensor_that_errs_as_the_load_moves(machine):
    """Steps of a coarse one stand still with the load, and samples taken late err by speed times delay."""
    u, states, effect = machine
    noise = coloured(0.0, 0.1 * float(np.std(effect)))
    parts = parts_of(u, effect + noise, states)
    one = series(recording(u, states[2] + effect + noise))
    assert systematic(parts, [one], PLANT, in_loop=False).by == "movement"
    assert systematic(parts, [replace(one, step=0.1)], PLANT, in_loop=False).by != "movement"
    assert systematic(parts, [replace(one, late=1e-6)], PLANT, in_loop=False).by != "movement"


def test_a_recording_with_jitter_is_told_as_one_that_does():
    t, random = np.arange(N) / RATE, np.random.default_rng(9)
    y = np.sin(40.0 * (t + random.normal(0.0, 1e-4, N)))
    u = np.sign(np.sin(40.0 * t))
    assert series(recording(u, y), late=1e-6).errs_as_it_moves
    assert series(recording(u, y), step=0.1).errs_as_it_moves
    assert not series(recording(u, y)).errs_as_it_moves
