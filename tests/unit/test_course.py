"""The course of one axis, step by step: what leads from state to state, at which time, and what is told."""

from __future__ import annotations

import math
from typing import Any

import pytest

from seod.loop.course import ACTIVE, Push
from seod.loop.excite import Coast, Drive, PolarityPulse, PolarityResult
from seod.loop.guard import Trip
from seod.loop.tones import Tone, Tones
from seod.loop.two_phase import TwoPhaseRelay
from tests.unit.course_bench import ARMED, EXCITING, HOLDING, IDLE, SECOND, Bench, Hold, flags


def test_before_it_is_started_an_axis_is_idle_and_nothing_is_known() -> None:
    for enabled in (True, False):
        course = Bench(polarity={"enabled": enabled}).course
        assert course.name == "motor"
        assert course.state is IDLE
        assert flags(course) == (False, False, False)
        assert course.relay is None
        assert isinstance(course.controller, Coast)
        assert course.polarity_known is not enabled
        assert (course.stopping, course.waiting, course.pushed) == (False, False, None)
        assert course.started == course.entered == -math.inf


def test_the_actuator_may_move_in_three_states() -> None:
    assert {ARMED, EXCITING, HOLDING} == ACTIVE


# Start


def test_start_without_a_pulse_turns_the_relay_on_at_once() -> None:
    bench = Bench()
    course = bench.course
    course.stopping = True
    course.begin(3.0, None, waiting=False)
    assert bench.states() == [(3.0, "idle", "armed", "start"), (3.0, "armed", "exciting", "relay on")]
    assert flags(course) == (True, True, True)
    assert (course.started, course.entered, course.stopping) == (3.0, 3.0, False)
    relay = course.relay
    assert isinstance(relay, TwoPhaseRelay)
    assert (relay.start, relay.entry, relay.e_a, relay.hysteresis) == (3.0, 0.25, 0.5, 0.125)
    assert bench.mode.relays_on == [3.0]
    assert bench.mode.holds == []


def test_the_relay_has_the_second_phase_that_is_kept_and_a_start_drops_it() -> None:
    bench = Bench().holding()
    course = bench.course
    course.phases.phase = SECOND
    course._excite(5.0)
    assert course.relay is not None
    assert course.relay.phase == SECOND
    course.begin(6.0, None, waiting=False)
    assert course.phases.phase is None
    (dropped,) = [e for e in bench.told if e["event"] == "two_phase"]
    assert dropped == {
        "event": "two_phase",
        "t": 6.0,
        "axis": "motor",
        "phase": None,
        "code": "start",
        "why": "start: to be chosen anew",
    }


def test_the_phases_are_the_axis_own() -> None:
    bench = Bench()
    phases = bench.course.phases
    assert phases.name == "motor"
    assert phases.limits is bench.config.limits
    assert phases.settings is bench.settings
    assert phases.emit == bench.course.emit


def test_an_axis_that_waits_holds_first() -> None:
    bench = Bench()
    bench.course.begin(3.0, None, waiting=True)
    assert bench.states() == [
        (3.0, "idle", "armed", "start"),
        (3.0, "armed", "holding", "waiting for its turn"),
    ]
    assert bench.mode.holds == [(3.0, True)]
    assert bench.course.waiting
    assert flags(bench.course) == (True, False, False)


def test_an_axis_that_approaches_is_brought_there_before_the_relay() -> None:
    bench = Bench(approaches=True)
    course = bench.course
    course.begin(3.0, None, waiting=False)
    assert bench.states() == [(3.0, "idle", "armed", "start")]
    assert bench.mode.holds == [(3.0, False)]
    assert course.entered == 3.0
    assert course.advance(3.5, 0.0) is None
    assert bench.mode.asked == 3.5
    assert bench.states() == []
    bench.mode.there = True
    assert course.advance(4.0, 0.0) is None
    assert bench.states() == [(4.0, "armed", "exciting", "relay on")]


