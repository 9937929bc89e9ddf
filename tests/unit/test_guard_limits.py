"""The guard's limits to the last bit: what lies on one passes, a bit beyond it trips, and what is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest
from guard_bench import LIMITS, beyond, look, make, told

from drivers.base import NO_SAMPLE, Sample
from seod.config.axis import LimitsConfig
from seod.config.guard import EstopConfig, GuardConfig
from seod.loop import guard

if TYPE_CHECKING:
    from seod.loop.guard import AxisGuard, Trip


@dataclass
class Part:
    """A sensor or a gate with something to say."""

    trouble: str = ""
    why: str = ""


# Samples


def test_a_sample_may_be_as_old_as_the_limit_and_no_older() -> None:
    judge = make()
    assert judge.ready(1.0, Sample(0.0, 0.875), 0.0) is None
    trip = told(judge.ready(1.0, Sample(0.0, math.nextafter(0.875, 0.0)), 0.0))
    assert trip.code == "stale_sample"
    assert trip.why == "motor: the sensor's newest sample is 125.0 ms old; guard.stale is 125.0 ms"
    assert trip.numbers == {"age_s": 1.0 - math.nextafter(0.875, 0.0), "limit_s": 0.125}


def test_a_sample_of_the_limits_age_trips_for_nothing_else_either() -> None:
    """Where something else is wrong it is that which is told."""
    assert told(make().ready(1.0, Sample(4.0, 0.875), 4.0)).code == "travel"


def test_a_sensor_that_was_never_heard_of_is_said_to_be_so() -> None:
    trip = told(make().ready(1.0, NO_SAMPLE, math.nan))
    assert trip.why == "motor: the sensor's newest sample is never heard of; guard.stale is 125.0 ms"
    assert trip.numbers == {"age_s": -1.0, "limit_s": 0.125}


def test_a_stale_sample_tells_each_gate_that_kept_a_newer_one_from_the_axis() -> None:
    judge = make()
    judge.gates = [Part(why="valve.ok reads 0"), Part(), Part(why="bridge.ok is silent")]  # type: ignore[list-item]
    trip = told(judge.ready(1.0, Sample(0.0, 0.5), 0.0))
    assert trip.why == (
        "motor: the sensor's newest valid sample is 500.0 ms old; valve.ok reads 0; bridge.ok is silent; "
        "guard.stale is 125.0 ms"
    )
    assert trip.numbers == {"age_s": 0.5, "limit_s": 0.125}


def test_a_sensor_in_trouble_trips_whatever_it_reads() -> None:
    judge = make()
    judge.sensor = Part()  # type: ignore[assignment]
    assert judge.ready(1.0, Sample(0.0, 1.0), 0.0) is None
    judge.sensor = Part("the wire is broken")  # type: ignore[assignment]
    for y in (0.0, 5.0, math.nan):
        trip = told(judge.ready(1.0, Sample(y, 1.0), y))
        assert trip == guard.Trip("sensor_range", "motor: the wire is broken", {})
    assert told(judge.ready(1.0, Sample(0.0, 0.5), 0.0)).code == "stale_sample"


def test_a_sound_sensor_hides_nothing() -> None:
    judge = make()
    judge.sensor = Part()  # type: ignore[assignment]
    assert told(judge.ready(1.0, Sample(5.0, 1.0), 5.0)).code == "travel"


@pytest.mark.parametrize("y", [math.nan, math.inf, -math.inf])
def test_a_reading_that_is_no_number_is_told_as_it_is(y: float) -> None:
    trip = told(make().ready(1.0, Sample(y, 1.0), y))
    assert trip == guard.Trip("non_finite", f"motor: the sensor reads {y}", {})


# Travel and speed


def test_either_end_of_the_travel_may_be_stood_at_and_not_passed() -> None:
    judge = make()
    for y in (-1.0, 3.0):
        assert judge.ready(1.0, Sample(y, 1.0), y) is None
        out = beyond(y)
        trip = told(judge.ready(1.0, Sample(out, 1.0), out))
        assert trip.code == "travel"
        assert trip.numbers == {"position": out, "low": -1.0, "high": 3.0}
    trip = told(judge.ready(1.0, Sample(-1.23456789, 1.0), -1.23456789))
    assert trip.why == "motor: position -1.23457 is outside limits.travel [-1, 3]"


def test_what_the_sensor_measures_is_named() -> None:
    limits = LimitsConfig.model_validate(LIMITS)
    judge = guard.AxisGuard("spindle", limits, GuardConfig(), "velocity")
    assert judge.name == "spindle"
    trip = told(judge.ready(1.0, Sample(4.0, 1.0), 4.0))
    assert trip.why == "spindle: velocity 4 is outside limits.travel [-1, 3]"
    assert trip.numbers["velocity"] == 4.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_speed_limit_may_be_reached_and_not_passed(sign: float) -> None:
    """Over 1/128 s, the first step over the window of 5 ms: 1/8 is 16 a second."""
    for step, code in ((sign * 0.125, None), (beyond(sign * 0.125), "speed")):
        judge = make()
        assert look(judge, 1.0, 0.0) is None
        trip = look(judge, 1.0 + 1 / 128, step)
        assert (trip and trip.code) == code
    told_speed = told(trip)
    assert told_speed.why == f"motor: speed {sign * 16:.4g} is over limits.speed 16"
    assert told_speed.numbers == {"speed": step * 128, "limit": 16.0}


def test_without_a_speed_limit_no_speed_trips() -> None:
    judge = make(speed=None)
    assert look(judge, 1.0, -1.0) is None
    assert look(judge, 1.01, 3.0) is None


def test_a_sample_that_was_seen_before_is_no_second_point_of_the_speed() -> None:
    """At ticks without a new sample; nor is one from before the newest."""
    judge = make()
    for t in (1.0, 1.0, 0.96875):
        assert judge.inspect(1.0, Sample(0.0, t), 0.0, None, False, False) is None
    assert list(judge.speed.points) == [(1.0, 0.0)]


def test_the_beginning_of_a_movement_forgets_what_was_before() -> None:
    judge = make()
    assert look(judge, 1.0, 0.0) is None
    assert look(judge, 1.001, 0.0) is None
    judge.begin()
    assert not judge.speed.points
    assert math.isnan(judge.last_y)
    trip = told(look(judge, 1.01, 4.0))
    assert trip.why == "motor: position 4 is outside limits.travel [-1, 3]", "no jump: nothing was before it"


# Jumps


@pytest.mark.parametrize(
    ("last", "y", "guess"),
    [
        # a tenth of the travel of 4, and a bit more
        (2.75, 3.15, None),
        (2.75, 3.1500001, "the sensor may be at fault"),
        # the sum is a tenth of the difference, and a bit more
        (-0.9, 3.25, "the sensor may be at fault"),
        (3.0, -3.0, "its sign may have flipped"),
        (3.0, -2.4545455, "its sign may have flipped"),
        (3.0, -2.4545454, "the sensor may be at fault"),
        (2.75, -3.25, "its sign may have flipped"),
    ],
)
def test_a_step_out_of_the_travel_is_told_with_what_it_looks_like(
    last: float, y: float, guess: str | None
) -> None:
    judge = make(speed=None)
    assert look(judge, 1.0, last) is None
    trip = told(look(judge, 1.001, y))
    assert trip.code == "travel"
    plain = f"motor: position {y:.6g} is outside limits.travel [-1, 3]"
    went = f": the reading went from {last:.3g} to {y:.3g} between two samples; {guess}"
    assert trip.why == plain + (went if guess else "")
    assert trip.numbers["position"] == y


def test_what_a_step_looks_like_is_decided_to_the_last_bit() -> None:
    """A tenth of the travel is no jump yet; a sum of a tenth of the difference is a flip still."""
    judge = make(speed=None, travel=(-1.0, 9.0))
    assert look(judge, 1.0, 8.5) is None
    assert told(look(judge, 1.001, 9.5)).why == "motor: position 9.5 is outside limits.travel [-1, 9]"
    judge = make(speed=None, travel=(-4.0, 6.0))
    assert look(judge, 1.0, 5.5) is None
    assert told(look(judge, 1.001, -4.5)).why.endswith("its sign may have flipped")


def test_a_jump_of_a_reading_that_is_stale_is_not_told() -> None:
    judge = make()
    assert look(judge, 1.0, 0.0) is None
    trip = told(judge.inspect(2.0, Sample(2.0, 1.5), 2.0, None, False, False))
    assert trip.code == "stale_sample"
    assert "between two samples" not in trip.why


# Commands


def test_commands_are_clipped_at_the_output_either_way() -> None:
    judge = make()
    asked = [2.0, beyond(2.0), 7.0, -2.0, beyond(-2.0), -7.0, 0.5]
    assert [judge.pass_command(k * 1e-3, u) for k, u in enumerate(asked)] == [2, 2, 2, -2, -2, -2, 0.5]


def test_a_command_moves_by_no_more_than_the_slew_since_the_last_one() -> None:
    judge = make(slew=4.0)
    judge.neutral(1.0)
    assert judge.pass_command(1.125, 2.0) == 0.5
    assert judge.pass_command(1.25, 2.0) == 1.0
    assert judge.pass_command(1.375, -2.0) == 0.5
    assert judge.pass_command(1.625, -2.0) == -0.5
    judge.neutral(1.75)
    assert judge.pass_command(1.875, -2.0) == -0.5


def test_the_first_command_and_one_after_a_pause_have_a_second_of_slew() -> None:
    judge = make(slew=0.5)
    assert judge.pass_command(50.0, 2.0) == 0.5
    assert judge.pass_command(60.0, 2.0) == 1.0
    judge = make(slew=0.5)
    assert judge.pass_command(50.0, -2.0) == -0.5


# Amplitude and growth


def test_the_amplitude_may_be_its_limit_and_no_more() -> None:
    judge = make()
    assert judge.amplitude == 0.0
    assert look(judge, 1.0, 0.0, swing=-0.5) is None
    assert look(judge, 1.001, 0.0, swing=0.5) is None
    assert judge.amplitude == 0.5
    trip = told(look(judge, 1.002, 0.0, swing=0.50001))
    assert trip.code == "amplitude"
    assert trip.why == "motor: amplitude 0.5 is over limits.amplitude 0.5"
    assert trip.numbers == {"amplitude": pytest.approx(0.500005), "limit": 0.5}


def test_while_nothing_should_swing_there_is_no_amplitude() -> None:
    judge = make()
    look(judge, 1.0, 0.0, swing=-0.4)
    look(judge, 1.001, 0.0, swing=0.4)
    assert look(judge, 1.002, 0.0, swing=None) is None
    assert judge.swing is None
    assert judge.amplitude == 0.0
    assert look(judge, 1.003, 0.0, swing=2.0) is None, "measured from anew"


def swing(judge: AxisGuard, amplitudes: list[float], counts: bool = True) -> Trip | None:
    """Square waves of these amplitudes, each for a block of the swing meter; the first trip."""
    t = 1.0
    for amplitude in amplitudes:
        for k in range(6):
            y = amplitude if k % 2 else -amplitude
            trip = judge.inspect(t, Sample(y, t), y, y, exciting=True, growth_counts=counts)
            if trip is not None:
                return trip
            t += 0.0625
    return None


def test_growth_may_be_its_limit_and_no_more() -> None:
    at_limit = [0.0625, 0.0625, 0.125, 0.1875, 0.1875]
    assert swing(make(speed=None), at_limit) is None
    trip = told(swing(make(speed=None), [*at_limit[:3], 0.1876, 0.1876]))
    assert trip.code == "amplitude_growth"
    assert trip.why == ("motor: the oscillation grew 3 times within a few periods; limits.growth is 3")
    assert trip.numbers == {
        "growth": pytest.approx(3.0016),
        "limit": 3.0,
        "amplitude": pytest.approx(0.1876),
    }
    assert swing(make(speed=None), [*at_limit[:3], 0.1876, 0.1876], counts=False) is None


def test_growth_of_less_than_a_tenth_of_the_amplitudes_limit_is_none() -> None:
    small = [0.01, 0.01, 0.02, 0.05, 0.05]
    assert swing(make(speed=None), small) is None
    assert told(swing(make(speed=None), [*small[:3], 0.0501, 0.0501])).code == "amplitude_growth"


# Frozen sensors


def test_a_sensor_may_stand_still_for_as_long_as_the_limit_and_no_longer() -> None:
    judge = make()
    assert look(judge, 1.0, 0.3, exciting=True) is None
    assert look(judge, 3.0, 0.3, exciting=True) is None
    trip = told(look(judge, beyond(3.0), 0.3, exciting=True))
    assert trip.code == "frozen_sensor"
    assert trip.why == (
        "motor: the sensor has read 0.3 for 2000 ms while the relay is on; guard.frozen is 2000 ms"
    )
    assert trip.numbers == {"position": 0.3, "still_s": beyond(3.0) - 1.0, "limit_s": 2.0}


def test_a_sensor_is_still_from_its_last_movement_and_from_relay_on() -> None:
    judge = make()
    assert look(judge, 1.0, 0.3, exciting=False) is None
    assert look(judge, 9.0, 0.3, exciting=False) is None
    assert look(judge, 11.0, 0.3, exciting=True) is None
    assert look(judge, 12.0, 0.31, exciting=True) is None
    assert look(judge, 14.0, 0.31, exciting=True) is None
    assert told(look(judge, 14.1, 0.31, exciting=True)).code == "frozen_sensor"


# Late ticks, a loop that stood still


def test_only_so_many_late_ticks_within_the_window_trip() -> None:
    period, late = 1 / 1024, 3 / 2048
    judge = guard.OverrunGuard(3, 4.0)
    assert judge.inspect(1.0, period, period) is None, "a period late is not late"
    assert [judge.inspect(t, late, period) for t in (1.0, 3.0)] == [None, None]
    trip = told(judge.inspect(5.0, late, period))
    assert trip.code == "overruns"
    assert trip.why == "3 ticks within 4000 ms were more than a period late, the last by 1.46 ms"
    assert trip.numbers == {"count": 3.0, "lateness_s": late, "period_s": period}
    assert judge.inspect(beyond(7.0), late, period) is None, "the first of the three is out of the window"


def test_a_loop_may_sleep_for_as_long_as_the_limit_and_no_longer() -> None:
    assert guard.hung(2.0, 2.0) is None
    trip = told(guard.hung(beyond(2.0), 2.0))
    assert trip.code == "hang"
    assert trip.why == "the loop stood still for 2000 ms; loop.hang_timeout is 2000 ms"
    assert trip.numbers == {"lateness_s": beyond(2.0), "limit_s": 2.0}


# The supervisor's turns


def test_a_supervisor_that_stands_still_for_the_limit_trips() -> None:
    judge = guard.SupervisorGuard(0.5, hang_timeout=2.0)
    assert judge.inspect(7) is None
    assert [judge.inspect(7) for _ in range(3)] == [None] * 3
    trip = told(judge.inspect(7))
    assert trip.code == "supervisor"
    assert trip.why == (
        "the supervisor process has stood still for 2000 ms (stopped, or held up): nothing would stop the "
        "rig if the loop died; have it run again, then reset"
    )
    assert trip.numbers == {"still_s": 2.0, "limit_s": 2.0}
    assert judge.inspect(8) is None
    assert [judge.inspect(8) for _ in range(3)] == [None] * 3


@pytest.mark.parametrize(("hang_timeout", "turns"), [(0.0, 18), (0.1, 18), (0.18, 18), (0.3, 30)])
def test_a_supervisor_has_as_long_as_a_loop_and_180_ms_at_least(hang_timeout: float, turns: int) -> None:
    judge = guard.SupervisorGuard(0.01, hang_timeout)
    judge.inspect(1)
    assert [judge.inspect(1) is None for _ in range(turns)] == [True] * (turns - 1) + [False]
    assert told(judge.inspect(1)).numbers["limit_s"] == max(0.18, hang_timeout)


def test_without_a_hang_timeout_a_supervisor_has_180_ms() -> None:
    assert guard.SupervisorGuard(0.01).limit == 18
    assert guard.SupervisorGuard(0.07).limit == 3


def test_no_supervisor_is_missed_where_there_is_none_or_no_clock() -> None:
    alone = guard.SupervisorGuard(0.1)
    assert [alone.inspect(0) for _ in range(10)] == [None] * 10
    simulated = guard.SupervisorGuard(math.inf, 0.25)
    assert [simulated.inspect(1) for _ in range(10)] == [None] * 10


# E-stop lines, the whole rig, the dead man


ESTOP = EstopConfig(channel="door", run=2.0)


def test_an_estop_line_is_heard_for_as_long_as_the_limit() -> None:
    assert guard.estop_open([], 1.0, 0.25) is None
    assert guard.estop_open([(ESTOP, Sample(2.0, 0.75))], 1.0, 0.25) is None
    t = beyond(1.0)
    trip = told(guard.estop_open([(ESTOP, Sample(2.0, 0.75))], t, 0.25))
    assert trip.code == "estop"
    assert trip.why == "e-stop: the channel door has been silent for 250.0 ms (guard.stale is 250.0 ms)"
    assert trip.numbers == {"value": 2.0, "run": 2.0, "age_s": t - 0.75, "limit_s": 0.25}


@pytest.mark.parametrize("value", [beyond(2.0), math.nextafter(2.0, 0.0), -2.0, 0.0, math.inf, math.nan])
def test_an_estop_line_allows_movement_at_its_number_alone(value: float) -> None:
    trip = told(guard.estop_open([(ESTOP, Sample(value, 1.0))], 1.0, 0.25))
    assert trip.why == f"e-stop: door reads {value:g}, movement is allowed at 2"
    number = value if math.isfinite(value) else -1.0
    assert trip.numbers == {"value": number, "run": 2.0, "age_s": 0.0, "limit_s": 0.25}


def test_an_estop_line_whose_time_is_no_number_was_not_heard_of() -> None:
    trip = told(guard.estop_open([(ESTOP, Sample(2.0, math.nan))], 1.0, 0.25))
    assert trip.why == "e-stop: the channel door was never heard of"
    assert trip.numbers == {"value": 2.0, "run": 2.0, "age_s": -1.0, "limit_s": 0.25}


def test_whatever_time_is_no_number_trips() -> None:
    """A clock that fails must not keep the guard from acting."""
    assert told(make().ready(1.0, Sample(0.0, math.nan), 0.0)).code == "stale_sample"
    assert told(guard.silent([Sample(0.0, math.nan)], 1.0, 0.25)).code == "silent"
    assert told(guard.hung(math.nan, 0.25)).code == "hang"
    assert told(guard.dead_man(0.5, math.nan, 1.0)).code == "dead_man"
    assert told(guard.OverrunGuard(1, 0.5).inspect(1.0, math.nan, 0.001)).code == "overruns"


def test_an_open_line_of_the_limits_age_tells_what_it_reads() -> None:
    trip = told(guard.estop_open([(ESTOP, Sample(1.0, 0.75))], 1.0, 0.25))
    assert trip.why == "e-stop: door reads 1, movement is allowed at 2"


def test_all_open_estop_lines_are_named_and_the_first_has_the_numbers() -> None:
    other, third = EstopConfig(channel="hood", run=1.0), EstopConfig(channel="foot", run=1.0)
    lines = [(third, Sample(1.0, 1.0)), (ESTOP, NO_SAMPLE), (other, Sample(0.0, 1.0))]
    trip = told(guard.estop_open(lines, 1.0, 0.25))
    assert trip.why == ("e-stop: the channel door was never heard of; hood reads 0, movement is allowed at 1")
    assert trip.numbers == {"value": -1.0, "run": 2.0, "age_s": -1.0, "limit_s": 0.25}


def test_a_rig_is_silent_when_its_newest_sample_is_older_than_the_limit() -> None:
    assert guard.silent([NO_SAMPLE, Sample(0.0, 0.75), Sample(0.0, 0.5)], 1.0, 0.25) is None
    trip = told(guard.silent([Sample(0.0, 0.5), Sample(0.0, 0.625)], 1.0, 0.25))
    assert trip.code == "silent"
    assert trip.why == (
        "nothing has come from the rig for 375.0 ms (guard.stale is 250.0 ms): "
        "is it switched on, and does the line hold?"
    )
    assert trip.numbers == {"age_s": 0.375, "limit_s": 0.25}
    trip = told(guard.silent([NO_SAMPLE], 1.0, 0.25))
    assert trip.why == (
        "nothing has come from the rig since the start (guard.stale is 250.0 ms): "
        "is it switched on, and does the line hold?"
    )
    assert trip.numbers == {"age_s": -1.0, "limit_s": 0.25}


def test_a_client_may_be_silent_for_as_long_as_the_limit_and_no_longer() -> None:
    assert guard.dead_man(None, 100.0, 0.0) is None
    assert guard.dead_man(0.5, 1.5, 1.0) is None
    trip = told(guard.dead_man(0.5, beyond(1.5), 1.0))
    assert trip.code == "dead_man"
    assert trip.why == "no client called keepalive for 0.50 s; guard.dead_man is 0.50 s"
    assert trip.numbers == {"silent_s": beyond(1.5) - 1.0, "limit_s": 0.5}
