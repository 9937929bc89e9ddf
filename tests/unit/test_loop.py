"""The loop on a virtual rig and simulated time: states, guard in the same tick, mailbox, rows, fence."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from drivers.base import StampError
from seod.loop.guard import SupervisorGuard, Trip
from seod.loop.meter import COUNTERS_EVERY
from seod.observe.health import Health
from seod.processes.ring import FLAG_EXCITING, AxisState, Word
from tests.unit.loop_bench import PERIOD, Bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MakeBench = "Callable[..., Bench]"


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(changes: dict[str, Any] | None = None) -> Bench:
        made.append(Bench(changes))
        made[-1].run(0.05)
        return made[-1]

    yield make
    for each in made:
        each.close()


def axis(**changes: Any) -> dict[str, Any]:
    return {"axes": {"motor": changes}}


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


def asked(rig: Bench, op: str, count: int = 1) -> int:
    """Put commands into the mailbox without a tick; the id of the last one."""
    for _ in range(count):
        rig.ids += 1
        rig.shared.commands.put({"id": rig.ids, "op": op, "axis": None, "values": {}})
    return rig.ids


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
