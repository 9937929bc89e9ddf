"""Controllers, by hand-made errors and times."""

from __future__ import annotations

import itertools
import math
import random
import re
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seod.loop.excite import PolarityPulse, PositionHold, Relay

if TYPE_CHECKING:
    from collections.abc import Iterator


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


class Sampled:
    """A pulse whose samples are as new as its ticks, or come each `every` ticks."""

    def __init__(self, duration: float | None = 0.05, movement: float = 0.05, start: float = 0.0) -> None:
        self.t = -math.inf
        self.pulse = PolarityPulse(start, 0.5, duration, movement, lambda: self.t, "valve")

    def step(self, t: float, e: float, fresh: bool = True) -> float:
        if fresh:
            self.t = t
        return self.pulse.step(t, e)

    @property
    def why(self) -> str:
        assert self.pulse.result is not None
        return self.pulse.result.why

    @property
    def ok(self) -> bool:
        assert self.pulse.result is not None
        return self.pulse.result.ok


def play(pulse: Sampled, speed_per_volt: float, drift: float, noise: float = 0.0) -> None:
    position, t = 0.3, 5.0
    while pulse.pulse.result is None and t < 6.0:
        volts = pulse.step(t, -position + noise * math.cos(1e4 * t))
        position += (speed_per_volt * volts + drift) * 1e-3
        t += 1e-3


