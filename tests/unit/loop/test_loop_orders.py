"""What the loop is told and tells: settings, drives, resets, rows and times of leaving."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from drivers.base import StampError
from seod.loop.guard import Trip
from seod.loop.meter import COUNTERS_EVERY
from seod.observe.health import Health
from seod.processes.ring import FLAG_EXCITING, AxisState
from tests.unit.loop_bench import PERIOD, Bench, axis

if TYPE_CHECKING:
    from collections.abc import Callable


def asked(rig: Bench, op: str, count: int = 1) -> int:
    """Put commands into the mailbox without a tick; the id of the last one."""
    for _ in range(count):
        rig.ids += 1
        rig.shared.commands.put({"id": rig.ids, "op": op, "axis": None, "values": {}})
    return rig.ids


def test_set_takes_effect_while_running_and_is_held_to_the_limits(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    assert rig.call("set", e_a=0.3, bias=0.05) is None
    rig.rows()
    rig.run(0.5)
    assert {round(r["u"], 9) for r in rig.rows()} == {0.35, -0.25}
    for values in ({"e_a": 2.1}, {"e_a": 1.0, "bias": 1.2}, {"e_a": 0.0}, {"hysteresis": 0.7}, {"gain": 1.0}):
        assert rig.call("set", **values) is not None
    assert rig.loop.axes[0].settings["e_a"] == 0.3


def test_rows_are_the_ticks_without_a_gap(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.run(0.2)
    rows = rig.rows()
    ticks = [r["tick"] for r in rows]
    assert ticks == list(range(len(rows)))
    assert all(r["t"] <= r["t_u"] for r in rows)


def test_confirmed_time_of_leaving_goes_into_its_own_row(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.driver.left = lambda: [t + 1e-4 for t in rig.loop.log.values[:1]]  # type: ignore[method-assign] # an echo
    rig.run(0.1)
    rows = rig.rows()[110:]
    assert all(r["t_u"] - r["tick_time"] == pytest.approx(1e-4, abs=1e-9) for r in rows)


def test_a_command_that_did_not_leave_is_not_in_the_rows(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    rig.rows()
    rig.driver.write = lambda t, values: math.nan  # type: ignore[method-assign] # no room in the queue
    rig.loop.axes[0].course.controller.step = lambda t, e: 0.123  # type: ignore[method-assign] # another command
    rig.run(0.005)
    last, *rows = rig.rows()  # the first is of the tick before
    assert len(rows) == 9
    assert {(r["u"], r["t_u"]) for r in rows} == {(last["u"], last["t_u"])}


def test_how_far_stamps_may_be_off_is_in_the_health_message(bench: Callable[..., Bench]) -> None:
    b = bench()
    told = Health(b.shared).loop(0.0, [])
    assert (told["stamp_common_sd_s"], told["stamp_scatter_sd_s"]) == (None, None)
    b.driver.stamp_error = lambda: StampError(2e-4, 1.5e-3)  # type: ignore[method-assign]
    b.run(2 * COUNTERS_EVERY * PERIOD)
    told = Health(b.shared).loop(0.0, [])
    assert (told["stamp_common_sd_s"], told["stamp_scatter_sd_s"]) == (2e-4, 1.5e-3)


def test_a_reset_asked_for_before_a_fault_does_not_leave_it(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    asked(rig, "keepalive", 40)
    early = asked(rig, "reset")
    rig.loop.pending = Trip("link", "the rig cannot be reached")
    rig.run(20 * PERIOD)
    (reply,) = [e for e in rig.take("reply") if e["id"] == early]
    assert reply["error"] == "a fault came after this reset was asked for: see what it was, then reset"
    assert rig.state is AxisState.FAULT
    assert rig.call("reset") is None
    assert rig.state is AxisState.IDLE


def test_what_a_lost_gateway_still_asked_for_is_not_done(bench: Callable[..., Bench]) -> None:
    rig = bench({"guard": {"gateway_lost": "hold"}})
    rig.run(0.1)
    asked(rig, "start")
    rig.loop.gateway_lost = True
    rig.run(0.1)
    assert rig.state is AxisState.IDLE
    assert rig.call("start") is None


def test_unknown_command_is_answered(bench: Callable[..., Bench]) -> None:
    assert bench().call("dance") == "unknown command 'dance'"


def test_a_drive_puts_out_its_voltage_and_goes_back(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(relay={"bias": 0.1}))
    assert rig.call("drive", volts=-0.3, duration=0.2) is None
    rig.run(0.3)  # the polarity pulse, and the way back from it
    while rig.state is AxisState.ARMED:
        rig.run(0.01)
    rig.rows()
    rig.run(0.1)
    rows = rig.rows()[10:]
    assert [r["u"] for r in rows] == pytest.approx([-0.2] * len(rows))
    assert {r["e_a"] for r in rows} == {0.0}
    assert not any(int(r["flags"]) & FLAG_EXCITING for r in rows)
    rig.run(4.0)
    assert [e["state"] for e in rig.take("state")] == ["armed", "exciting", "holding", "idle"]


def test_a_drive_is_guarded_all_the_way(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(polarity={"enabled": False}))
    rig.call("drive", volts=1.5, duration=1.0)
    rig.run(0.5)
    assert rig.faults() == ["travel"]
    assert rig.volts == 0.0


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"volts": 2.1, "duration": 0.1}, "limits.output"),
        ({"volts": math.nan, "duration": 0.1}, "limits.output"),
        ({"volts": 0.1, "duration": 61.0}, "limits.excitation"),
        ({"volts": 0.1, "duration": 0.0}, "duration must be > 0"),
    ],
)
def test_a_drive_beyond_the_limits_is_refused(
    bench: Callable[..., Bench], values: dict[str, float], told: str
) -> None:
    rig = bench()
    assert told in str(rig.loop.start(rig.pacer.now(), rig.loop.axes, **values))
    assert rig.state is AxisState.IDLE
