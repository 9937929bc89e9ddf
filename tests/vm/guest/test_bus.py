"""A bus that breaks: every failure is told, ends in neutral, and is left only by a reset."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bus import CAN_ERR_BUSOFF, CAN_ERR_CRTL, CAN_ERR_FLAG, CAN_ERR_RESTARTED, ip, send_raw, slow_bus

from tests.peers import RpcError, until

if TYPE_CHECKING:
    from bus import Listener
    from conftest import Bench

PASSIVE = 0x30
"""data[1] of an error message: receive and transmit side are error-passive."""

IN_FLIGHT = 3
"""`max_in_flight` of rig.yaml."""


def can_start(bench: Bench) -> bool:
    """Whether a start is no longer refused."""
    try:
        bench.daemon.call("start")
    except RpcError:
        return False
    return True


def test_interface_down_and_up(bench: Bench, listener: Listener) -> None:
    bench.excite()
    ip("link", "set", "vcan0", "down")
    fault = bench.daemon.event(event="fault")
    assert fault["code"] in ("link", "stale_sample")
    until("the rig's own watchdog", bench.rig_is_neutral)
    listener.read()
    seen = len(listener.frames)
    ip("link", "set", "vcan0", "up")
    until("commands again", lambda: len(listener.read()) > seen + 20)
    assert {frame.volts for frame in listener.frames[seen:]} == {0.0}
    assert bench.state() == "fault"
    with pytest.raises(RpcError, match="reset first"):
        bench.daemon.call("start")
    bench.recover()
    bench.excite()
    assert bench.counters()["interface_down"] > 0


def test_bus_off_is_a_fault(bench: Bench) -> None:
    bench.excite()
    before = bench.counters()
    send_raw(CAN_ERR_FLAG | CAN_ERR_BUSOFF, bytes(8))
    fault = bench.daemon.event(event="fault")
    assert fault["code"] == "link"
    assert "bus" in fault["why"]
    until("neutral", bench.rig_is_neutral)
    until("the counter", lambda: bench.counters()["bus_off"] == before["bus_off"] + 1)
    bench.daemon.call("reset")
    with pytest.raises(RpcError, match="bus-off"):
        bench.daemon.call("start")
    send_raw(CAN_ERR_FLAG | CAN_ERR_RESTARTED, bytes(8))
    bench.daemon.event(event="warning", why="the rig can be reached again")
    bench.excite()


def test_error_frames_are_counted(bench: Bench) -> None:
    bench.excite()
    before = bench.counters()
    for _ in range(5):
        send_raw(CAN_ERR_FLAG | CAN_ERR_CRTL, bytes([0, PASSIVE, 0, 0, 0, 0, 0, 0]))
    until("the counters", lambda: bench.counters()["error_passive"] > before["error_passive"])
    until("each frame", lambda: bench.counters()["error_frames"] >= before["error_frames"] + 5)


def test_a_full_queue_is_a_fault_and_no_stale_command_leaves_it(bench: Bench, listener: Listener) -> None:
    bench.excite()
    until("commands", lambda: len(listener.read()) > 100)
    before = bench.counters()
    with slow_bus():
        bench.rig.call("garbage", rate_hz=2000.0)  # fills the queue, which daemon and rig share
        fault = bench.daemon.event(event="fault")
        until(
            "ENOBUFS, or commands held back",
            lambda: sum(bench.counters()[n] - before[n] for n in ("no_buffers", "deferred")) > 0,
        )
        bench.rig.call("clear")
        until("neutral on the bus", lambda: listener.read()[-1].volts == 0.0)
        seen = len(listener.frames)
        until("more of what the queue held", lambda: len(listener.read()) > seen + 5)
        late = [frame.volts for frame in listener.frames if frame.t > fault["t"]]
        stale = late.index(0.0)
        assert stale <= IN_FLIGHT
        assert set(late[stale:]) == {0.0}
    sent = bench.counters()["frames_sent"]
    until("half a second of commands", lambda: bench.counters()["frames_sent"] > sent + 50)
    bench.daemon.event(event="warning", why="the rig can be reached again")
    bench.recover()
    bench.center()
    bench.excite()


def test_a_silent_sensor_is_a_fault(bench: Bench) -> None:
    bench.excite()
    bench.rig.call("stop")
    fault = bench.daemon.event(event="fault")
    assert fault["code"] == "silent"  # both channels are in the same message
    until("neutral", bench.rig_is_neutral)


def test_a_frozen_sensor_is_a_fault(bench: Bench) -> None:
    bench.excite()
    bench.rig.call("freeze")
    fault = bench.daemon.event(event="fault")
    assert fault["code"] == "frozen_sensor"
    assert fault["numbers"]["still_s"] > fault["numbers"]["limit_s"]
    until("neutral", bench.rig_is_neutral)


def test_the_estop_line_stops_the_rig_and_keeps_it_stopped(bench: Bench) -> None:
    bench.excite()
    bench.rig.call("constant", channel="Encoder.run_enable", value=0.0)
    assert bench.daemon.event(event="fault")["code"] == "estop"
    until("neutral", bench.rig_is_neutral)
    bench.daemon.call("reset")
    with pytest.raises(RpcError, match="e-stop"):
        bench.daemon.call("start")
    bench.rig.call("constant", channel="Encoder.run_enable", value=1.0)
    until("the line's new state", lambda: can_start(bench))
