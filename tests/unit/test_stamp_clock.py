"""Time stamps of one clock placed on another."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import SLACK_S, StampClock


class Clocks:
    """A monotonic clock and a real-time clock that can be set."""

    def __init__(self) -> None:
        self.t = 50.0
        self.offset = 1e6

    def make(self) -> StampClock:
        return StampClock(lambda: self.t, lambda: self.t + self.offset)

    def stamp(self, at: float) -> float:
        return at + self.offset


def test_stamps_are_placed_on_the_loops_clock() -> None:
    clocks = Clocks()
    stamps = clocks.make()
    clocks.t += 0.5
    assert stamps.to_loop(clocks.stamp(50.3)) == pytest.approx(50.3)
    assert stamps.to_loop(clocks.stamp(50.5)) == pytest.approx(50.5)


@pytest.mark.parametrize("step", [3600.0, 0.5, -0.5, -3600.0])
def test_a_clock_step_changes_nothing(step: float) -> None:
    clocks = Clocks()
    stamps = clocks.make()
    before_step = clocks.stamp(50.0001)
    clocks.t += 0.0005
    clocks.offset += step
    after_step = clocks.stamp(50.0004)
    assert stamps.to_loop(before_step) == pytest.approx(50.0001, abs=1e-6)
    assert stamps.to_loop(after_step) == pytest.approx(50.0004, abs=1e-6)
    stamps.drained()
    clocks.t += 0.0005
    assert stamps.to_loop(clocks.stamp(50.0007)) == pytest.approx(50.0007, abs=1e-6)
    assert stamps.steps == 1


def test_slewing_is_followed_and_is_no_step() -> None:
    clocks = Clocks()
    stamps = clocks.make()
    for _ in range(2000):
        clocks.t += 0.0005
        clocks.offset += 0.0005 * 500e-6
        assert stamps.to_loop(clocks.stamp(clocks.t - 0.0001)) == pytest.approx(clocks.t - 0.0001, abs=1e-6)
        stamps.drained()
    assert stamps.steps == 0


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.floats(1e-4, 0.01), st.floats(-1e4, 1e4), st.floats(-1e5, 1e5)), min_size=1, max_size=20
    )
)
def test_no_stamp_is_in_the_future_or_before_what_was_read(events: list[tuple[float, float, float]]) -> None:
    clocks = Clocks()
    stamps = clocks.make()
    for wait, step, error in events:
        drained_at = stamps._drained_at
        clocks.t += wait
        clocks.offset += step
        t = stamps.to_loop(clocks.stamp(clocks.t) + error)
        assert drained_at - SLACK_S <= t <= clocks.t
        stamps.drained()


ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(-1e9, 1e9), ANY, st.booleans()), max_size=30))
def test_whatever_stamps_come_a_time_is_the_loops(events: list[tuple[float, float, float, bool]]) -> None:
    clocks = Clocks()
    stamps = clocks.make()
    for wait, step, stamp, drained in events:
        drained_at = stamps._drained_at
        clocks.t += wait
        clocks.offset += step
        assert drained_at - SLACK_S <= stamps.to_loop(stamp) <= clocks.t
        if drained:
            stamps.drained()


def test_stamps_of_other_clocks_count_as_now() -> None:
    clocks = Clocks()
    assert clocks.make().to_loop(0.0) == clocks.t
    assert StampClock(lambda: clocks.t, lambda: 1e6, trusted=False).to_loop(123.0) == clocks.t
