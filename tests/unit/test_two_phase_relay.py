"""The relay of two phases, and what makes it give the second one up."""

from __future__ import annotations

from typing import Any

import pytest

from seod.config.axis import LimitsConfig
from seod.loop.two_phase import SecondPhase, TwoPhaseRelay, TwoPhases

LATE = {"late": 0.25, "cycles": 2, "period": 1.0, "e_a": 0.5, "swing": 0.3}
TICK = 0.01
LIMITS = LimitsConfig(output=2.0, travel=(-1.0, 1.0), speed=10.0, amplitude=0.4, excitation=60.0)


def squares(relay: TwoPhaseRelay, begin: float, end: float) -> list[tuple[float, float, bool]]:
    """Its switches, sign and phase, on an error that changes its sign every half second."""
    switches = []
    before = relay.sign
    for k in range(round(begin / TICK), round(end / TICK)):
        t = k * TICK
        relay.step(t + 1e-9, 1.0 if t % 1.0 < 0.5 - 1e-9 else -1.0)
        if relay.sign != before:
            switches.append((round(t, 6), relay.sign, relay.second))
            before = relay.sign
    return switches


def relay_with(phase: SecondPhase | None) -> TwoPhaseRelay:
    return TwoPhaseRelay(0.0, 0.0, 0.5, 0.0, phase)


def test_without_a_second_phase_it_is_a_relay() -> None:
    switches = squares(relay_with(None), 0.0, 4.2)
    assert [t for t, *_ in switches] == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0])
    assert {second for *_, second in switches} == {False}


def test_two_cycles_as_they_are_then_two_late_and_again() -> None:
    switches = squares(relay_with(SecondPhase(**LATE)), 0.0, 6.6)
    as_they_are = [0.5, 1.0, 1.5]
    late = [2.25, 2.75, 3.25, 3.75]
    assert [t for t, *_ in switches] == pytest.approx([*as_they_are, *late, 4.0, 4.5, 5.0, 5.5, 6.25])
    assert [t for t, _, second in switches if second] == pytest.approx([*late, 6.25])
    assert [sign for _, sign, _ in switches] == [-1.0, 1.0] * 6


def test_a_phase_that_is_chosen_while_it_runs_begins_with_the_next_cycle() -> None:
    relay = relay_with(None)
    squares(relay, 0.0, 3.2)
    relay.take(SecondPhase(**LATE))
    assert squares(relay, 3.2, 4.6) == [(3.5, -1.0, False), (4.25, 1.0, True)]


def test_given_up_it_is_as_it_was_at_once() -> None:
    relay = relay_with(SecondPhase(**LATE))
    squares(relay, 0.0, 2.1)
    assert (relay.second, relay.sign) == (True, -1.0)
    relay.take(None)
    assert squares(relay, 2.1, 2.7) == [(2.1, 1.0, False), (2.5, -1.0, False)]


def test_the_cycle_between_the_phases_is_marked() -> None:
    relay, marks = relay_with(SecondPhase(**LATE)), []
    sign = 1.0
    for k in range(640):
        relay.step(k * TICK + 1e-9, 1.0 if k % 100 < 50 else -1.0)
        if relay.sign > sign:
            marks.append(relay.turning)
        sign = relay.sign
    assert marks == [False, True, False, True, False, True]


def test_noise_at_a_crossing_makes_no_cycles() -> None:
    relay = relay_with(SecondPhase(**LATE))
    for k in range(100, 120):
        relay.step(k * TICK, 1.0 if k % 2 else -1.0)
    assert relay.count == 1
    assert not relay.second


class Told(list[dict[str, Any]]):
    @property
    def last(self) -> tuple[Any, str]:
        return self[-1]["phase"], self[-1]["code"]


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def phases(told: Told) -> TwoPhases:
    return TwoPhases("motor", LIMITS, {"e_a": 0.5, "two_phase": 1.0}, told.append)


def test_taken_watched_and_given_up(phases: TwoPhases, told: Told) -> None:
    relay = relay_with(None)
    assert phases.take(1.0, relay, LATE) is None
    assert told.last == (LATE, "chosen")
    phases.watch(1.0, relay, 0.35)
    assert relay.phase is not None, "it is the first phase that swings so far"
    relay.late = 0.25
    phases.watch(2.0, relay, 0.29)
    assert relay.second
    phases.watch(2.1, relay, 0.31)
    assert (relay.second, relay.phase, phases.phase) == (False, None, None)
    assert told.last == (None, "swing")
    phases.drop(2.2, relay, "settings", "again")
    assert len(told) == 2, "nothing to give up is nothing to tell"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"e_a": 0.6}, "e_a is another"),
        ({"late": 0.5}, "less than half a period"),
        ({"late": 0.0}, "less than half a period"),
        ({"late": float("nan")}, "less than half a period"),
        ({"cycles": 0}, "whole cycles"),
        ({"swing": 0.5}, "at most limits.amplitude"),
        ({"swing": float("inf")}, "at most limits.amplitude"),
    ],
)
def test_refused_with_a_reason(phases: TwoPhases, told: Told, change: dict[str, float], why: str) -> None:
    relay = relay_with(None)
    assert why in str(phases.take(1.0, relay, LATE | change))
    assert relay.phase is None
    assert not told


def test_not_taken_while_the_relay_or_the_setting_is_off(phases: TwoPhases) -> None:
    assert "off" in str(phases.take(1.0, None, LATE))
    phases.settings["two_phase"] = 0.0
    assert "off" in str(phases.take(1.0, relay_with(None), LATE))