def test_an_axis_that_approaches_and_waits_holds_once_it_is_there() -> None:
    bench = Bench(approaches=True)
    bench.course.begin(3.0, None, waiting=True)
    bench.mode.there = True
    bench.course.advance(4.0, 0.0)
    assert bench.states()[1:] == [(4.0, "armed", "holding", "waiting for its turn")]
    assert bench.mode.holds == [(3.0, True), (4.0, True)]


# The polarity pulse


@pytest.mark.parametrize(("pulse", "height"), [(None, 0.5), (0.25, 0.25)])
@pytest.mark.parametrize("approaches", [True, False])
def test_the_pulse_comes_first_as_it_is_configured(
    pulse: float | None, height: float, approaches: bool
) -> None:
    bench = Bench(approaches, {"enabled": True, "pulse": pulse, "duration": 0.125, "movement": 0.0625})
    bench.config._command = "A"
    course = bench.course
    course.begin(3.0, None, waiting=False)
    assert bench.states() == [(3.0, "idle", "armed", "start")]
    shown = course.controller
    assert isinstance(shown, PolarityPulse)
    assert (shown.start, shown.voltage, shown.duration, shown.movement) == (3.0, height, 0.125, 0.0625)
    assert (shown.output, shown.unit) == ("valve", "A")
    bench.mode.t_sample = 3.25
    assert shown.sampled() == 3.25
    bench.mode.there = True
    assert course.advance(3.5, 0.0) is None
    assert course.controller is shown, "it waits for the pulse, not for the position"
    assert bench.states() == []


def test_a_pulse_that_shows_the_right_sign_leads_on_through_a_hold() -> None:
    bench = Bench(polarity={"enabled": True})
    course = bench.course
    course.begin(3.0, None, waiting=False)
    assert isinstance(course.controller, PolarityPulse)
    course.controller.result = PolarityResult(True, 0.02, "it moved")
    bench.told.clear()
    assert course.advance(3.5, 0.0) is None
    assert bench.told == [
        {
            "event": "polarity",
            "t": 3.5,
            "axis": "motor",
            "ok": True,
            "movement": 0.02,
            "voltage": 0.5,
            "why": "it moved",
        }
    ]
    assert course.polarity_known
    assert course.state is ARMED
    assert bench.mode.holds == [(3.5, False)]
    assert isinstance(course.controller, Hold)
    bench.told.clear()
    bench.mode.there = True
    course.advance(4.0, 0.0)
    assert bench.states() == [(4.0, "armed", "exciting", "relay on")]
    course.begin(5.0, None, waiting=False)
    assert course.state is EXCITING, "once is enough"


def test_a_pulse_that_shows_another_sign_trips() -> None:
    bench = Bench(polarity={"enabled": True})
    course = bench.course
    course.begin(3.0, None, waiting=False)
    assert isinstance(course.controller, PolarityPulse)
    course.controller.result = PolarityResult(False, -0.02, "wrong sign")
    assert course.advance(3.5, 0.0) == Trip("polarity", "motor: wrong sign", {"movement": -0.02})
    assert not course.polarity_known
    assert course.state is ARMED
    assert bench.mode.holds == []


# Stop, turns


@pytest.mark.parametrize("make", [lambda: Bench(approaches=True), Bench])
def test_stop_goes_back_to_where_it_stood(make: Any) -> None:
    bench = make()
    bench.course.begin(1.0, None, waiting=False)
    before = bench.course.state
    bench.told.clear()
    bench.mode.holds.clear()
    bench.course.stop(2.0)
    assert before in (ARMED, EXCITING)
    assert bench.states() == [(2.0, before.name.lower(), "holding", "stop")]
    assert bench.mode.holds == [(2.0, True)]
    assert bench.course.entered == 2.0
    assert bench.course.relay is None
    assert bench.course.advance(50.0, 0.0) is None
    assert bench.states() == [], "it is not there yet"
    bench.mode.there = True
    bench.course.advance(51.0, 0.0)
    assert bench.states() == [(51.0, "holding", "idle", "back at the position at start")]
    assert flags(bench.course) == (False, False, False)


