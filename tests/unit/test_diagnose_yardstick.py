"""Models without physics beside the plant's. Truths are integrated by Heun's method."""

import math
from dataclasses import replace

import numpy as np
import pytest
from account_truth import by_heun
from diagnose_truth import RATE, recording
from scipy.signal import lfilter

from seod.diagnose.account.loop import is_closed
from seod.diagnose.account.yardstick import Reached, beaten, yardstick
from seod.diagnose.fitting.held_out import HeldOut
from seod.diagnose.fitting.noise_colour import WHITE, NoiseColour
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.tuning.account import SYSTEMATIC

K_L, OMEGA_N, ZETA = 17.0, 60.0, 0.4
N = 8000


def command(seed=1):
    t, random = np.arange(N) / RATE, np.random.default_rng(seed)
    hz = np.arange(0.5, 20.0, 0.5)
    u = np.cos(2.0 * np.pi * np.outer(t, hz) + random.uniform(0.0, 6.3, len(hz))).sum(axis=1)
    return u / np.max(np.abs(u))


def moved(u, stiffness=lambda x: 1.0, leaves=lambda p: 0.0):
    """Pressure, velocity and position; oil's stiffness by position, and a flow that leaves by pressure."""

    def slope(w, volts):
        p, v, x = w
        flow = K_L * volts - v - 2.0 * ZETA / OMEGA_N * p - leaves(p)
        return np.array([stiffness(x) * OMEGA_N**2 * flow, p, v])

    return by_heun(slope, u)


def halves(u, y, noise=0.01, **more):
    return cut([series(recording(u, y, noise), **more)])


def by_a_plant(windows, y):
    """As if a model had simulated `y`."""
    rows = np.concatenate([np.arange(first, last) for _, first, last in windows.windows])
    good = windows.good & ~windows.started()
    states = np.zeros((len(rows), 7))
    return HeldOut(windows, y[rows], states[:, :5], states[:1], good, np.ones(len(rows), np.bool_))


def stiffer(x):
    """Oil's stiffness where the load is at `x`."""
    return math.exp(4.0 * x)


def relieved(p):
    """What leaves through a valve that opens at 300."""
    return 0.03 * (p - math.copysign(300.0, p)) if abs(p) > 300.0 else 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "noise", "state", "more"),
    [
        (True, 0.01, "position", {"stiffness": stiffer}),
        (False, 1e-4, "position", {"stiffness": stiffer}),
        (True, 0.01, None, {"leaves": relieved}),
    ],
    ids=["stiffness by an integral of y", "stiffness by y", "a pressure that is relieved"],
)
def test_weights_that_change_with_the_state_come_near(speed, noise, state, more):
    u = command()
    y = moved(u, **more)[1 if speed else 2]
    reached = yardstick(*halves(u, y, noise, sees_speed=speed))
    assert reached.narx < 0.6 * reached.arx
    assert reached.changes_with == state


@pytest.mark.slow
def test_a_linear_plant_needs_no_weights_that_change():
    u = command()
    reached = yardstick(*halves(u, moved(u)[1], sees_speed=True))
    assert reached.narx > 0.9 * reached.arx


def nearer(u, y, simulated, **how):
    """By how much models without physics come nearer than what a plant simulates."""
    to_fit, held_out = halves(u, y, sees_speed=True)
    own = [by_a_plant(windows, simulated) for windows in (to_fit, held_out)]
    return beaten(*own, yardstick(to_fit, held_out), WHITE, **how)


@pytest.mark.slow
def test_what_they_foretell_of_unseen_windows_is_systematic():
    u = command()
    found = nearer(u, moved(u, stiffer)[1], moved(u)[1], in_loop=False)
    assert found.significant
    assert found.square > 0.0


@pytest.mark.slow
def test_how_much_nearer_is_told_of_windows_held_out_alone():
    """Also where one of them has no row that counts."""
    u = command()
    to_fit, held_out = halves(u, moved(u, stiffer)[1], sees_speed=True)
    seen, held = (by_a_plant(windows, moved(u)[1]) for windows in (to_fit, held_out))
    scored = held.scored.copy()
    scored[held_out.slices[0]] = False
    reached = yardstick(to_fit, held_out)
    told = beaten(seen, replace(held, scored=scored), reached, WHITE, in_loop=False)
    gained = held.error[scored] ** 2 - (held_out.y - reached.simulated)[scored] ** 2
    assert told.square == pytest.approx(float(np.mean(gained)))


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.95, 0.995])
def test_noise_of_any_colour_is_not_systematic(memory):
    """Beside a simulation that is right; of gusts that move a speed, as of a sensor's noise."""
    for seed in range(4):
        u = command(seed)
        right = moved(u)[1]
        white = np.random.default_rng([9, seed]).normal(size=N + 3000)
        noise = lfilter([1.0], [1.0, -memory], white)[3000:]
        y = right + 0.1 * np.std(right) / np.std(noise) * noise
        assert not nearer(u, y, right, in_loop=False).significant


@pytest.mark.slow
@pytest.mark.parametrize(("chance", "most"), [(SYSTEMATIC.chance, 3), (SYSTEMATIC.chance_alone, 18)])
def test_slow_noise_of_two_models_brings_neither_nearer(chance, most):
    """Errors as large, that remember for a second: parts of a window are alike."""
    u, slow, count = command(), NoiseColour((0.999,), 1.0, 2000.0), 0
    y = moved(u)[2]
    to_fit, held_out = halves(u, y, noise=0.0)
    for seed in range(200):
        white = np.random.default_rng([5, seed]).normal(size=(2, N + 3000))
        one, other = y + lfilter([1.0], [1.0, -0.999], white)[:, 3000:]
        seen, held = by_a_plant(to_fit, one), by_a_plant(held_out, one)
        reached = Reached(
            1.0, 1.0, by_a_plant(held_out, other).simulated, by_a_plant(to_fit, other).simulated
        )
        count += beaten(seen, held, reached, slow, in_loop=False, chance=chance).significant
    assert count <= most


def test_commands_of_a_loop_answer_to_what_was_not_foretold():
    """A servo loop with noise on its sensor, and the same commands beside noise of another run."""
    random = np.random.default_rng(4)
    reference, noise = np.cumsum(random.normal(size=N)), random.normal(size=(2, N))
    y, u = np.zeros(N), np.zeros(N)
    for k in range(1, N):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1] + noise[0, k]
        u[k] = 0.5 * (reference[k] - y[k])
    assert is_closed(np.split(u, 8), np.split(noise[0], 8))
    assert not is_closed(np.split(u, 8), np.split(noise[1], 8))
