"""Relays on a position that no longer switch: the guard's limit, before and after a limit cycle is known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from guard_bench import beyond, make, told

from drivers.base import Sample

if TYPE_CHECKING:
    from seod.loop.guard import AxisGuard, Trip


def side(judge: AxisGuard, t: float, sign: float) -> Trip | None:
    """The sensor moves all the time: noise, or another axis."""
    return judge.inspect(t, Sample(0.0, t), 1e-3 * math.sin(1e3 * t), None, True, False, sign)


def switch(judge: AxisGuard, stays: list[float], t: float = 1.0) -> float:
    """Stays of a relay that goes up first; when the next one begins [s]."""
    sign = 1.0
    for stay in stays:
        assert side(judge, t, sign) is None
        t, sign = t + stay, -sign
    assert side(judge, t, sign) is None
    return t


def test_a_relay_may_stay_on_one_side_for_as_long_as_the_limit_and_no_longer() -> None:
    judge = make()
    assert side(judge, 1.0, 1.0) is None
    assert side(judge, 17.0, 1.0) is None
    trip = told(side(judge, beyond(17.0), 1.0))
    assert trip.code == "no_switch"
    assert trip.why == (
        "motor: the relay has been on one side for 16000 ms, at most 16000 ms is allowed (guard.no_switch): "
        "the sensor does not show this axis, or the axis does not move"
    )
    assert trip.numbers == {"stay_s": beyond(17.0) - 1.0, "limit_s": 16.0}


def test_a_relay_that_is_off_or_rising_stays_nowhere() -> None:
    judge = make()
    assert side(judge, 1.0, 1.0) is None
    assert side(judge, 9.0, 0.0) is None
    assert side(judge, 18.0, 1.0) is None
    assert side(judge, 34.0, 1.0) is None
    assert told(side(judge, 34.1, 1.0)).code == "no_switch"


def test_a_known_limit_cycle_makes_the_limit_four_of_its_longest_halves() -> None:
    judge = make()
    begin = switch(judge, [0.5, 1.0, 0.5, 1.0, 0.5])
    assert side(judge, begin + 4.0, -1.0) is None
    trip = told(side(judge, beyond(begin + 4.0), -1.0))
    assert trip.numbers == {"stay_s": beyond(begin + 4.0) - begin, "limit_s": 4.0}
    assert "at most 4000 ms is allowed (guard.no_switch); it was 1000 ms at most before: the" in trip.why


def test_a_fast_limit_cycle_may_pause_as_long_as_a_sensor_may_stand_still() -> None:
    judge = make()
    begin = switch(judge, [0.125] * 9)
    assert side(judge, begin + 2.0, -1.0) is None
    assert told(side(judge, beyond(begin + 2.0), -1.0)).numbers["limit_s"] == 2.0


def test_the_limit_of_a_slow_limit_cycle_is_the_rig_files() -> None:
    judge = make()
    begin = switch(judge, [8.0] * 5)
    assert side(judge, begin + 16.0, -1.0) is None
    assert told(side(judge, begin + 16.1, -1.0)).numbers["limit_s"] == 16.0


@pytest.mark.parametrize("stays", [[1.0, 1.0, 1.0], [0.25, 0.125, 0.25, 0.25]], ids=["few", "short"])
def test_a_limit_cycle_is_known_after_a_second_and_four_switches(stays: list[float]) -> None:
    judge = make()
    begin = switch(judge, stays)
    assert side(judge, begin + 16.0, 1.0 if len(stays) % 2 == 0 else -1.0) is None


def test_switches_by_noise_at_a_crossing_leave_the_longest_half() -> None:
    judge = make()
    begin = switch(judge, [1.0, 0.0625, 0.0625, 0.0625, 1.0, 0.0625, 0.0625, 0.0625])
    assert side(judge, begin + 4.0, 1.0) is None
    assert told(side(judge, begin + 4.1, 1.0)).numbers["limit_s"] == 4.0


def test_the_limit_follows_a_limit_cycle_that_becomes_faster() -> None:
    judge = make()
    begin = switch(judge, [1.0] * 5 + [0.5] * 9)
    assert told(side(judge, begin + 2.1, 1.0)).numbers["limit_s"] == 2.0


def test_other_settings_make_another_limit_cycle() -> None:
    judge = make()
    begin = switch(judge, [0.5] * 5)
    judge.settings_changed()
    assert side(judge, begin + 0.1, -1.0) is None
    assert side(judge, begin + 16.0, -1.0) is None
    assert told(side(judge, begin + 16.2, -1.0)).code == "no_switch"
