"""The loop on a virtual rig and simulated time: states, limit cycle, bursts, polarity."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random
from typing import TYPE_CHECKING

import pytest

from seod.processes.ring import FLAG_EXCITING, AxisState
from tests.unit.loop_bench import PERIOD, Bench, axis

if TYPE_CHECKING:
    from collections.abc import Callable


def test_start_runs_through_the_states_and_back_to_where_it_stood(bench: Callable[..., Bench]) -> None:
    rig = bench()
    before = rig.rows()[-1]["y"]
    assert rig.call("start") is None
    assert rig.state is AxisState.ARMED
    rig.run(1.5)
    assert rig.state is AxisState.EXCITING
    assert rig.call("stop") is None
    assert rig.state is AxisState.HOLDING
    rig.run(3.0)
    assert rig.state is AxisState.IDLE
    assert rig.volts == 0.0
    assert rig.rows()[-1]["y"] == pytest.approx(before, abs=0.06)
    states = [e["state"] for e in rig.take("state")]
    assert states == ["armed", "exciting", "holding", "idle"]


def test_the_limit_cycle_is_the_plants(bench: Callable[..., Bench]) -> None:
    """Period and amplitude within the sampled relay's error of the exact limit cycle's (zeta 0.21)."""
    rig = bench()
    rig.call("start")
    rig.run(4.0)
    rows = [r for r in rig.rows() if int(r["flags"]) & FLAG_EXCITING][2000:]
    switches = [b["t"] for a, b in pairwise(rows) if a["u"] < 0 < b["u"]]
    period = (switches[-1] - switches[0]) / (len(switches) - 1)
    assert 2 * math.pi / period == pytest.approx(0.9986 * 117.0, rel=0.02)
    amplitude = (max(r["y"] for r in rows) - min(r["y"] for r in rows)) / 2
    assert amplitude == pytest.approx(1.276 * 17 * 0.5 / (2 * 0.21 * 117), rel=0.04)


def another_axis_sensor(rig: Bench) -> None:
    """From now on the sensor's readings are of an axis that stands where this one does: noise alone."""
    axis, noise, at = rig.loop.axes[0], Random(1), rig.loop.axes[0].y
    sense = axis.sense
    axis.sense = lambda sample: sense(sample._replace(value=at + noise.gauss(0.0, 1e-4)))  # type: ignore[method-assign]


def test_a_relay_that_sees_another_still_axis_faults_before_the_load_has_gone_far(
    bench: Callable[..., Bench],
) -> None:
    rig = bench({"guard": {"frozen": 0.05}})
    rig.call("start")
    rig.run(4.0)
    assert not rig.faults()
    another_axis_sensor(rig)
    began = rig.pacer.now()
    rig.run(0.5)
    (fault,) = rig.take("fault")
    assert fault["code"] == "no_switch"
    longest_half = 1.2 * math.pi / 117.0
    assert fault["t"] - began < max(0.05, 4.0 * longest_half) + 2 * PERIOD
    assert rig.volts == 0.0


def test_before_a_limit_cycle_is_known_the_rig_files_limit_counts_and_after_a_change_too(
    bench: Callable[..., Bench],
) -> None:
    rig = bench(
        {"guard": {"no_switch": 0.3, "frozen": 0.05}, "axes": {"motor": {"polarity": {"enabled": False}}}}
    )
    rig.call("start")
    rig.run(4.0)
    assert rig.call("set", 0, e_a=0.45) is None
    another_axis_sensor(rig)
    rig.run(0.25)
    assert not rig.faults()
    rig.run(0.1)
    assert rig.faults() == ["no_switch"]


def test_entry_is_smooth_and_rows_tell_it(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(excitation={"entry": 0.2}, polarity={"enabled": False}))
    rig.rows()
    rig.call("start")
    rig.run(0.5)
    rows = rig.rows()
    ramp = [r for r in rows if 0 < r["e_a"] < 0.5]
    assert len(ramp) == pytest.approx(400, abs=2)
    assert all(abs(abs(r["u"]) - r["e_a"]) < 1e-12 for r in ramp)
    assert not any(int(r["flags"]) & FLAG_EXCITING for r in ramp)
    assert int(rows[-1]["flags"]) & FLAG_EXCITING


def test_bursts_alternate_with_holds(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(excitation={"kind": "burst", "duration": 0.3, "pause": 0.4}))
    rig.call("start")
    rig.run(5.0)
    states = [e["state"] for e in rig.take("state")]
    assert states[:6] == ["armed", "exciting", "holding", "exciting", "holding", "exciting"]
    rig.call("stop")
    rig.run(3.5)
    assert rig.state is AxisState.IDLE


def test_wrong_polarity_never_closes_the_loop(bench: Callable[..., Bench]) -> None:
    rig = bench({"outputs": {"valve": {"scale": -1.0}}})
    rig.call("start")
    rig.run(1.0)
    assert rig.state is AxisState.FAULT
    assert rig.faults() == ["polarity"]
    assert "wrong sign" in rig.take("fault")[0]["why"]
    assert "exciting" not in [e["state"] for e in rig.take("state")]
    assert max(abs(r["y"]) for r in rig.rows()) < 0.15


def test_no_pressure_is_told_from_wrong_polarity(bench: Callable[..., Bench]) -> None:
    rig = bench({"simulation": {"plants": {"motor": {"K_L": 1e-3}}}})
    rig.call("start")
    rig.run(1.0)
    assert rig.faults() == ["polarity"]
    assert "no movement" in rig.take("fault")[0]["why"]


def test_polarity_is_seen_through_a_drift(bench: Callable[..., Bench]) -> None:
    rig = bench(
        {"simulation": {"plants": {"motor": {"effects": {"null_shift": {"voltage": 0.2}}}}}}
    )  # drifts the other way at -3.4 rad/s
    rig.run(0.1)
    rig.call("start")
    rig.run(0.3)
    (polarity,) = rig.take("polarity")
    assert polarity["ok"]
