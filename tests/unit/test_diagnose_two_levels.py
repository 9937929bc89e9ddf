"""Commands of two values: a relay's, which answers to the movement, or a clock's.

The rig is a mass on oil in plain small steps, friction by the sign of the speed and a rule for rest.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnose_truth import RATE, recording
from scipy.signal import lfilter

from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.record.relay import relayed

STEPS = 20
K_L, OMEGA_N, ZETA = 10.0, 60.0, 0.4
SECONDS = 8.0
T = np.arange(round(SECONDS * RATE)) / RATE


def rig(command, k_l=K_L, level=0.0, lag_s=0.0):
    """Commands and positions; a command is given by its row and the position seen there."""
    x = v = a = opening = 0.0
    h, b = 1.0 / (RATE * STEPS), 2.0 * ZETA * OMEGA_N
    u, y = [], []
    for k in range(len(T)):
        u.append(command(k, x))
        y.append(x)
        for _ in range(STEPS):
            opening = opening + h * (u[-1] - opening) / lag_s if lag_s else u[-1]
            push = a - b * v
            way = math.copysign(1.0, v) if v else math.copysign(1.0, push)
            then = v + h * (push - level * way)
            if level and ((v == 0.0 and abs(push) <= level) or then * v < 0.0):
                then = 0.0
            a += h * OMEGA_N**2 * (k_l * opening - v)
            v = then
            x += h * v
    return np.array(u), np.array(y)


def relay(sign=1.0, sizes=(2.0,)):
    """Of so many sizes one after the other, each for a fifth of a second."""

    def command(k, x):
        size = sizes[int(T[k] / 0.2) % len(sizes)]
        return -sign * size if x > 0.0 else sign * size

    return command


def square(hz, size=2.0):
    return lambda k, _: size if (T[k] * hz + 0.1) % 1.0 < 0.5 else -size


def binary_noise(clock_s, size=2.0, seed=8):
    values = np.random.default_rng(seed).choice([-size, size], len(T))
    return lambda k, _: values[int(T[k] / clock_s + 1e-9)]


@pytest.mark.parametrize(
    ("command", "sign"),
    [
        pytest.param(relay(), 1.0, id="relay"),
        pytest.param(relay(-1.0), -1.0, id="the other sign"),
        pytest.param(relay(sizes=(2.0, 1.0)), 1.0, id="two sizes"),
    ],
)
def test_a_relay_is_known(command, sign):
    u, y = rig(command, sign * K_L)
    assert relayed(u, y)


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(square(0.5), id="a slow square wave"),
        pytest.param(square(2.0), id="a square wave"),
        pytest.param(binary_noise(0.02), id="binary noise"),
        pytest.param(binary_noise(0.1), id="slow binary noise"),
    ],
)
def test_a_table_of_two_commands_is_no_relay(command):
    assert not relayed(*rig(command))


@pytest.mark.parametrize(("clock_s", "seed"), [(0.05, 0), (0.1, 2), (0.1, 6), (0.1, 9)])
def test_binary_noise_that_a_slow_valve_follows_late_is_no_relay(clock_s, seed):
    assert not relayed(*rig(binary_noise(clock_s, seed=seed), lag_s=0.03))


@pytest.mark.parametrize("hz", [2.0, 5.0])
def test_a_square_wave_against_a_spring_is_no_relay(hz):
    """The position comes to rest, or turns round, where the command switches."""
    u = np.array([square(hz)(k, 0.0) for k in range(len(T))])
    kept = math.exp(-1.0 / (0.04 * RATE))
    assert not relayed(u, lfilter([1.0 - kept], [1.0, -kept], u))


def test_of_few_periods_or_many_levels_nothing_is_a_relay():
    u, y = rig(relay())
    few = T < 0.2
    assert not relayed(u[few], y[few])
    assert not relayed(u * np.linspace(1.0, 2.0, len(u)), y)
    assert not relayed(np.ones(len(T)), y)


@pytest.mark.slow
@pytest.mark.computes
@pytest.mark.parametrize(
    ("command", "level"),
    [
        pytest.param(square(0.6), 0.0, id="a square wave alone"),
        pytest.param(square(1.0), 200.0, id="a square wave with friction"),
        pytest.param(binary_noise(0.02), 200.0, id="binary noise with friction"),
    ],
)
def test_what_two_commands_show(command, level):
    found = diagnose(
        [recording(*rig(command, level=level), noise=4e-3 if level == 0.0 else 2e-3)],
        (),
        Options(effort="quick"),
    )
    assert [each.name for each in found.effects] == ["coulomb_friction"] * (level > 0.0)
    assert found.extended.omega_n == pytest.approx(OMEGA_N, rel=0.02)
    assert found.extended.zeta == pytest.approx(ZETA, rel=0.03)
    assert "valve_deadband" in found.next_experiment.separates  # which two commands hide
    for each in found.effects:
        assert each.parameters["level"].value == pytest.approx(level, rel=0.05)
        assert each.gain.nrmse_without == pytest.approx(found.baseline.holdout_nrmse, rel=0.02)
