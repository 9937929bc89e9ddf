"""A board's clock in single steps with exact numbers: bounds, hull, drift, what is a step and what is not."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.device_clock import (
    KEPT,
    LARGEST_DRIFT,
    OLDEST_S,
    STEP_S,
    WRAP,
    Bound,
    DeviceClock,
    _lower_hull,
    _passed_s,
)

SLOPE = 1 / 128
"""As drifts go, a large one; exact in binary."""


# From one time of the board's clock to another


@pytest.mark.parametrize(
    ("before", "after", "passed_us"),
    [
        (5, 5, 0),
        (5, 6, 1),
        (6, 5, -1),
        (WRAP - 1, 0, 1),
        (0, WRAP - 1, -1),
        (WRAP - 1000, 500, 1500),
        (500, WRAP - 1000, -1500),
        (0, WRAP // 2 - 1, WRAP // 2 - 1),
        (0, WRAP // 2, -WRAP // 2),
        (7, WRAP // 2 + 6, WRAP // 2 - 1),
    ],
)
def test_a_clock_that_wraps_went_the_shorter_way(before: int, after: int, passed_us: int) -> None:
    assert _passed_s(before, after) == passed_us * 1e-6


# A line below all points


def test_of_points_in_a_row_the_hull_has_the_ends() -> None:
    assert _lower_hull([]) == []
    assert _lower_hull([(3.0, 4.0)]) == [(3.0, 4.0)]
    assert _lower_hull([(3.0, 4.0), (5.0, 1.0)]) == [(3.0, 4.0), (5.0, 1.0)]
    assert _lower_hull([(1.0, 2.0), (2.0, 4.0), (3.0, 6.0), (4.0, 8.0)]) == [(1.0, 2.0), (4.0, 8.0)]


@given(st.lists(st.integers(-20, 20), min_size=2, max_size=12), st.integers(-5, 5))
def test_no_point_is_below_the_hull_and_each_of_its_corners_is_one(heights: list[int], first: int) -> None:
    points = [(float(first + k), float(y)) for k, y in enumerate(heights)]
    hull = _lower_hull(points)
    assert hull[0] == points[0]
    assert hull[-1] == points[-1]
    slopes = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(hull)]
    assert all(a < b for a, b in combinations(slopes, 2))
    for (x0, y0), (x1, y1) in pairwise(hull):
        assert all(y >= y0 + (y1 - y0) * (x - x0) / (x1 - x0) - 1e-9 for x, y in points if x0 <= x <= x1)


def bound(points: list[tuple[float, float]]) -> Bound:
    line = Bound()
    for x, y in points:
        line.add(x, y)
    return line


def test_before_the_first_point_a_bound_is_nowhere() -> None:
    assert Bound().at(3.0) == math.inf
    assert Bound().drift == 0.0


def test_a_bound_is_as_high_as_its_lowest_point() -> None:
    assert bound([(0.0, 5.0)]).at(7.0) == 5.0
    assert bound([(0.0, 5.0), (0.125, 4.0), (0.1875, 6.0)]).at(7.0) == 4.0
    assert bound([(0.0, 5.0), (0.125, 4.0), (0.25, 6.0), (0.5, 7.0)]).at(7.0) == 4.0


def test_a_stretch_is_a_quarter_of_a_second_and_keeps_its_lowest_point() -> None:
    line = bound([(1.0, 5.0), (1.125, 4.0), (1.1875, 6.0), (1.24, 4.0)])
    assert list(line._kept) == []
    line.add(1.25, 3.0)
    assert list(line._kept) == [(1.125, 4.0)], "of two as low the first"
    line.add(1.4375, 2.0)
    line.add(1.5, 9.0)
    assert list(line._kept) == [(1.125, 4.0), (1.4375, 2.0)]
    assert line.at(0.0) == 2.0


def test_a_point_from_before_its_stretch_counts_as_at_its_beginning() -> None:
    line = bound([(1.0, 5.0), (0.25, 4.0), (1.25, 6.0)])
    assert list(line._kept) == [(1.0, 4.0)]


def test_a_drift_needs_four_stretches() -> None:
    """The fourth is over when the fifth begins."""
    points = [(0.25 * k, 3.0 + SLOPE * 0.25 * k) for k in range(5)]
    line = bound(points[:4])
    assert line.drift == 0.0
    line.add(*points[4])
    assert line.drift == SLOPE
    assert line.at(0.0) == 3.0
    assert line.at(16.0) == 3.125


def test_with_a_drift_the_lowest_is_the_one_farthest_below_the_line() -> None:
    line = bound([(0.25 * k, SLOPE * 0.25 * k) for k in range(5)])
    line.add(1.125, SLOPE * 1.125 - 2**-10)  # above the first of its stretch, and below the line
    line.add(1.1875, SLOPE * 1.1875 - 2**-11)
    assert line.at(0.0) == -(2**-10)
    line.add(1.25, 1.0)
    assert line._kept[-1] == (1.125, SLOPE * 1.125 - 2**-10)


def test_the_drift_is_the_slope_under_the_middle() -> None:
    slopes = [-0.015625, -0.0078125, 0.0, 0.0078125, 0.015625]

    def drift(first: float, count: int) -> float:
        x, y = first, 0.0
        points = [(x, y)]
        for slope in slopes[:count]:
            x, y = x + 1.0, y + slope
            points.append((x, y))
        return bound([*points, (x + 1.0, 1.0)]).drift

    for first in (0.0, 64.0):
        assert drift(first, 3) == -0.0078125, "over its middle one of three edges"
        assert drift(first, 4) == -0.0078125, "on a corner the edge that ends there"
        assert drift(first, 5) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drift_that_no_timer_has_is_not_believed(sign: float) -> None:
    def line(slope: float) -> Bound:
        return bound([(float(k), slope * k) for k in (0, 1, 2, 4, 5)])

    assert line(sign * LARGEST_DRIFT).drift == sign * LARGEST_DRIFT
    assert line(sign * 0.0201).drift == 0.0
    known = bound([(0.25 * k, SLOPE * 0.25 * k) for k in range(5)])
    known.add(1.25, 1.25 * SLOPE + sign)
    known.add(1.5, 9.0)
    assert known.drift == SLOPE, "what was known goes on"


def test_half_a_minute_is_remembered() -> None:
    line = bound([(0.0, -1.0), *[(0.25 * k, 0.0) for k in range(1, KEPT + 1)]])
    assert len(line._kept) == KEPT
    assert line.at(30.0) == -1.0
    line.add(0.25 * (KEPT + 1), 0.0)
    assert line._kept[0] == (0.25, 0.0)
    assert line.drift == 0.0
    assert line.at(30.0) == 0.0


# The clock


def clock(*samples: tuple[int, float]) -> DeviceClock:
    made = DeviceClock()
    for time_us, arrived in samples:
        made.heard(time_us, arrived)
    return made


def test_a_first_sample_was_taken_when_it_arrived() -> None:
    made = DeviceClock()
    assert made.resets == 0
    assert made.heard(123, 50.0) == 50.0
    assert made.resets == 0
    assert made.drift == 0.0


def test_a_sample_that_came_late_was_taken_when_the_board_says() -> None:
    made = clock((0, 50.0))
    assert made.heard(500_000, 50.75) == 50.5
    assert made.heard(1_000_000, 51.0) == 51.0
    assert made.heard(1_125_000, 51.1171875) == 51.1171875, "a tighter bound"
    assert made.heard(1_187_500, 51.5) == 51.1796875
    assert made.resets == 0


def test_times_go_on_over_the_wrap() -> None:
    made = clock((WRAP - 250_000, 50.0))
    assert made.heard(250_000, 51.0) == 50.5
    assert made.resets == 0


@pytest.mark.parametrize(("back_us", "resets"), [(10_000, 0), (10_001, 1)])
def test_a_clock_that_goes_back_by_more_than_10_ms_was_set(back_us: int, resets: int) -> None:
    made = clock((1_000_000, 50.0))
    made.heard(1_000_000 - back_us, 50.0)
    assert made.resets == resets


@pytest.mark.parametrize(("ahead_us", "resets"), [(9_000, 0), (11_000, 1), (5_000_000, 1)])
def test_a_clock_that_goes_ahead_of_the_arrivals_by_more_than_10_ms_was_set(
    ahead_us: int, resets: int
) -> None:
    made = clock((0, 50.0))
    assert made.heard(1_000_000 + ahead_us, 51.0) == 51.0
    assert made.resets == resets
    assert made.heard(2_000_000 + ahead_us, 52.0) == 52.0
    assert made.resets == resets, "each once"


def test_a_clock_may_be_ahead_by_as_much_as_the_limit() -> None:
    made = clock((0, 0.0))
    assert not made._was_set(1.0, 1.0 - STEP_S + 1e-12)
    assert made._was_set(1.0, 1.0 - STEP_S - 1e-9)


def test_no_sample_is_older_than_ten_seconds() -> None:
    """Later than that it is of another clock."""
    made = clock((0, 50.0))
    assert made.heard(1_000_000, 51.0 + OLDEST_S) == 51.0
    assert made.resets == 0
    made = clock((0, 50.0))
    late = math.nextafter(51.0 + OLDEST_S, 100.0)
    assert made.heard(1_000_000, late) == late
    assert made.resets == 1


def test_what_goes_back_and_comes_late_was_set() -> None:
    made = clock((2_000_000, 50.0))
    made.heard(1_000_000, 61.5)
    assert made.resets == 1


def test_a_drift_that_ends_in_a_gap_is_no_step() -> None:
    """The bound has drifted away from what comes next, which has come no earlier than what was before."""
    made = clock(*[(round(0.25e6 * k), 50.0 + 0.25 * k * (1 + SLOPE)) for k in range(5)])
    assert made.drift == pytest.approx(SLOPE)
    last = 50.0 + (1 + SLOPE)
    assert made.heard(9_000_000, last + 8.0) == last + 8.0
    assert made.resets == 0
    assert made.heard(17_000_000, last + 8.0 + 8.0 - 1.5 * STEP_S) == last + 16.0 - 1.5 * STEP_S
    assert made.resets == 1


@pytest.mark.parametrize(
    ("passed", "arrived", "was_set"),
    [
        (0.02, 0.01, False),
        (0.0200001, 0.01, True),
        (0.0, 0.0, False),
        (-0.01, 0.0, False),
        (-0.0100001, 0.0, True),
    ],
)
def test_where_the_bound_has_drifted_away_the_last_sample_decides(
    passed: float, arrived: float, was_set: bool
) -> None:
    made = clock((0, 0.0))
    made._above._offset = 1.0
    assert made._was_set(passed, arrived) is was_set


def test_a_sample_as_early_as_the_limit_is_no_step_though_the_one_before_was_late() -> None:
    assert not clock((0, 0.0), (5_000, 0.01))._was_set(0.015, 0.01)


def test_of_stamps_that_jitter_their_share_goes_to_the_mean_of_the_arrivals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = clock((0, 50.0))
    monkeypatch.setattr(made.jitter, "level", lambda x: 50.25 + x)
    made.jitter.share = 0.5
    assert made._difference(0.0) == 50.125
    assert made._difference(2.0) == 51.125
    made.jitter.share = 0.0
    assert made._difference(0.0) == 50.0


def test_a_restart_knows_nothing_and_counts_nothing() -> None:
    made = clock((0, 50.0), (1_000_000, 52.0))
    made.restart()
    assert made.resets == 0
    assert made.heard(4_000_000_000, 20.0) == 20.0
    assert made.heard(4_000_500_000, 20.75) == 20.5
    assert made.resets == 0


def test_a_reset_leaves_nothing_of_the_old_clock() -> None:
    made = clock((0, 50.0), (1_000_000, 51.0))
    made.acknowledged(900_000, 50.5)
    assert made.heard(500_000_000, 51.5) == 51.5
    assert made.resets == 1
    assert made.heard(500_500_000, 52.25) == 52.0
    assert made.heard(0, 53.0) == 53.0
    assert made.resets == 2


# Acknowledgements


def test_a_command_was_set_after_it_was_written() -> None:
    made = DeviceClock()
    assert made.acknowledged(77, 40.0) == 40.0, "nothing was heard yet"
    assert made.heard(1_000_000, 50.0) == 50.0, "nor is that a bound"
    made = clock((1_000_000, 50.0))
    assert made.acknowledged(750_000, 49.875) == 49.875
    made = clock((1_000_000, 50.0))
    assert made.acknowledged(750_000, 49.5) == 49.625, "in the middle of what both directions allow"
    assert made.heard(2_000_000, 51.0) == 50.875


def test_a_command_was_set_before_the_last_sample_arrived() -> None:
    made = clock((1_000_000, 50.0))
    assert made.acknowledged(1_000_000, 49.75) == 49.875
    assert made.acknowledged(1_000_000, 50.5) == 50.5, "not before it was written, whatever was heard"


def test_acknowledgements_wrap_too() -> None:
    made = clock((100_000, 50.0))
    assert made.acknowledged(WRAP - 150_000, 49.5) == 49.625


def test_of_bounds_that_contradict_the_arrivals_is_believed() -> None:
    made = clock((1_000_000, 50.0))
    made.acknowledged(1_000_000, 50.25)
    assert made.heard(2_000_000, 51.5) == 51.0


def test_a_bound_from_below_of_another_clock_makes_no_sample_older_than_ten_seconds() -> None:
    made = clock((0, 100.0))
    made.acknowledged(0, 60.0)
    assert made.heard(1_000_000, 101.0) == 101.0 - OLDEST_S


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_bound_from_below_drifts_with_the_boards_clock(sign: float) -> None:
    made = DeviceClock()
    for k in range(9):
        t = 50.0 + 0.25 * k * (1 + sign * SLOPE)
        made.heard(round(0.25e6 * k), t + 0.125)
        made.acknowledged(round(0.25e6 * k), t - 0.125)
    assert made.drift == pytest.approx(sign * SLOPE)
    t = 50.0 + 4.0 * (1 + sign * SLOPE)
    assert made.heard(4_000_000, t + 0.25) == pytest.approx(t)
