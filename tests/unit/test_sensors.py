"""Sensor kinds: counts unwrapped, zeros found, linkages against geometry, and what is no measurement."""

from __future__ import annotations

import gzip
import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from seod.config.sensors import sensor_or_none
from seod.loop.sensor import Sensor, make_sensor

RECORD = Path(__file__).parents[3] / "shared" / "data" / "electromechanical_positioning.csv.gz"


def sensor(kind: str, unit: str, **options: object) -> Sensor:
    config = sensor_or_none(json.dumps({"kind": kind, "channel": "x", "unit": unit, **options}))
    assert config is not None
    return make_sensor(config)


def counter(bits: int = 16, unit: str = "rad", **options: object) -> Sensor:
    """One count is one unit."""
    return sensor("incremental_encoder", unit, bits=bits, **({"counts_per_unit": 1.0} | options))


def read_all(encoder: Sensor, raws: list[float]) -> list[float]:
    return [encoder.read(raw) for raw in raws]


# Incremental encoders


@st.composite
def walks(draw: st.DrawFn) -> tuple[int, int, list[int]]:
    """Counter width, first count, and steps below half the counter's range."""
    bits = draw(st.integers(2, 40))
    half = 1 << (bits - 1)
    steps = draw(st.lists(st.integers(-half + 1, half - 1), max_size=50))
    return bits, draw(st.integers(0, 2 * half - 1)), steps


@given(walk=walks(), signed=st.booleans())
def test_any_walk_with_steps_below_half_the_range_is_recovered_exactly(
    walk: tuple[int, int, list[int]], signed: bool
) -> None:
    bits, start, steps = walk
    encoder = counter(bits)
    true = [sum(steps[:k]) for k in range(len(steps) + 1)]
    raws = [(start + position) % (1 << bits) for position in true]
    if signed:
        raws = [raw - (1 << bits) if raw >= 1 << (bits - 1) else raw for raw in raws]
    assert read_all(encoder, [float(raw) for raw in raws]) == true
    assert encoder.trouble == ""


@given(steps=st.lists(st.integers(-30, 30), min_size=1, max_size=80), every=st.integers(1, 4))
def test_missing_samples_do_no_harm_while_the_movement_stays_below_half(steps: list[int], every: int) -> None:
    encoder = counter(8)  # four steps of 30 are below 128
    true = [sum(steps[:k]) for k in range(len(steps) + 1)][::every]
    assert read_all(encoder, [position % 256 for position in true]) == true


def test_a_jump_by_half_the_range_has_no_direction_and_is_told() -> None:
    encoder = counter(8)
    encoder.read(10.0)
    encoder.read(10.0 + 127.0)
    assert encoder.trouble == ""
    encoder.read(9.0)
    assert "jumped by -128" in encoder.trouble
    encoder.read(12.0)
    assert encoder.trouble == ""


def test_a_step_that_no_shaft_can_make_is_told() -> None:
    encoder = counter(16, largest_step=100)
    assert read_all(encoder, [0.0, 100.0, 0.0]) == [0.0, 100.0, 0.0]
    assert encoder.trouble == ""
    encoder.read(101.0)
    assert "at most 100" in encoder.trouble


def test_counts_become_turns_either_way_and_the_offset_is_in_the_unit() -> None:
    forward = sensor("incremental_encoder", "deg", bits=16, counts_per_rev=4000, offset=90.0)
    backward = sensor("incremental_encoder", "deg", bits=16, counts_per_rev=-4000)
    assert read_all(forward, [7.0, 1007.0]) == pytest.approx([math.pi / 2, math.pi])
    assert read_all(backward, [7.0, 1007.0]) == pytest.approx([0.0, -math.pi / 2])
    ruler = sensor("incremental_encoder", "mm", bits=16, counts_per_unit=200)
    assert read_all(ruler, [65535.0, 0.0]) == pytest.approx([0.0, 5e-6])


def test_the_first_index_mark_is_the_zero_and_later_ones_change_nothing() -> None:
    encoder = counter(16, index={"channel": "z"}, offset=0.5)
    positions, levels = [0, 5, 10, 15, 10, 5], [0, 0, 1, 1, 0, 1]
    seen, troubles = [], []
    for position, level in zip(positions, levels, strict=True):
        encoder.mark(level)
        seen.append(encoder.read((65530 + position) % 65536))
        troubles.append("index" in encoder.trouble)
    assert seen[2:] == [0.5, 5.5, 0.5, -4.5]
    assert troubles == [True, True, False, False, False, False]


