"""Tones on an axis: what is put out, what the guard makes of too much, where it ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from seod.loop.excite import Coast
from seod.loop.tones import Tone, Tones, read_tones
from seod.processes.ring import AxisState
from tests.unit.loop_bench import Bench, merge
from tests.unit.test_velocity import VELOCITY

if TYPE_CHECKING:
    from collections.abc import Iterator

TONES = [[5.0, 0.1, 0.3], [15.0, 0.05, -1.0]]


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    made.run(0.05)
    yield made
    made.close()


def test_the_sum_is_put_out_rises_and_is_clipped() -> None:
    tones = Tones(10.0, 12.0, 0.5, 0.12, read_tones(TONES), Coast())
    t = np.arange(10.5, 11.999, 1e-3)
    wave = sum(a * np.sin(2 * np.pi * f * (t - 10.0) + p) for f, a, p in TONES)
    assert np.allclose([tones.step(x, 0.0) for x in t], np.clip(wave, -0.12, 0.12))
    assert tones.step(10.0, 0.0) == 0.0
    assert tones.step(10.25, 0.0) == pytest.approx(
        0.5 * sum(a * math.sin(2 * math.pi * f * 0.25 + p) for f, a, p in TONES)
    )
    assert tones.step(12.0, 0.0) == 0.0


@pytest.mark.parametrize(
    ("tones", "why"),
    [
        ([[1.0, 0.1]], "each is"),
        ([[0.0, 0.1, 0.0]], "frequency > 0"),
        ([[1.0, math.nan, 0.0]], "each is"),
        ([[1.0, 0.1, 0.0]] * 61, "at most 60"),
    ],
)
def test_what_is_no_tone_is_refused(tones: list[list[float]], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read_tones(tones)
    assert read_tones(TONES) == tuple(Tone(*tone) for tone in TONES)


def test_an_axis_is_driven_about_where_it_stood_and_comes_back(bench: Bench) -> None:
    assert bench.call("drive", 0, volts=0.15, duration=1.0, tones=TONES) is None
    bench.run(3.0)
    assert bench.state is AxisState.IDLE
    rows = [row for row in bench.rows() if row["state"] == AxisState.EXCITING]
    assert len(rows) == pytest.approx(2000, abs=2)
    u, y = np.array([row["u"] for row in rows]), np.array([row["y"] for row in rows])
    assert 0.1 < np.ptp(u) / 2.0 < 0.16
    assert np.ptp(y) > 0.02
    assert abs(y[-1000:].mean()) < 0.01  # held, not drifting
    assert not bench.take("fault")


def test_an_unbalanced_valve_does_not_carry_it_away() -> None:
    drift = {"simulation": {"plants": {"motor": {"effects": {"null_shift": {"voltage": 0.03}}}}}}
    bench = Bench(drift)
    bench.run(0.05)
    assert bench.call("drive", 0, volts=0.15, duration=4.0, tones=TONES) is None
    bench.run(6.0)
    y = np.array([row["y"] for row in bench.rows() if row["state"] == AxisState.EXCITING])
    bench.close()
    assert abs(y).max() < 0.2  # by itself 17 * 0.03 * 4 = 2 rad, beyond its travel


@pytest.mark.parametrize(
    ("limits", "code"),
    [({"amplitude": 0.05}, "amplitude"), ({"travel": (-0.05, 0.05)}, "travel"), ({"speed": 1.0}, "speed")],
)
def test_too_much_ends_at_neutral(limits: dict[str, object], code: str) -> None:
    off = {"enabled": False, "movement": 0.01}
    bench = Bench({"axes": {"motor": {"limits": limits, "polarity": off}}})
    bench.run(0.05)
    assert bench.call("drive", 0, volts=0.5, duration=5.0, tones=[[2.0, 0.5, 0.0]]) is None
    bench.run(1.0)
    state, volts, fault = bench.state, bench.volts, bench.take("fault")[-1]
    bench.close()
    assert (state, volts, fault["code"]) == (AxisState.FAULT, 0.0, code)


def test_the_emergency_stop_and_stop_end_tones(bench: Bench) -> None:
    assert bench.call("drive", 0, volts=0.15, duration=5.0, tones=TONES) is None
    bench.run(0.5)
    assert bench.state is AxisState.EXCITING
    assert bench.call("stop", 0) is None
    bench.run(0.5)
    assert bench.state is AxisState.IDLE
    assert bench.call("drive", 0, volts=0.15, duration=5.0, tones=TONES) is None
    bench.run(0.5)
    assert bench.call("estop") is None
    bench.run(0.01)
    assert (bench.state, bench.volts) == (AxisState.FAULT, 0.0)


def test_wrong_tones_move_nothing(bench: Bench) -> None:
    assert "each is" in str(bench.call("drive", 0, volts=0.15, duration=5.0, tones=[[1.0]]))
    assert "limits.output" in str(bench.call("drive", 0, volts=2.5, duration=5.0, tones=TONES))
    assert bench.state is AxisState.IDLE


def test_a_speed_axis_is_driven_about_its_reference() -> None:
    bench = Bench(merge(VELOCITY, {"axes": {"motor": {"reference": 20.0}}}))
    bench.run(0.05)
    assert bench.call("drive", 0, volts=0.3, duration=1.0, tones=[[5.0, 0.3, 0.0]]) is None
    bench.run(6.0)
    rows = bench.rows()
    speed = np.array([row["y"] for row in rows if row["state"] == AxisState.EXCITING])
    state, left = bench.state, rows[-1]["y"]
    bench.close()
    assert speed.mean() == pytest.approx(20.0, abs=1.0)
    assert np.ptp(speed) > 5.0
    assert state is AxisState.IDLE
    assert abs(left) < 3.0


def test_tones_that_beat_are_no_growing_oscillation(bench: Bench) -> None:
    beat = [[4.0, 0.1, 0.0], [4.2, 0.095, math.pi]]
    assert bench.call("drive", 0, volts=0.2, duration=9.0, tones=beat) is None
    bench.run(8.0)
    assert bench.state is AxisState.EXCITING, bench.take("fault")
