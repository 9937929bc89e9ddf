"""The guard trips on each thing that must stop a rig, says so with numbers, and not a moment before."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import NO_SAMPLE, Sample
from seod.config.axis import LimitsConfig
from seod.config.guard import EstopConfig, GuardConfig
from seod.loop import guard
from seod.loop.motion import SpeedMeter

LIMITS = {"output": 1.0, "travel": (-1.0, 1.0), "speed": 10.0, "amplitude": 0.2, "excitation": 10.0}


def axis_guard(**changes: object) -> guard.AxisGuard:
    limits = LimitsConfig.model_validate({**LIMITS, **changes})
    return guard.AxisGuard("motor", limits, GuardConfig.model_validate({"rig_watchdog": 0.02}))


def feed(judge: guard.AxisGuard, points: list[tuple[float, float]], exciting: bool = True) -> str | None:
    for t, y in points:
        trip = judge.inspect(t, Sample(y, t), y, y if exciting else None, exciting, exciting)
        if trip is not None:
            return trip.code
    return None


def sine(amplitude: float, hertz: float, seconds: float, growth: float = 1.0) -> list[tuple[float, float]]:
    times = [k * 5e-4 for k in range(int(seconds / 5e-4))]
    return [(t, amplitude * growth**t * math.sin(2 * math.pi * hertz * t)) for t in times]


def test_a_healthy_limit_cycle_passes() -> None:
    assert feed(axis_guard(), sine(0.19, 8.0, 3.0)) is None


def test_each_limit_trips() -> None:
    assert feed(axis_guard(), sine(0.21, 5.0, 1.0)) == "amplitude"
    assert feed(axis_guard(amplitude=2.0), sine(1.1, 0.5, 2.0)) == "travel"
    assert feed(axis_guard(amplitude=2.0), sine(0.9, 2.0, 1.0)) == "speed"
    assert feed(axis_guard(), sine(0.02, 8.0, 3.0, growth=5.0)) == "amplitude_growth"


@pytest.mark.parametrize("hertz", [0.3, 1.0, 3.0, 8.0, 18.0])
def test_growth_is_that_of_whole_oscillations(hertz: float) -> None:
    steady = sine(0.19, hertz, 20.0 / hertz)
    assert feed(axis_guard(speed=1e3), steady) is None
    growing = sine(0.02, hertz, 40.0 / hertz, growth=min(1.4**hertz, 6.0))
    assert feed(axis_guard(amplitude=0.9, speed=1e3), growing) == "amplitude_growth"


def test_growth_counts_only_when_told_so() -> None:
    judge = axis_guard()
    for t, y in sine(0.005, 8.0, 1.6, growth=8.0):
        assert judge.inspect(t, Sample(y, t), y, y, True, False) is None


def test_frozen_sensor_trips_only_while_the_relay_is_on() -> None:
    still = [(k * 1e-3, 0.1) for k in range(300)]
    assert feed(axis_guard(), still, exciting=False) is None
    assert feed(axis_guard(), still) == "frozen_sensor"
    assert feed(axis_guard(), still[:240]) is None


def test_stale_and_unheard_samples() -> None:
    judge = axis_guard()
    assert judge.ready(1.0, Sample(0.0, 0.9905), 0.0) is None
    stale = judge.ready(1.0, Sample(0.0, 0.985), 0.0)
    assert stale is not None
    assert stale.code == "stale_sample"
    assert "15.0 ms" in stale.why
    never = judge.ready(1.0, NO_SAMPLE, math.nan)
    assert never is not None
    assert "never heard of" in never.why


def test_a_reading_that_is_no_number_trips() -> None:
    for y in (math.nan, math.inf, -math.inf):
        trip = axis_guard().inspect(1.0, Sample(y, 1.0), y, y, True, False)
        assert trip is not None
        assert trip.code == "non_finite"


@given(
    st.lists(st.tuples(st.floats(1e-5, 0.1), st.floats(-1e6, 1e6)), min_size=1, max_size=50),
    st.floats(0.1, 1e5),
)
def test_no_command_passes_output_or_slew_limit(steps: list[tuple[float, float]], slew: float) -> None:
    judge = axis_guard(slew=slew)
    judge.neutral(0.0)
    t, last = 0.0, 0.0
    for dt, asked in steps:
        t += dt
        passed = judge.pass_command(t, asked)
        assert abs(passed) <= 1.0
        assert abs(passed - last) <= slew * dt * (1 + 1e-6) + 1e-12
        last = passed


def test_without_a_slew_limit_the_relay_steps() -> None:
    judge = axis_guard()
    assert [judge.pass_command(k * 1e-3, u) for k, u in enumerate((0.5, -0.5, 3.0))] == [0.5, -0.5, 1.0]


def test_overruns_trip_in_bursts_only() -> None:
    period = 5e-4
    slow = guard.OverrunGuard(3, 0.1)
    assert all(slow.inspect(t, 2 * period, period) is None for t in (0.0, 1.0, 2.0, 3.0))
    assert all(slow.inspect(4 + t, 0.9 * period, period) is None for t in (0.0, 0.01, 0.02, 0.03))
    assert slow.inspect(5.0, 2 * period, period) is None
    assert slow.inspect(5.01, 2 * period, period) is None
    trip = slow.inspect(5.02, 2 * period, period)
    assert trip is not None
    assert trip.numbers["count"] == 3


def trip_of(judge: guard.AxisGuard, points: list[tuple[float, float]]) -> guard.Trip:
    for t, y in points:
        trip = judge.inspect(t, Sample(y, t), y, y, True, True)
        if trip is not None:
            return trip
    raise AssertionError("no trip")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sign_that_flips_is_told_as_one(sign: float) -> None:
    """A sensor whose sign flips for one sample or for good is over the speed limit, which says little."""
    steady = [(t, sign * (0.15 + 0.02 * t)) for t, _ in sine(0.1, 8.0, 0.5)]
    flipped = [(t, y if k < 700 else -y) for k, (t, y) in enumerate(steady)]
    trip = trip_of(axis_guard(), flipped)
    assert trip.code == "speed"
    assert f"went from {sign * 0.157:.3g} to {-sign * 0.157:.3g} between two samples" in trip.why
    assert "its sign may have flipped" in trip.why


def test_a_flip_out_of_the_travel_is_told_too() -> None:
    """In velocity mode a speed whose sign flips leaves the travel."""
    judge = axis_guard(travel=(0.05, 1.0), speed=None)
    trip = trip_of(judge, [(0.0, 0.3), (5e-4, 0.3001), (1e-3, -0.3002)])
    assert trip.code == "travel"
    assert "its sign may have flipped" in trip.why


@pytest.mark.parametrize("last", [0.8, -0.05])
def test_a_fast_movement_or_a_jump_elsewhere_is_no_flip(last: float) -> None:
    trip = trip_of(axis_guard(), [*[(k * 5e-4, 0.3 + 1e-5 * k) for k in range(100)], (0.05, last)])
    assert trip.code == "speed"
    assert "sign" not in trip.why
    assert "between two samples" in trip.why


def test_steady_overspeed_says_nothing_of_jumps() -> None:
    trip = trip_of(axis_guard(), [(k * 5e-4, 0.006 * k) for k in range(100)])
    assert trip.code == "speed"
    assert "between two samples" not in trip.why


def test_hang_estop_and_dead_man() -> None:
    assert guard.hung(0.04, 0.05) is None
    assert guard.hung(0.06, 0.05) is not None
    line = EstopConfig(channel="estop")
    assert guard.estop_open([(line, Sample(1.0, 1.0))], 1.0, 0.01) is None
    assert guard.estop_open([(line, Sample(0.0, 1.0))], 1.0, 0.01) is not None
    assert guard.estop_open([(line, Sample(math.nan, 1.0))], 1.0, 0.01) is not None
    assert guard.estop_open([(line, Sample(1.0, 0.9))], 1.0, 0.01) is not None
    assert guard.dead_man(None, 100.0, 0.0) is None
    assert guard.dead_man(0.5, 1.4, 1.0) is None
    assert guard.dead_man(0.5, 1.6, 1.0) is not None


@pytest.mark.parametrize("window", [5e-3, 2e-2])
def test_speed_is_that_of_the_window(window: float) -> None:
    meter = SpeedMeter(window)
    speeds = [meter.update(k * 1e-3, 3.0 * k * 1e-3) for k in range(50)]
    assert speeds[0] == 0.0
    assert speeds[-1] == pytest.approx(3.0)
    assert speeds[2] == 0.0  # no window yet: one noisy step is not a speed


def test_the_way_to_the_amplitude_is_no_growth() -> None:
    judge, codes = axis_guard(speed=1e3), []
    for t, swing in sine(0.15, 3.0, 6.0):
        y = swing * min(1.0, 0.05 + t)  # it takes a second to get there
        trip = judge.inspect(t, Sample(y, t), y, y, True, t > 1.0)
        codes.append(trip and trip.code)
    assert set(codes) == {None}


def test_a_movement_while_the_axis_was_idle_is_no_speed_of_the_next_start() -> None:
    judge = axis_guard(travel=(-2.0, 2.0))
    at_rest = [(k * 1e-3, 1.4) for k in range(20)]
    put_back = [(0.05 + k * 1e-3, 0.0) for k in range(20)]  # 1.4 rad in 31 ms, by hand
    assert feed(judge, at_rest, exciting=False) is None
    judge.begin()
    assert feed(judge, put_back, exciting=False) is None