def test_an_index_that_stands_high_from_the_start_is_no_mark() -> None:
    encoder = counter(16, index={"channel": "z"})
    for level in (1.0, 1.0, math.nan, 1.0, 0.0):
        encoder.mark(level)
        encoder.read(5.0)
        assert "index" in encoder.trouble
    encoder.mark(1.0)
    encoder.mark(0.0)  # the pulse came with a tick that brought no new count
    assert encoder.read(9.0) == 0.0
    assert encoder.trouble == ""


def test_a_lost_count_loses_the_zero() -> None:
    encoder = counter(16, index={"channel": "z"}, largest_step=10)
    for level, raw in ((0.0, 0.0), (1.0, 1.0), (0.0, 500.0)):
        encoder.mark(level)
        encoder.read(raw)
    assert "jumped" in encoder.trouble
    encoder.read(500.0)
    assert "index" in encoder.trouble


@pytest.mark.parametrize("raw", [math.nan, math.inf, -math.inf, 70000.0, -40000.0])
def test_what_no_counter_can_say_is_no_movement(raw: float) -> None:
    encoder = counter(16)
    encoder.read(100.0)
    assert math.isnan(encoder.read(raw))
    assert bool(encoder.trouble) is not math.isnan(raw)
    assert encoder.read(103.0) == 3.0
    assert encoder.trouble == ""


def recorded_position() -> np.ndarray:
    if not RECORD.exists():
        pytest.skip(f"the measured record {RECORD.name} is not beside this checkout")
    with gzip.open(RECORD, "rt") as file:
        return np.loadtxt(file, delimiter=",", skiprows=1, usecols=2)


@pytest.mark.parametrize(("bits", "every"), [(8, 1), (8, 7), (12, 1)])
def test_a_recorded_movement_is_recovered_from_wrapped_counts(bits: int, every: int) -> None:
    position = recorded_position()[::every]
    per_metre = 100_000.0
    counts = np.floor(position * per_metre).astype(int)
    assert np.ptp(counts) > 1 << bits, "the record does not wrap this counter"
    ruler = sensor("incremental_encoder", "m", bits=bits, counts_per_unit=per_metre)
    recovered = np.array([ruler.read(float(count % (1 << bits))) for count in counts])
    assert np.max(np.abs(recovered - (position - position[0]))) <= 1.0 / per_metre


# Absolute encoders


@given(
    steps=st.lists(st.floats(-3.1, 3.1), max_size=60),
    start=st.floats(-3.1, 3.1),
    offset=st.floats(-10.0, 10.0),
    sign=st.sampled_from([1, -1]),
)
def test_an_absolute_encoder_is_continuous_over_turns(
    steps: list[float], start: float, offset: float, sign: int
) -> None:
    counts = 1 << 16
    encoder = sensor("absolute_encoder", "rad", bits=16, counts_per_rev=sign * counts, offset=offset)
    true = [start + sum(steps[:k]) for k in range(len(steps) + 1)]
    seen = [encoder.read(float(math.floor(sign * x / (2 * math.pi) * counts) % counts)) for x in true]
    assert seen == pytest.approx([x + offset for x in true], abs=2 * 2 * math.pi / counts)


def test_a_code_with_fewer_counts_than_its_bits_wraps_at_the_turn() -> None:
    encoder = sensor("absolute_encoder", "deg", bits=12, counts_per_rev=3600)
    degrees = [math.degrees(encoder.read(raw)) for raw in (3590.0, 10.0, 1799.0, 1801.0, 3599.0, 0.0)]
    assert degrees == pytest.approx([-1.0, 1.0, 179.9, 180.1, 359.9, 360.0])


# Converters, pressures, temperatures


def test_an_fv_converter_reads_speed_with_its_sign() -> None:
    volts = sensor("fv_converter", "rpm", scale=-300.0, offset_v=0.2)
    assert volts.read(0.2) == pytest.approx(0.0, abs=1e-12)
    assert volts.read(-3.8) == pytest.approx(1200.0 * math.pi / 30.0)


def test_pressures_and_temperatures_become_si() -> None:
    loop_4_20 = sensor("pressure", "bar", scale=250 / 16, offset=-250 / 4)
    assert loop_4_20.read(4.0) == pytest.approx(0.0, abs=1e-6)
    assert loop_4_20.read(20.0) == pytest.approx(25e6)
    assert sensor("temperature", "degC", scale=10.0, offset=-40.0).read(8.0) == pytest.approx(313.15)
    assert sensor("temperature", "K").read(313.0) == 313.0


