"""Which cycles of a window with two phases are alike."""

from __future__ import annotations

import math

import pytest

from seod.estimate.limit_cycle.switches import Switch
from seod.estimate.wave.phases import Phases, PhaseSegment


def switches(*halves: tuple[int, float]) -> list[Switch]:
    """So many half cycles of a length, and so on."""
    t, made = 0.0, []
    for count, half in halves:
        for _ in range(count):
            t += half
            made.append(Switch(t, t, len(made) % 2 == 0, 1))
    return made


def turned(*times: float) -> Phases:
    phases, second = Phases(), False
    phases.note(0.0, second)
    for t in times:
        second = not second
        phases.note(t, second)
        phases.note(t + 0.01, second)
    return phases


def test_one_phase_is_alike_all_over() -> None:
    assert turned().alike(0.0, switches((12, 0.5))) is None
    assert turned(2.9).alike(3.0, switches((12, 0.5))) is None


def test_the_newest_phase_where_it_holds_two_cycles() -> None:
    found = turned(3.0).alike(0.0, switches((6, 0.5), (6, 0.8)))
    assert found == pytest.approx(PhaseSegment(3.0 + 2 * 0.8, 3.0 + 6 * 0.8, 1.6))


def test_else_the_phase_before() -> None:
    found = turned(3.0).alike(0.0, switches((6, 0.5), (4, 0.8)))
    assert found == pytest.approx(PhaseSegment(1.0, 3.0, 1.0))


def test_no_two_cycles_of_any_phase_are_a_stretch_of_no_length() -> None:
    found = turned(1.0, 3.0).alike(0.0, switches((2, 0.5), (3, 0.7), (2, 0.5)))
    assert found is not None
    assert found.begin == found.end


def test_turns_that_are_long_past_are_forgotten() -> None:
    phases = turned(*(float(k) for k in range(1, 500)))
    assert len(phases._turns) == 100
    assert phases.alike(-math.inf, []) == PhaseSegment(-math.inf, -math.inf, 0.0)
