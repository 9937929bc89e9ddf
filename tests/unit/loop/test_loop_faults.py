"""What stops the loop: limits, estop, silent sensors, a lost link, a stand-still, errors of its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from seod.loop.guard import SupervisorGuard
from seod.processes.ring import AxisState, Word
from tests.unit.loop_bench import PERIOD, Bench, axis

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        (axis(limits={"amplitude": 0.1}), "amplitude"),
        (axis(limits={"travel": (-0.15, 0.15)}), "travel"),
        (axis(limits={"speed": 10.0}), "speed"),
    ],
)
def test_limits_fault_in_the_same_tick_and_latch(
    bench: Callable[..., Bench], changes: dict[str, Any], code: str
) -> None:
    rig = bench(changes)
    rig.call("start")
    rig.run(2.0)
    assert rig.faults() == [code]
    fault = rig.take("fault")[0]
    rows = {r["tick_time"]: r for r in rig.rows()}
    assert rows[fault["t"]]["u"] == 0.0
    assert rows[fault["t"]]["state"] == AxisState.FAULT
    assert fault["numbers"]
    assert rig.call("start") == "motor is in fault: reset first"
    assert rig.state is AxisState.FAULT
    assert rig.call("reset") is None
    assert rig.state is AxisState.IDLE


def test_a_load_moved_by_hand_between_fault_and_start_is_no_speed(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(limits={"travel": (-3.0, 3.0)}))
    rig.call("start")
    rig.run(1.0)
    rig.call("estop")
    assert rig.driver.rig is not None
    rig.driver.rig.actuators["motor"].change(rig.pacer.now(), {"position": 2.5})
    rig.run(5e-3)
    rig.call("reset")
    assert rig.call("start") is None
    rig.run(0.5)
    assert rig.faults() == ["estop"]
    assert rig.state is AxisState.EXCITING


def test_estop_command_is_neutral_within_its_tick(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    assert rig.volts != 0.0
    assert rig.call("estop") is None
    assert rig.volts == 0.0
    assert rig.state is AxisState.FAULT


def test_estop_line_blocks_the_start_and_stops_a_running_rig(bench: Callable[..., Bench]) -> None:
    rig = bench({"guard": {"estop": {"channel": "estop"}}})
    rig.call("start")
    rig.run(0.5)
    assert rig.state is AxisState.EXCITING
    line = rig.loop.config.guard.estop
    assert line is not None
    read = rig.driver.read
    rig.driver.read = lambda t: [s if s.value != 1.0 else s._replace(value=0.0) for s in read(t)]  # type: ignore[method-assign] # the line opens
    rig.run(2 * PERIOD)
    assert rig.faults() == ["estop"]
    assert rig.volts == 0.0
    rig.call("reset")
    error = rig.call("start")
    assert error is not None
    assert "e-stop" in error


def test_silent_sensor_faults_when_moving_and_blocks_the_start(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    frozen = rig.driver.read(rig.pacer.now())
    rig.driver.read = lambda t: frozen  # type: ignore[method-assign] # no new samples come
    rig.run(0.03)
    assert rig.faults() == ["stale_sample"]
    assert rig.volts == 0.0
    rig.call("reset")
    error = rig.call("start")
    assert error is not None
    assert "ms old" in error


def test_a_rig_of_which_nothing_comes_is_not_told_as_an_estop(bench: Callable[..., Bench]) -> None:
    rig = bench({"guard": {"estop": {"channel": "estop"}}})
    rig.call("start")
    rig.run(0.5)
    frozen = rig.driver.read(rig.pacer.now())
    rig.driver.read = lambda t: frozen  # type: ignore[method-assign] # no new samples come
    rig.run(0.03)
    (fault,) = rig.take("fault")
    assert fault["code"] == "silent"
    assert "nothing has come from the rig for" in fault["why"]
    rig.call("reset")
    assert "switched on" in str(rig.call("start"))


def test_a_silent_sensor_is_told_with_what_its_frames_look_like(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    old, read = list(rig.loop.samples), rig.driver.read
    rig.driver.read = lambda t: [old[0], *read(t)[1:]]  # type: ignore[method-assign]
    rig.driver.why_old = lambda place: "its counter stands still" if place == 0 else ""  # type: ignore[method-assign]
    rig.run(0.1)
    (fault,) = rig.take("fault")
    assert fault["code"] == "stale_sample"
    assert fault["why"].endswith("; its counter stands still")


def test_remarks_of_the_driver_are_warnings_once(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.driver.remarks.append(("repeated_frames", "Encoder: 3 frames"))
    rig.run(0.1)
    assert [(w["code"], w["why"]) for w in rig.take("warning")] == [("repeated_frames", "Encoder: 3 frames")]
    assert rig.driver.remarks == []


def test_an_estop_line_that_is_silent_alone_is_the_estops(bench: Callable[..., Bench]) -> None:
    rig = bench({"guard": {"estop": {"channel": "estop"}}})
    rig.call("start")
    rig.run(0.5)
    read, then = rig.driver.read, rig.pacer.now()
    rig.driver.read = lambda t: [s if s.value != 1.0 else s._replace(t=then) for s in read(t)]  # type: ignore[method-assign]
    rig.run(0.03)
    assert rig.faults() == ["estop"]


def test_lost_link_faults_and_is_told(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    rig.driver.trouble = "interface vcan0 is down"
    rig.run(2 * PERIOD)
    assert rig.faults() == ["link"]
    rig.call("reset")
    assert rig.call("start") == "interface vcan0 is down"
    rig.driver.trouble = ""
    rig.run(2 * PERIOD)
    assert rig.call("start") is None
    assert [w["why"] for w in rig.take("warning")] == [
        "interface vcan0 is down",
        "the rig can be reached again",
    ]


def test_excitation_budget_stops_without_a_fault(bench: Callable[..., Bench]) -> None:
    rig = bench(axis(limits={"excitation": 1.0}))
    rig.call("start")
    rig.run(5.0)
    assert rig.state is AxisState.IDLE
    assert rig.faults() == []
    assert [w["code"] for w in rig.take("warning")] == ["excitation_budget"]


def test_dead_man(bench: Callable[..., Bench]) -> None:
    rig = bench({"guard": {"dead_man": 0.5}})
    rig.call("start")
    for _ in range(5):
        rig.run(0.3)
        rig.call("keepalive")
    assert rig.state is AxisState.EXCITING
    rig.run(0.6)
    assert rig.faults() == ["dead_man"]


def test_a_loop_that_stood_still_does_not_act_on_the_old_world(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    rig.pacer.lateness = 0.2
    rig.run(PERIOD)
    assert rig.faults() == ["hang"]
    assert rig.volts == 0.0


def test_fenced_loop_writes_nothing_more(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    sent = rig.driver.counters[1]
    rig.shared.words[Word.FENCE] = 1
    with pytest.raises(SystemExit):
        rig.run(PERIOD)
    with pytest.raises(SystemExit):
        rig.loop.finish()
    assert rig.driver.counters[1] == sent


def test_neutral_is_repeated_at_the_end_for_a_frame_can_be_lost(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    written: list[str] = []
    rig.driver.neutral = lambda t: written.append("neutral") or t  # type: ignore[method-assign, func-returns-value]
    rig.driver.write = lambda t, values: written.append("command") or t  # type: ignore[method-assign, func-returns-value]
    rig.loop.ending = True
    rig.loop.run()
    assert len(written) > 10
    assert set(written) == {"neutral"}


@pytest.mark.parametrize("state", ["idle", "exciting"])
def test_a_supervisor_that_stands_still_is_a_fault_until_it_goes_on(
    bench: Callable[..., Bench], state: str
) -> None:
    rig = bench()
    rig.loop.supervisor = SupervisorGuard(PERIOD)  # as on a rig that is on the clock
    words = rig.shared.words

    def run(seconds: float, beating: bool) -> None:
        for _ in range(round(seconds / 0.01)):
            words[Word.BEATS] += beating
            rig.run(0.01)

    run(0.1, True)
    if state == "exciting":
        rig.call("start")
        run(1.0, True)
    run(0.1, False)  # a busy machine
    assert rig.faults() == []
    run(0.1, False)
    assert rig.faults() == ["supervisor"]
    assert "supervisor process has stood still for 180 ms" in rig.take("fault")[0]["why"]
    assert rig.volts == 0.0
    rig.call("reset")
    run(0.02, False)
    assert rig.state is AxisState.FAULT
    words[Word.BEATS] += 1
    rig.call("reset")
    run(0.5, True)
    assert rig.state is AxisState.IDLE
    assert rig.call("start") is None


def test_an_exception_in_the_loop_ends_in_neutral_and_is_told(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    actuator = rig.driver.rig
    assert actuator is not None

    def broken(t: float) -> Any:
        raise ZeroDivisionError("sensor driver broke")

    rig.driver.read = broken  # type: ignore[method-assign] # a bug in a driver
    with pytest.raises(ZeroDivisionError):
        rig.loop.run()
    assert actuator.state(rig.pacer.now())["motor"]["voltage"] == 0.0
    assert rig.faults() == ["exception"]
    assert "sensor driver broke" in rig.take("fault")[0]["why"]


def test_a_controller_that_asks_for_no_number_faults(bench: Callable[..., Bench]) -> None:
    rig = bench()
    rig.call("start")
    rig.run(1.0)
    rig.loop.axes[0].course.controller.step = lambda t, e: math.nan  # type: ignore[method-assign] # a bug
    rig.run(PERIOD)
    assert rig.faults() == ["non_finite"]
    assert rig.volts == 0.0