# Linkages


def table(angles: list[float], interpolation: str, strokes: list[float]) -> Sensor:
    linkage = {"unit": "deg", "table": {"stroke": strokes, "angle": angles, "interpolation": interpolation}}
    return sensor("linear_scale", "mm", linkage=linkage)


@given(
    steps=st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.01, 10)), min_size=1, max_size=8),
    falling=st.booleans(),
    interpolation=st.sampled_from(["linear", "cubic"]),
)
def test_a_table_goes_through_its_points_and_never_turns_back(
    steps: list[tuple[float, float]], falling: bool, interpolation: str
) -> None:
    strokes = [sum(s for s, _ in steps[:k]) for k in range(len(steps) + 1)]
    sign = -1.0 if falling else 1.0
    angles = [sign * sum(a for _, a in steps[:k]) for k in range(len(steps) + 1)]
    scale = table(angles, interpolation, strokes)
    assert [math.degrees(scale.read(s)) for s in strokes] == pytest.approx(angles, abs=1e-9)
    between = np.linspace(-1.0, strokes[-1] + 1.0, 200)
    curve = [sign * scale.read(float(s)) for s in between]
    assert all(b >= a - 1e-12 for a, b in pairwise(curve))


def test_the_cubic_table_is_the_monotone_curve_of_fritsch_and_butland() -> None:
    strokes, angles = [0.0, 10.0, 25.0, 30.0, 60.0], [-30.0, -18.0, -2.0, 4.0, 30.0]
    scale = table(angles, "cubic", strokes)
    inner = np.linspace(10.0, 30.0, 41)  # scipy bends the outermost pieces by a rule of its own
    assert [math.degrees(scale.read(float(s))) for s in inner] == pytest.approx(
        PchipInterpolator(strokes, angles)(inner), abs=1e-9
    )


def test_beyond_its_ends_a_table_goes_straight_on() -> None:
    scale = table([-30.0, 0.0, 40.0], "linear", [0.0, 10.0, 20.0])
    assert [math.degrees(scale.read(s)) for s in (-5.0, 25.0)] == pytest.approx([-45.0, 60.0])


@given(
    base=st.floats(0.2, 1.0),
    arm=st.floats(0.05, 0.15),
    zero_angle=st.floats(0.6, 2.4),
    swing=st.floats(-0.5, 0.5),
    sign=st.sampled_from([1, -1]),
)
def test_the_crank_formula_agrees_with_points_in_the_plane(
    base: float, arm: float, zero_angle: float, swing: float, sign: int
) -> None:
    def length(direction: float) -> float:
        pin = complex(arm * math.cos(direction), arm * math.sin(direction))
        return abs(pin - complex(base, 0.0))

    zero, rod = 0.03, length(zero_angle) - 0.03
    crank = {"base": base, "rod": rod, "arm": arm, "zero": zero, "sign": sign}
    scale = sensor("linear_scale", "mm", linkage={"crank": crank})
    stroke = length(zero_angle + sign * swing) - rod
    assert scale.read(1000.0 * stroke) == pytest.approx(swing, abs=1e-9)
    assert scale.read(1000.0 * zero) == pytest.approx(0.0, abs=1e-12)


def test_a_crank_stops_where_its_triangle_ends() -> None:
    scale = sensor("linear_scale", "m", linkage={"crank": {"base": 0.5, "rod": 0.5, "arm": 0.1}})
    assert scale.read(1.0) == scale.read(0.1000001)
    assert scale.read(-1.0) == scale.read(-0.1000001) < 0.0


# What is no measurement


def test_a_broken_wire_is_told_and_gives_no_number() -> None:
    current = sensor("linear", "deg", scale=5.0, range=[3.8, 20.5])
    assert current.read(3.8) == pytest.approx(math.radians(19.0))
    assert current.trouble == ""
    assert math.isnan(current.read(0.0))
    assert current.trouble == "the channel reads 0, a sound sensor 3.8 to 20.5"
    current.read(12.0)
    assert current.trouble == ""


def test_samples_at_the_clip_are_marked() -> None:
    volts = sensor("fv_converter", "rad/s", scale=12.0, saturation=[-9.9, 9.9])
    marked = []
    for raw in (0.0, 9.89, 9.9, 10.0, -9.9, 1.0):
        volts.read(raw)
        marked.append(volts.saturated)
    assert marked == [False, False, True, True, True, False]