def test_stop_while_it_holds_changes_nothing_but_the_end() -> None:
    bench = Bench().holding()
    held = bench.course.controller
    bench.course.stop(2.5, "another axis could not start")
    assert bench.states() == []
    assert bench.course.controller is held
    bench.mode.there = True
    bench.course.advance(2.6, 0.0)
    assert bench.course.state is IDLE


def test_stop_tells_why() -> None:
    bench = Bench().excited()
    bench.course.stop(2.0, "the gateway is gone")
    assert bench.states() == [(2.0, "exciting", "holding", "the gateway is gone")]


def test_a_turn_that_is_over_and_the_next() -> None:
    bench = Bench().excited()
    course = bench.course
    course.wait(2.0, "its turn is over")
    assert bench.states() == [(2.0, "exciting", "holding", "its turn is over")]
    assert bench.mode.holds == [(2.0, True)]
    bench.mode.there = True
    course.advance(50.0, 0.0)
    assert course.state is HOLDING, "it waits however long it takes"
    assert bench.mode.asked == 50.0
    course.go_on(60.0)
    assert course.waiting is False
    assert bench.states() == [(60.0, "holding", "exciting", "relay on")]


def test_an_axis_that_approaches_is_brought_there_in_its_turn_too() -> None:
    bench = Bench(approaches=True)
    course = bench.course
    course.begin(1.0, None, waiting=True)
    course.go_on(2.0)
    assert bench.mode.holds == [(1.0, True), (2.0, False)]
    assert course.entered == 2.0
    assert course.state is ARMED


@pytest.mark.parametrize("approaches", [True, False])
def test_a_turn_does_not_cut_the_pulse_short(approaches: bool) -> None:
    bench = Bench(approaches, {"enabled": True})
    course = bench.course
    course.begin(1.0, None, waiting=True)
    pulse = course.controller
    course.go_on(2.0)
    assert course.controller is pulse
    assert course.state is ARMED
    assert not course.waiting


# Faults


def test_a_fault_latches_and_the_polarity_has_to_be_shown_anew() -> None:
    bench = Bench(polarity={"enabled": True})
    course = bench.course
    course.begin(1.0, None, waiting=False)
    course.polarity_known = True
    course.phases.phase = SECOND
    bench.told.clear()
    course.fault(2.0, "travel")
    first = bench.told[0]
    assert (first["event"], first["t"], first["code"], first["why"]) == ("two_phase", 2.0, "fault", "travel")
    assert bench.states() == [(2.0, "armed", "fault", "travel")]
    assert not course.polarity_known
    assert flags(course) == (False, False, False)
    course.polarity_known = True
    course.fault(3.0, "speed")
    assert bench.told == []
    assert not course.polarity_known
    course.reset(4.0)
    assert bench.states() == [(4.0, "fault", "idle", "reset")]
    course.reset(5.0)
    assert bench.states() == []


def test_a_rig_that_does_without_a_pulse_does_so_after_a_fault() -> None:
    course = Bench().excited().course
    course.fault(2.0, "travel")
    assert course.polarity_known
    assert course.relay is None


# Excitation


def test_a_burst_lasts_for_entry_and_duration() -> None:
    bench = Bench().excited()
    bench.course.advance(math.nextafter(1.75, 0.0), 0.0)
    assert bench.states() == []
    bench.course.advance(1.75, 0.0)
    assert bench.states() == [(1.75, "exciting", "holding", "burst over")]
    assert bench.mode.holds == [(1.75, False)], "the next burst follows"
    assert bench.course.entered == 1.75


