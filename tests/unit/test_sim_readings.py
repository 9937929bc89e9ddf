"""Noise, quantisation and defects of readings: their sizes, their rates, their seeds."""

from __future__ import annotations

import math
from itertools import groupby, pairwise
from random import Random
from statistics import fmean, stdev

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.readings import Readings


def readings(noise: float = 0.0, seed: int = 7, **effects: dict[str, float]) -> Readings:
    return Readings(Random(seed), noise, effects)


def test_the_noise_is_white_repeatable_and_of_the_right_size() -> None:
    sensor, again = readings(0.01), readings(0.01)
    found = [sensor.read(2.0) for _ in range(4000)]
    assert found == [again.read(2.0) for _ in range(4000)]
    assert stdev(found) == pytest.approx(0.01, rel=0.05)
    errors = [reading - 2.0 for reading in found]
    neighbours = fmean(a * b for a, b in pairwise(errors)) / 0.01**2
    assert abs(neighbours) < 4 / math.sqrt(4000)


@given(value=st.floats(-1e3, 1e3))
def test_a_quantised_reading_is_the_nearest_whole_step(value: float) -> None:
    reading = readings(sensor_quantization={"step": 0.25}).read(value)
    assert reading % 0.25 == 0.0
    assert abs(reading - value) <= 0.125


def test_outliers_are_as_many_and_as_large_as_asked() -> None:
    sensor = readings(outliers={"rate": 0.05, "size": 3.0})
    errors = [sensor.read(1.0) - 1.0 for _ in range(10_000)]
    struck = [error for error in errors if error]
    assert len(struck) == pytest.approx(500, abs=4 * math.sqrt(10_000 * 0.05 * 0.95))
    assert stdev(struck) == pytest.approx(3.0, rel=0.15)


@pytest.mark.parametrize(("rate", "length"), [(0.02, 1.0), (0.1, 5.0), (0.5, 20.0), (0.9, 1.0), (1.0, 1.0)])
def test_missing_samples_are_as_many_in_gaps_as_long_as_asked(rate: float, length: float) -> None:
    sensor = readings(missing_samples={"rate": rate, "length": length})
    missing = [sensor.missing() for _ in range(40_000)]
    assert fmean(missing) == pytest.approx(rate, rel=0.15)
    if rate < 1.0:
        gaps = [len(list(run)) for gone, run in groupby(missing) if gone]
        assert fmean(gaps) == pytest.approx(max(length, rate / (1.0 - rate)), rel=0.15)


def test_a_jittering_sample_is_taken_about_its_stamp_and_never_ahead_of_now() -> None:
    sensor = readings(timing_jitter={"deviation": 1e-4})
    times = [sensor.taken(k * 1e-3) for k in range(4000)]
    off = [taken - stamp for taken, stamp in times]
    assert abs(fmean(off)) < 4e-4 / math.sqrt(4000)
    assert stdev(off) == pytest.approx(1e-4, rel=0.05)
    assert all(taken <= k * 1e-3 for k, (taken, _) in enumerate(times))
    assert readings().taken(2.0) == (2.0, 2.0)


def test_without_defects_no_chance_is_used() -> None:
    sensor = readings()
    before = sensor.random.getstate()
    assert (sensor.read(1.5), sensor.missing(), sensor.taken(1.0)) == (1.5, False, (1.0, 1.0))
    assert sensor.random.getstate() == before
