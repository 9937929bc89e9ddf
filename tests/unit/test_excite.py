"""Controllers, by hand-made errors and times."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seod.loop.excite import PolarityPulse, PositionHold, Relay


def test_relay_switches_at_its_hysteresis() -> None:
    relay = Relay(start=0.0, entry=0.0, e_a=0.5, hysteresis=0.1)
    errors = [0.05, 0.11, 0.0, -0.1, -0.11, 0.1, 0.11]
    assert [round(relay.step(1.0, e), 9) for e in errors] == [0.5, 0.5, 0.5, 0.5, -0.5, -0.5, 0.5]


@given(st.lists(st.floats(-1, 1), min_size=1), st.floats(0, 0.5))
def test_relay_has_two_levels_only(errors: list[float], hysteresis: float) -> None:
    relay = Relay(0.0, 0.0, 0.5, hysteresis)
    assert {relay.step(k, e) for k, e in enumerate(errors)} <= {0.5, -0.5}


def test_relay_rises_linearly() -> None:
    relay = Relay(start=10.0, entry=0.1, e_a=0.5, hysteresis=0.0)
    assert relay.step(10.0, 1.0) == 0.0
    assert relay.step(10.05, 1.0) == pytest.approx(0.25)
    assert relay.step(10.2, -1.0) == -0.5


def test_hold_is_proportional_and_limited() -> None:
    hold = PositionHold(gain=2.0, limit=0.5)
    assert [hold.step(0.0, e) for e in (0.1, -0.1, 9.0, -9.0)] == pytest.approx([0.2, -0.2, 0.5, -0.5])


def play(pulse: PolarityPulse, speed_per_volt: float, drift: float, noise: float = 0.0) -> None:
    position, t = 0.3, pulse.start
    while pulse.result is None and t < pulse.start + 1.0:
        volts = pulse.step(t, -position + noise * math.cos(1e4 * t))
        position += (speed_per_volt * volts + drift) * 1e-3
        t += 1e-3


@pytest.mark.parametrize("drift", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("gain", [17.0, -17.0])
def test_pulse_tells_the_sign_through_drift_and_noise(gain: float, drift: float) -> None:
    pulse = PolarityPulse(start=5.0, voltage=0.5, duration=0.05, movement=0.05)
    play(pulse, gain, drift, noise=1e-3)
    assert pulse.result is not None
    assert pulse.result.ok is (gain > 0)
    assert ("wrong sign" in pulse.result.why) is (gain < 0)
    assert pulse.step(6.0, 0.0) == 0.0  # nothing once it knows


@pytest.mark.parametrize("gain", [17.0, -17.0])
def test_single_noisy_samples_decide_nothing(gain: float) -> None:
    """Noise of 0.4 of the movement that counts: one sample in eighty is beyond it by chance."""
    for seed in range(200):
        noise = random.Random(seed)
        pulse = PolarityPulse(start=0.0, voltage=0.5, duration=0.05, movement=0.05)
        position, t = 0.0, 0.0
        while pulse.result is None:
            volts = pulse.step(t, -position - noise.gauss(0.0, 0.02))
            position += gain * volts * 5e-4
            t += 5e-4
        assert pulse.result.ok is (gain > 0), seed


def test_pulse_without_movement_is_told_from_a_wrong_sign() -> None:
    pulse = PolarityPulse(start=0.0, voltage=0.5, duration=0.05, movement=0.05)
    play(pulse, 0.1, 0.0)
    assert pulse.result is not None
    assert not pulse.result.ok
    assert "no movement" in pulse.result.why