@pytest.mark.parametrize("drift", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("gain", [17.0, -17.0])
def test_pulse_tells_the_sign_through_drift_and_noise(gain: float, drift: float) -> None:
    pulse = Sampled(start=5.0)
    play(pulse, gain, drift, noise=1e-3)
    assert pulse.ok is (gain > 0)
    assert ("wrong sign" in pulse.why) is (gain < 0)
    assert pulse.step(6.0, 0.0) == 0.0  # nothing once it knows


@pytest.mark.parametrize("gain", [17.0, -17.0])
@pytest.mark.parametrize("from_speed", [30.0, -30.0])
def test_an_actuator_that_comes_to_rest_is_watched_until_it_has(gain: float, from_speed: float) -> None:
    """After a fault it coasts: its last movement, a curve, is no answer to the pulse."""
    pulse = Sampled()
    position, speed, t = 0.0, from_speed, 0.0
    while pulse.pulse.result is None:
        volts = pulse.step(t, -position)
        position += (gain * volts + speed) * 5e-4
        speed *= 1.0 - 5e-4 / 0.03
        t += 5e-4
    assert pulse.ok is (gain > 0), pulse.why
    assert t > 0.1


@pytest.mark.parametrize("gain", [17.0, -17.0])
def test_an_actuator_that_rings_is_watched_until_it_is_still(gain: float) -> None:
    """As after a fault within a limit cycle: 18 Hz, damped by 0.21, wherever in its period it is."""
    for k in range(40):
        pulse, position, t = Sampled(movement=0.03), 0.0, 0.0
        while pulse.pulse.result is None:
            ring = 0.1 * math.exp(-24.6 * t) * math.sin(114.0 * t + 0.157 * k)
            volts = pulse.step(t, -position - ring)
            position += gain * volts * 5e-4
            t += 5e-4
        assert pulse.ok is (gain > 0), (k, pulse.why)


@pytest.mark.parametrize("gain", [25.0, -25.0])
@pytest.mark.parametrize("step", [0.4, -0.4])
@pytest.mark.parametrize("after", [0.012, 0.022, 0.032, 0.042])
def test_a_step_while_few_samples_are_watched_is_no_drift(gain: float, step: float, after: float) -> None:
    """100 samples a second of a slow actuator: a line through five of them says little of 100 ms later."""
    pulse, position, speed, t = Sampled(duration=None, movement=1.0), 0.0, 0.0, 0.0
    noise = random.Random(1)
    while pulse.pulse.result is None:
        volts = pulse.step(t, -position - (step if t > after else 0.0) - noise.gauss(0.0, 0.01))
        speed += (2.0 * gain * volts - speed) * 0.01 / 0.05
        position += speed * 0.01
        t += 0.01
    assert pulse.ok is (gain > 0), pulse.why
    assert ("wrong sign" in pulse.why) is (gain < 0), pulse.why


@pytest.mark.parametrize("gain", [50.0, -50.0])
@pytest.mark.parametrize("scale", [1.0, 1.02, 1.04, 1.06, 1.08])
def test_a_load_that_a_first_pulse_left_moving_is_watched_until_it_is_still(
    gain: float, scale: float
) -> None:
    """20 rad/s damped by 0.3, 100 samples a second: the first pulse ends just as the movement gets clear."""
    pulse, t, volts = Sampled(duration=None, movement=1.0), 0.0, 0.0
    position = speed = pull = 0.0
    noise = random.Random(1)
    while pulse.pulse.result is None:
        for _ in range(20):  # of 0.5 ms
            pull += (400.0 * (gain * volts - speed) - 12.0 * pull) * 5e-4
            speed += pull * 5e-4
            position += speed * 5e-4
        t += 0.01
        volts = pulse.step(t, -position * scale - noise.gauss(0.0, 0.01))
    assert pulse.ok is (gain > 0), pulse.why
    assert ("wrong sign" in pulse.why) is (gain < 0), pulse.why


@pytest.mark.parametrize("gain", [50.0, -50.0])
@pytest.mark.parametrize("late", [2, 5, 8, 9])
def test_a_load_left_moving_by_a_pulse_too_short_is_not_asked_again_before_it_is_still(
    gain: float, late: int
) -> None:
    """As above, with a tick so late that the first pulse has too few samples to tell anything."""
    pulse, t, volts = Sampled(duration=None, movement=1.0), 0.0, 0.0
    position = speed = pull = 0.0
    noise, ticks = random.Random(1), 0
    while pulse.pulse.result is None:
        ticks += 1
        steps = 20 if ticks != 10 + late else 400  # of 0.5 ms
        for _ in range(steps):
            pull += (400.0 * (gain * volts - speed) - 12.0 * pull) * 5e-4
            speed += pull * 5e-4
            position += speed * 5e-4
        t += steps * 5e-4
        volts = pulse.step(t, -position - noise.gauss(0.0, 0.01))
    assert pulse.ok is (gain > 0), pulse.why
    assert ("wrong sign" in pulse.why) is (gain < 0), pulse.why


@pytest.mark.parametrize("gain", [17.0, -17.0])
def test_single_noisy_samples_decide_nothing(gain: float) -> None:
    """Noise of 0.4 of the movement that counts: one sample in eighty is beyond it by chance."""
    for seed in range(200):
        noise = random.Random(seed)
        pulse = Sampled()
        position, t = 0.0, 0.0
        while pulse.pulse.result is None:
            volts = pulse.step(t, -position - noise.gauss(0.0, 0.02))
            position += gain * volts * 5e-4
            t += 5e-4
        assert pulse.ok is (gain > 0), seed


def test_pulse_without_movement_is_told_from_a_wrong_sign() -> None:
    pulse = Sampled(start=5.0)
    play(pulse, 0.1, 0.0)
    assert not pulse.ok
    for part in ("no movement", "polarity.pulse", "polarity.duration (now 0.05 s)", "outputs.valve.enable"):
        assert part in pulse.why


def times(period: float, late_at: float, late: float) -> Iterator[float]:
    """Ticks, one of them late, the others where they belong."""
    for k in range(10_000):
        t = k * period
        if not late_at <= t < late_at + late:
            yield t


@pytest.mark.parametrize("period", [5e-4, 2e-3, 5e-3])
@pytest.mark.parametrize("late", [0.02, 0.06, 0.12])
def test_a_late_tick_is_no_missing_movement(period: float, late: float) -> None:
    """Wherever it falls: in the drift, at the pulse's beginning or within it."""
    for late_at in (0.01, 0.0475, 0.05, 0.0525, 0.06, 0.08):
        pulse, position, before, volts = Sampled(), 0.0, 0.0, 0.0
        for t in times(period, late_at, late):
            position += 4.0 * volts * (t - before)
            before, volts = t, pulse.step(t, -position)
            if pulse.pulse.result is not None:
                break
        assert pulse.ok, (late_at, pulse.why)


@pytest.mark.parametrize("rate_hz", [100, 150, 200, 1000])
@pytest.mark.parametrize("every", [1, 2, 5])
def test_slow_ticks_and_samples_get_a_pulse_that_is_long_enough(rate_hz: int, every: int) -> None:
    """Two samples of dead time, then 20 rad/s of an actuator; the length is left to the pulse."""
    pulse, position, volts = Sampled(duration=None, movement=0.01), 0.0, [0.0] * (2 * every)
    for k in range(10_000):
        position += 4.0 * volts[-2 * every] / rate_hz
        volts.append(pulse.step(k / rate_hz, -position, fresh=k % every == 0))
        if pulse.pulse.result is not None:
            break
    assert pulse.ok, pulse.why


def test_one_sample_seen_in_many_ticks_is_one_sample() -> None:
    """A single outlier, and the sensor comes each tenth tick: no three in a row."""
    pulse = Sampled()
    for k in range(1000):
        e = -0.2 if 80 <= k < 90 else 0.0
        pulse.step(k * 1e-3, e, fresh=k % 10 == 0)
    assert "no movement" in pulse.why


def test_a_movement_seen_too_late_does_not_contradict_itself() -> None:
    pulse = Sampled(movement=0.001)
    e, pulsed = 0.0, 0
    for k in range(1000):
        pulsed = pulsed + 1 if pulse.step(k * 1e-2, e) else 0
        e -= 0.00173 * (pulsed == 5)
    assert "less than" not in pulse.why
    assert re.search("beyond polarity.movement = 0.001 in the last [12] samples, and 3 are needed", pulse.why)
    assert "polarity.duration (now 0.05 s)" in pulse.why


def test_a_pulse_of_too_few_samples_says_so_after_three_tries() -> None:
    pulse = Sampled(duration=0.02)
    levels = [pulse.step(k * 1e-2, 0.0) for k in range(1000)]
    assert sum(a == 0.0 < b for a, b in itertools.pairwise(levels)) == 3
    assert "samples, and 5 are needed: ticks or samples come late" in pulse.why
    assert "polarity.duration" in pulse.why