def test_the_next_burst_comes_after_the_pause_once_it_is_there() -> None:
    bench = Bench().holding(since=2.0)
    bench.course.advance(5.0, 0.0)
    assert bench.states() == [], "not there"
    bench.mode.there = True
    bench.course.advance(math.nextafter(4.0, 0.0), 0.0)
    assert bench.states() == []
    bench.course.advance(4.0, 0.0)
    assert bench.states() == [(4.0, "holding", "exciting", "relay on")]
    assert bench.course.entered == 4.0


def test_a_continuous_excitation_goes_on_until_its_budget_is_used_up() -> None:
    bench = Bench(excitation={"kind": "continuous"}).excited()
    bench.course.advance(9.0, 0.0)
    assert bench.told == []
    t = math.nextafter(9.0, 10.0)
    bench.course.advance(t, 0.0)
    assert bench.told[0] == {
        "event": "warning",
        "t": t,
        "axis": "motor",
        "code": "excitation_budget",
        "why": "motor: stopped after limits.excitation = 8 s",
    }
    assert bench.states() == [(t, "exciting", "holding", "excitation budget used up")]
    assert bench.course.stopping


# Drives


def pushed(push: Push, **changes: Any) -> Bench:
    bench = Bench(**changes)
    bench.course.begin(1.0, push, waiting=False)
    assert bench.course.state is EXCITING
    return bench


@pytest.mark.parametrize("stay", [True, False])
def test_a_drive_takes_the_relays_place_for_its_time(stay: bool) -> None:
    bench = pushed(Push(-0.25, 4.0, stay))
    course = bench.course
    assert bench.states()[1:] == [(1.0, "armed", "exciting", "drive: -0.25 V for 4 s")]
    drive = course.controller
    assert type(drive) is Drive
    assert (drive.end, drive.voltage) == (5.0, -0.25)
    assert course.relay is None
    assert course.exciting
    assert bench.mode.relays_on == []
    course.advance(math.nextafter(5.0, 0.0), 0.375)
    assert bench.states() == [], "longer than a burst"
    course.advance(5.0, 0.5)
    assert bench.states() == [(5.0, "exciting", "holding", "drive over")]
    assert bench.mode.starts == ([0.5] if stay else [])
    assert bench.mode.holds == [(5.0, True)]
    assert course.stopping


def test_tones_are_added_to_a_hold_at_the_reference() -> None:
    tones = (Tone(2.0, 0.5, 0.0), Tone(4.0, 0.25, 1.0))
    bench = pushed(Push(0.75, 4.0, False, tones))
    course = bench.course
    assert bench.states()[1:] == [(1.0, "armed", "exciting", "2 tones: 0.75 V for 4 s")]
    drive = course.controller
    assert isinstance(drive, Tones)
    assert (drive.start, drive.end, drive.entry, drive.voltage) == (1.0, 5.0, 0.25, 0.75)
    assert [(amplitude, phase) for _, amplitude, phase in drive.tones] == [(0.5, 0.0), (0.25, 1.0)]
    assert isinstance(drive.hold, Hold)
    assert bench.mode.holds == [(1.0, False)]
    course.advance(5.0, 0.5)
    assert bench.mode.holds == [(1.0, False), (5.0, True)]
    assert bench.mode.starts == []


def test_a_steady_drive_is_approached_from_rest_and_tones_from_the_reference() -> None:
    """In velocity mode: a drive is told of the speed that it makes alone."""
    for tones, rest in (((), True), ((Tone(2.0, 0.5, 0.0),), False)):
        bench = Bench(approaches=True)
        bench.course.begin(1.0, Push(0.5, 1.0, False, tones), waiting=False)
        assert bench.mode.holds == [(1.0, rest)]


def test_a_relay_after_a_drive_is_a_relay() -> None:
    bench = pushed(Push(0.5, 1.0, False))
    bench.course.begin(5.0, None, waiting=False)
    assert bench.course.pushed is None
    assert isinstance(bench.course.controller, TwoPhaseRelay)
