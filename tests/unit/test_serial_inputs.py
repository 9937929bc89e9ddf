"""Samples of a board as they come out: whatever it tells, times rise, and none is from the future."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.device_clock import OLDEST_S
from drivers.serial_counters import CLOCK_RESETS, COUNTER_NAMES, SAMPLES
from drivers.serial_frame import BoardSample
from drivers.serial_inputs import UNTOLD_LATENCY_S, SerialInputs
from tests.unit.serial_bench import make_options

LINE_S = 1e-3
ASCII = {"format": "ascii", "fields": ["angle", "enable"]}


def inputs(**changes: object) -> tuple[SerialInputs, list[int]]:
    counts = [0] * len(COUNTER_NAMES)
    return SerialInputs(make_options(**changes), ("angle",), LINE_S, counts), counts


def sample(us: int | None, sequence: int | None = None) -> BoardSample:
    return BoardSample(sequence, us, 0, None, None, [100.0, 1.0])


TOLD = st.tuples(
    st.integers(0, (1 << 32) - 1) | st.integers(0, 100_000),
    st.integers(0, 255),
    st.just(0.0) | st.floats(0.0, 20.0),
)


@pytest.mark.slow
@settings(max_examples=200)
@given(st.lists(TOLD, max_size=50))
def test_times_rise_and_are_within_the_bounds_whatever_a_board_tells(
    told: list[tuple[int, int, float]],
) -> None:
    taken, counts = inputs()
    now, taken_at = 100.0, []
    for us, sequence, after in told:
        now += after
        if taken.take(sample(us, sequence), now):
            taken_at.append((now - LINE_S, taken.samples[0].t))
    assert all(arrived - OLDEST_S <= t <= arrived + 1e-9 for arrived, t in taken_at)
    assert all(a < b for (_, a), (_, b) in pairwise(taken_at))
    assert len(taken_at) == counts[SAMPLES]
    assert counts[CLOCK_RESETS] == taken.clock.resets


def feed(taken: SerialInputs, stamped: bool, count: int = 2000) -> None:
    for k in range(count):
        t = 5e-4 * k
        late = 3e-4 * (k * 0.618 % 1.0)  # as even as chance, and the same each time
        taken.take(sample(round(1e6 * t) if stamped else None), 100.0 + t + late)


def test_a_clock_that_is_right_leaves_no_doubt() -> None:
    taken, _ = inputs()
    assert all(map(math.isnan, taken.stamp_error()))
    feed(taken, stamped=True)
    assert taken.stamp_error() == (0.0, 0.0)


def test_without_a_clock_samples_are_as_uncertain_as_their_arrival() -> None:
    taken, _ = inputs(**ASCII)
    feed(taken, stamped=False)
    common, scatter = taken.stamp_error()
    assert common == UNTOLD_LATENCY_S
    assert scatter == pytest.approx(3e-4 / math.sqrt(12.0), rel=0.05)


def test_with_a_clock_but_no_commands_told_the_latency_is_unknown() -> None:
    taken, _ = inputs(format="ascii", fields=["time", "angle", "enable"])
    feed(taken, stamped=True)
    assert taken.stamp_error() == (UNTOLD_LATENCY_S, 0.0)
