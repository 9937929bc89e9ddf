"""The CAN driver on python-can's virtual bus, and on a bus that fails on command."""

from __future__ import annotations

import errno
import itertools
import math
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import drivers.can_link
from drivers.base import NO_SAMPLE, DriverError
from drivers.can import CanDriver
from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from drivers.can_errors import bus_event
from drivers.clock import SLACK_S, StampClock
from drivers.neutral import CLASSIC, FLEXIBLE, NoNeutral, SocketcanNeutral, open_neutral, pack_frame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CONFIGS = Path(__file__).parents[2] / "configs"
ENCODER, VALVE = 257, 513
CHANNELS = itertools.count()


def options(directory: Path = CONFIGS, **changes: object) -> CanOptions:
    section = {"kind": "can", "interface": "virtual", "channel": "can0", "dbc": "motor.dbc", **changes}
    return CanOptions.model_validate(section, context={"directory": directory})


CODEC = CanCodec(options())


class Clock:
    """Time that stands until it is moved."""

    def __init__(self) -> None:
        self.t = 100.0

    def __call__(self) -> float:
        return self.t


class FakeBus:
    """A bus without a kernel: it echoes, and fails as told."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.sent: list[can.Message] = []
        self.incoming: list[can.Message | Exception] = []
        self.send_error: Exception | None = None
        self.echo = True
        self.closed = False

    def send(self, message: can.Message) -> None:
        if self.send_error is not None:
            raise self.send_error
        copy = can.Message(
            arbitration_id=message.arbitration_id,
            is_extended_id=message.is_extended_id,
            data=message.data,
            is_rx=False,
        )
        self.sent.append(copy)
        if self.echo:
            self.incoming.append(copy)

    def recv(self, timeout: float) -> can.Message | None:
        if not self.incoming:
            self.clock.t += timeout
            return None
        item = self.incoming.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def shutdown(self) -> None:
        self.closed = True

    def commands(self) -> list[tuple[float, int]]:
        """Voltage and counter of each command frame that left."""
        frames = [CODEC.decode(VALVE, False, m.data) for m in self.sent if m.arbitration_id == VALVE]
        return [(frame.values["voltage"], frame.counter or 0) for frame in frames]


class Rig:
    """A driver with its fake bus and clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **changes: object) -> None:
        self.clock = Clock()
        self.buses: list[FakeBus] = []
        self.asked: list[dict[str, object]] = []
        self.open_error: Exception | None = None
        self.attempts = 0
        monkeypatch.setattr(drivers.can_link.can, "Bus", self._open)
        monkeypatch.setattr(socket, "if_nametoindex", lambda name: 1)
        self.driver = CanDriver(options(**{"interface": "socketcan", **changes}), self.clock)
        self.driver.open(["Encoder.angle", "Encoder.run_enable"], ["Valve.voltage"])
        self.driver.start()
        self.driver._stamps._realtime = lambda: self.clock.t + 1e9
        self.driver._stamps._offset = self.driver._stamps._offset_before = 1e9

    def _open(self, **asked: object) -> FakeBus:
        self.attempts += 1
        if self.open_error is not None:
            raise self.open_error
        self.asked.append(asked)
        self.buses.append(FakeBus(self.clock))
        return self.buses[-1]

    @property
    def bus(self) -> FakeBus:
        return self.buses[-1]

    def encoder(self, angle: float, counter: int, at: float | None = None) -> None:
        """A sensor frame arrives, stamped now."""
        data = CODEC.encode("Encoder", {"angle": angle, "run_enable": 1}, counter)
        self.arrive(ENCODER, data, at)

    def arrive(self, frame_id: int, data: bytes, at: float | None = None, **flags: bool) -> None:
        stamp = 1e9 + (self.clock.t if at is None else at)
        flags = {"is_extended_id": False, **flags}
        self.bus.incoming.append(can.Message(arbitration_id=frame_id, data=data, timestamp=stamp, **flags))

    def error_frame(self, classes: int, controller: int = 0) -> None:
        self.arrive(classes, bytes([0, controller, 0, 0, 0, 0, 0, 0]), is_error_frame=True)

    def tick(self, volts: float | None = None) -> float:
        """One period passes, then read and write (or neutral)."""
        self.clock.t += 0.001
        self.driver.read(self.clock.t)
        if volts is None:
            return self.driver.neutral(self.clock.t)
        return self.driver.write(self.clock.t, [volts])

    def count(self, name: str) -> int:
        return self.driver.counters[self.driver.counter_names.index(name)]

    def angle(self) -> float:
        return self.driver.read(self.clock.t)[0].value


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    rig = Rig(monkeypatch)
    yield rig
    rig.driver.close()


Make = "Callable[..., Rig]"


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    rigs: list[Rig] = []

    def new(**changes: object) -> Rig:
        rigs.append(Rig(monkeypatch, **changes))
        return rigs[-1]

    yield new
    for rig in rigs:
        rig.driver.close()


def down() -> can.CanOperationError:
    return can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)


# What arrives


def test_the_filters_pass_exactly_the_frames_that_are_needed(rig: Rig) -> None:
    assert rig.asked[0]["can_filters"] == [
        {"can_id": ENCODER, "can_mask": 0x7FF, "extended": False},
        {"can_id": VALVE, "can_mask": 0x7FF, "extended": False},
    ]


def test_a_frame_becomes_a_sample_at_the_kernels_time(rig: Rig) -> None:
    assert list(rig.driver.read(rig.clock.t)) == [NO_SAMPLE, NO_SAMPLE]
    rig.clock.t += 0.002
    rig.encoder(0.5, 0, at=rig.clock.t - 0.0015)
    angle, enable = rig.driver.read(rig.clock.t)
    assert angle.value == pytest.approx(0.5)
    assert enable.value == 1
    assert angle.t == enable.t == pytest.approx(rig.clock.t - 0.0015, abs=1e-6)


def test_lost_repeated_and_reordered_frames_are_told_apart(rig: Rig) -> None:
    for value, counter in enumerate([10, 11, 14, 14, 13, 15]):
        rig.encoder(value, counter)
    assert rig.angle() == pytest.approx(5)
    assert (rig.count("lost"), rig.count("repeated"), rig.count("reordered")) == (2, 1, 1)
    assert rig.count("frames_received") == 4


def test_an_older_frame_never_replaces_a_newer_one(rig: Rig) -> None:
    rig.encoder(1.0, 255)
    rig.encoder(2.0, 0)
    rig.encoder(1.0, 255)
    assert rig.angle() == pytest.approx(2.0)
    assert rig.count("reordered") == 1


@settings(max_examples=40)
@given(st.lists(st.sampled_from(["next", "skip", "repeat", "back"]), max_size=60))
def test_the_sequence_check_against_a_plain_count(steps: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch)
        newest, wanted = 1000, {"lost": 0, "repeated": 0, "reordered": 0}
        rig.encoder(0.0, newest)
        for step in steps:
            sent = newest + {"next": 1, "skip": 5, "repeat": 0, "back": -3}[step]
            name = {"skip": "lost", "repeat": "repeated", "back": "reordered"}.get(step)
            if name:
                wanted[name] += 4 if step == "skip" else 1
            newest = max(newest, sent)
            rig.encoder(float(sent - 1000), sent)
        assert rig.angle() == pytest.approx(newest - 1000)
        assert {name: rig.count(name) for name in wanted} == wanted
        rig.driver.close()


def test_a_rig_that_starts_again_is_heard_after_a_few_frames(rig: Rig) -> None:
    rig.encoder(1.0, 3)
    for counter in range(8):
        rig.encoder(2.0, counter)
    assert rig.angle() == pytest.approx(2.0)


def test_broken_frames_are_counted_and_not_used(rig: Rig) -> None:
    rig.encoder(1.0, 0)
    bad = bytearray(CODEC.encode("Encoder", {"angle": 9.0}, 1))
    bad[0] ^= 1
    rig.arrive(ENCODER, bytes(bad))
    rig.arrive(ENCODER, bytes(5))
    rig.arrive(ENCODER, b"", is_remote_frame=True)
    rig.arrive(0x300, bytes(8))
    supply = CODEC.layout("Supply").message  # not asked for: it came before the filters
    rig.arrive(supply.frame_id, bytes(supply.length))
    assert rig.angle() == pytest.approx(1.0)
    assert rig.count("checksum_errors") == 1
    assert rig.count("wrong_length") == 1
    assert rig.count("unknown_frames") == 3
    rig.encoder(2.0, 1)  # the broken frame's counter is not believed either
    assert rig.angle() == pytest.approx(2.0)
    assert rig.count("lost") == 0


def test_late_frames_are_counted_where_the_rate_is_known(make: Callable[..., Rig]) -> None:
    rig = make(messages={"Encoder": {"rate_hz": 1000}})
    for counter, gap in enumerate([0, 0.001, 0.0011, 0.004, 0.001]):
        rig.clock.t += gap
        rig.encoder(0.0, counter)
        rig.driver.read(rig.clock.t)
    assert rig.count("late") == 1


def test_two_frames_with_one_stamp_are_two_samples(rig: Rig) -> None:
    rig.encoder(1.0, 0)
    first = rig.driver.read(rig.clock.t)[0]
    rig.encoder(1.0, 1)
    assert rig.driver.read(rig.clock.t)[0].t > first.t


def test_wait_ends_at_a_new_sample_or_at_the_deadline(rig: Rig) -> None:
    deadline = rig.clock.t + 0.01
    rig.arrive(0x300, bytes(8))
    rig.encoder(1.0, 0)
    rig.encoder(1.0, 0)
    assert rig.driver.wait(deadline)
    assert not rig.driver.wait(deadline)  # a repeated frame is no new sample
    assert rig.clock.t >= deadline


# What leaves


def test_each_command_has_the_next_counter_and_its_confirmed_time(rig: Rig) -> None:
    for volts in (1.0, 2.0):
        rig.tick(volts)
    assert rig.bus.commands() == [(1.0, 0), (2.0, 1)]
    assert rig.driver.commands_sent == 2
    assert math.isnan(rig.driver.left())  # the echo of the last one was not read yet
    rig.driver.read(rig.clock.t)
    assert rig.driver.left() == rig.clock.t


def test_in_flight_is_bounded_and_the_newest_command_goes_next(rig: Rig) -> None:
    rig.bus.echo = False
    for volts in (1.0, 2.0, 3.0, 4.0, 5.0):
        rig.tick(volts)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0]
    assert rig.count("deferred") == 2
    rig.bus.incoming.append(rig.bus.sent[0])
    rig.driver.wait(rig.clock.t + 0.001)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0, 5.0]


def test_neutral_has_a_reserved_place_and_drops_what_waits(rig: Rig) -> None:
    rig.bus.echo = False
    for volts in (1.0, 2.0, 3.0, 4.0):
        rig.tick(volts)
    assert math.isfinite(rig.tick())
    assert rig.bus.commands()[-1] == (0.0, 3)
    rig.bus.incoming.extend(rig.bus.sent)
    rig.driver.wait(rig.clock.t + 0.001)
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 2.0, 3.0, 0.0]


def test_without_echo_nothing_is_bounded(make: Callable[..., Rig]) -> None:
    rig = make(echo=False)
    rig.bus.echo = False
    for _ in range(200):
        rig.tick(1.0)
    assert len(rig.bus.commands()) == 200
    assert rig.driver.trouble == ""
    assert math.isnan(rig.driver.left())


def test_commands_that_do_not_leave_are_trouble_until_they_do(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(1500):
        rig.tick(1.0)
    assert len(rig.bus.sent) <= 7  # attempts become rarer: all of them will leave one day
    assert "do not leave the bus" in rig.driver.trouble
    assert rig.count("unconfirmed") == 1
    assert {volts for volts, _ in rig.bus.commands()[3:]} == {0.0}  # only neutral tries the bus
    rig.bus.echo = True
    rig.bus.incoming.extend(rig.bus.sent)
    before = len(rig.bus.sent)
    rig.tick(2.0)
    assert rig.driver.trouble == ""
    rig.tick(3.0)
    assert [volts for volts, _ in rig.bus.commands()[before:]] == [0.0, 3.0]


def test_lost_echoes_do_not_hold_the_commands_for_ever(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(4):
        rig.tick(1.0)
    rig.bus.echo = True
    for _ in range(600):
        rig.tick(1.0)
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[-1][0] == 1.0


def test_another_node_that_sends_our_commands_is_counted(rig: Rig) -> None:
    rig.arrive(VALVE, CODEC.encode("Valve", {"voltage": 5.0}, 3))
    rig.driver.read(rig.clock.t)
    assert rig.count("foreign_commands") == 1
    assert math.isnan(rig.driver.left())


def test_a_full_queue_is_counted_and_no_failure(rig: Rig) -> None:
    for error in (
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
    ):
        rig.bus.send_error = error
        assert math.isnan(rig.tick(1.0))
    rig.bus.send_error = None
    assert math.isfinite(rig.tick(2.0))
    assert rig.bus.commands() == [(2.0, 0)]
    assert rig.count("no_buffers") == 2
    assert rig.driver.trouble == ""


def test_close_gives_a_neutral_command_without_room_a_moment(rig: Rig) -> None:
    rig.bus.send_error = can.CanOperationError("full", errno.ENOBUFS)
    rig.tick()
    rig.bus.send_error = None
    bus = rig.bus
    rig.driver.close()
    assert bus.commands() == [(0.0, 0)]
    assert bus.closed


def test_start_tick_and_heartbeat_frames(make: Callable[..., Rig]) -> None:
    rig = make(
        start_frames=[{"id": 0, "data": "01 00"}],
        tick_frames=[{"id": 0x80}],
        heartbeat=[{"id": 0x701, "data": "05", "period_s": 0.01}],
    )
    assert [(m.arbitration_id, bytes(m.data)) for m in rig.bus.sent] == [(0, b"\x01\x00")]
    for _ in range(100):
        rig.tick()
    sent = [message.arbitration_id for message in rig.bus.sent]
    assert sent.count(0x80) == 100
    assert sent.count(0x701) in (10, 11)


def test_values_of_the_neutral_command_are_those_given_at_opening(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch)
    rig.driver.close()
    rig.driver.open([], ["Valve.voltage"], [2.5])
    rig.driver.start()
    rig.tick()
    assert rig.bus.commands() == [(2.5, 0)]
    first = rig.driver.neutral_recipe()["frames"][0][0]
    assert CODEC.decode(VALVE, False, bytes.fromhex(first["data"])).values["voltage"] == 2.5
    rig.driver.close()


# When the bus fails


def test_after_an_interface_was_down_the_first_frame_is_neutral(make: Callable[..., Rig]) -> None:
    rig = make(start_frames=[{"id": 0, "data": "01 00"}], tick_frames=[{"id": 0x80}])
    rig.tick(1.0)
    rig.bus.send_error = down()
    for _ in range(30):
        rig.tick(2.0)
    assert "can0 is down: `ip link set can0 up`" in rig.driver.trouble
    assert rig.count("interface_down") == 1
    assert rig.count("send_errors") <= 6  # it is not tried at each tick
    before = len(rig.bus.sent)
    rig.bus.send_error = None
    for _ in range(30):
        rig.tick(3.0)
    after = rig.bus.sent[before:]
    assert [m.arbitration_id for m in after[:2]] == [VALVE, 0]
    volts = [volts for volts, _ in rig.bus.commands()[1:]]
    assert volts[0] == 0.0
    assert set(volts[1:]) == {3.0}
    assert rig.driver.trouble == ""


def test_an_interface_that_goes_down_is_noticed_by_reading(rig: Rig) -> None:
    rig.bus.incoming.append(can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN))
    rig.driver.read(rig.clock.t)
    assert "is down" in rig.driver.trouble
    rig.tick(1.0)
    assert rig.bus.commands() == [(0.0, 0)]


@pytest.mark.parametrize("code", [errno.ENODEV, errno.ENXIO])
def test_a_deleted_interface_is_taken_again_at_a_bounded_rate(rig: Rig, code: int) -> None:
    rig.tick(1.0)
    rig.bus.send_error = can.CanOperationError("Failed to transmit: no such device", code)
    rig.open_error = OSError(errno.ENODEV, "No such device")
    for _ in range(1000):
        rig.tick(2.0)
    assert "is gone" in rig.driver.trouble
    assert rig.buses[0].closed
    assert rig.attempts <= 4  # one at the start, then two a second
    rig.open_error = None
    for _ in range(600):
        rig.tick(3.0)
    assert len(rig.buses) == 2
    assert rig.count("reopened") == 1
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[0][0] == 0.0
    assert rig.bus.commands()[-1][0] == 3.0


def test_waiting_on_a_bus_that_is_gone_takes_its_time(rig: Rig) -> None:
    rig.bus.incoming.append(can.CanOperationError("gone", errno.ENODEV))
    rig.driver.read(rig.clock.t)
    began = time.monotonic()
    assert not rig.driver.wait(rig.clock.t + 0.02)
    assert time.monotonic() - began >= 0.02


def test_bus_off_holds_everything_until_the_restart(rig: Rig) -> None:
    rig.tick(1.0)
    rig.error_frame(0x40)
    for _ in range(20):
        rig.tick(2.0)
    assert "bus-off" in rig.driver.trouble
    assert len(rig.bus.commands()) == 1
    rig.error_frame(0x100)
    rig.tick(3.0)
    rig.tick(4.0)
    assert rig.driver.trouble == ""
    assert [volts for volts, _ in rig.bus.commands()] == [1.0, 0.0, 4.0]
    assert (rig.count("bus_off"), rig.count("restarted"), rig.count("error_frames")) == (1, 1, 2)


def test_taking_the_interface_down_and_up_ends_bus_off(rig: Rig) -> None:
    rig.error_frame(0x40)
    rig.tick(1.0)
    rig.bus.incoming.append(down())
    for _ in range(20):
        rig.tick(2.0)
    assert rig.driver.trouble == ""
    assert rig.bus.commands()[0][0] == 0.0
    assert rig.bus.commands()[-1][0] == 2.0


def test_what_a_failed_interface_held_is_not_waited_for(rig: Rig) -> None:
    rig.bus.echo = False
    for _ in range(3):
        rig.tick(1.0)
    rig.bus.send_error = down()
    rig.bus.incoming.append(down())
    for _ in range(200):
        rig.tick(2.0)
    rig.bus.send_error = None
    rig.bus.echo = True
    for _ in range(20):
        rig.tick(2.0)
    assert rig.count("unconfirmed") == 0
    assert rig.count("deferred") == 0
    assert rig.bus.commands()[-1][0] == 2.0


def test_bus_off_and_restart_between_two_ticks_still_means_neutral_first(rig: Rig) -> None:
    rig.tick(1.0)
    rig.error_frame(0x40)
    rig.error_frame(0x100)
    rig.tick(2.0)
    assert rig.bus.commands()[-1][0] == 0.0


def test_error_frames_are_counted_by_kind(rig: Rig) -> None:
    rig.error_frame(0x004, 0x08)
    rig.error_frame(0x004, 0x20)
    rig.error_frame(0x020)
    rig.error_frame(0x004, 0x01)
    rig.driver.read(rig.clock.t)
    names = ("error_warning", "error_passive", "ack_errors", "overflows", "error_frames")
    assert [rig.count(name) for name in names] == [1, 1, 1, 1, 4]
    assert rig.driver.trouble == ""


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_any_error_frame_can_be_decoded(classes: int, data: bytes) -> None:
    assert bus_event(classes, data).bus_off == bool(classes & 0x40)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 9), max_size=40))
def test_whatever_the_bus_does_nothing_raises_and_neutral_comes_first(events: list[int]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        rig = Rig(patch)
        for event in events:
            _happen(rig, event)
            sent, troubled = len(rig.bus.commands()), bool(rig.driver.trouble)
            rig.tick(5.0)
            if troubled and len(rig.bus.commands()) > sent:
                assert rig.bus.commands()[sent][0] == 0.0
        rig.driver.close()


def _happen(rig: Rig, event: int) -> None:
    if event < 4:
        code = (None, errno.ENETDOWN, errno.ENODEV, errno.ENOBUFS)[event]
        rig.bus.send_error = can.CanOperationError("fails", code) if code else None
    elif event == 4:
        rig.bus.incoming.append(down())
    elif event in (5, 6):
        rig.error_frame(0x40 if event == 5 else 0x100)
    elif event == 7:
        rig.bus.echo = not rig.bus.echo
    else:
        rig.clock.t += 0.2 * (event - 7)


def test_a_bus_that_cannot_be_had_says_what_to_do() -> None:
    driver = CanDriver(options(interface="socketcan", channel="nocan7"), time.monotonic)
    with pytest.raises(DriverError, match=r"socketcan channel 'nocan7'.*ip link add vcan0"):
        driver.open(["Encoder.angle"], ["Valve.voltage"])
    driver.close()


def test_channels_of_the_wrong_direction_and_fd_messages_are_refused(tmp_path: Path) -> None:
    driver = CanDriver(options(), time.monotonic)
    with pytest.raises(DriverError, match=r"no output channel 'Encoder\.angle'.*Valve\.voltage"):
        driver.open([], ["Encoder.angle"])
    (tmp_path / "fd.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\nBO_ 300 Long: 12 rig\n SG_ a : 0|8@1+ (1,0) [0|0] "" seod\n'
    )
    driver = CanDriver(options(tmp_path, dbc="fd.dbc"), time.monotonic)
    with pytest.raises(DriverError, match=r"Long is an FD message: set driver\.fd: true"):
        driver.open(["Long.a"], [])


# Real python-can, in this process


def test_fd_frames_and_several_messages_over_python_can(tmp_path: Path) -> None:
    (tmp_path / "fd.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\nBO_ 300 Long: 10 rig\n'
        ' SG_ a : 64|16@1+ (1,0) [0|0] "" seod\n\n'
        'BO_ 301 First: 10 seod\n SG_ u : 0|16@1- (1,0) [0|0] "V" rig\n\n'
        'BO_ 2147484188 Second: 2 seod\n SG_ v : 0|16@1- (1,0) [0|0] "V" rig\n'
    )
    channel = f"fd{next(CHANNELS)}"
    peer = can.Bus(interface="virtual", channel=channel, ignore_config=True)
    driver = CanDriver(
        options(tmp_path, dbc="fd.dbc", channel=channel, fd=True, data_bitrate=5_000_000), time.monotonic
    )
    driver.open(["Long.a"], ["First.u", "Second.v"])
    driver.start()
    peer.send(
        can.Message(arbitration_id=300, is_extended_id=False, is_fd=True, data=bytes(8) + b"\x07" + bytes(3))
    )
    assert driver.read(time.monotonic())[0].value == 7
    driver.write(time.monotonic(), [3.0, -3.0])
    first, second = peer.recv(1), peer.recv(1)
    assert first is not None
    assert second is not None
    assert (first.is_fd, first.bitrate_switch, len(first.data), first.data[0]) == (True, True, 12, 3)
    assert (second.is_fd, second.is_extended_id, second.arbitration_id) == (False, True, 540)
    driver.read(time.monotonic())
    assert math.isfinite(driver.left())
    driver.close()
    peer.shutdown()


# The clocks


class Clocks:
    """A monotonic clock and a real-time clock that can be set."""

    def __init__(self) -> None:
        self.t = 50.0
        self.offset = 1e6

    def make(self) -> StampClock:
        return StampClock(lambda: self.t, lambda: self.t + self.offset)

    def stamp(self, at: float) -> float:
        return at + self.offset


def test_stamps_are_placed_on_the_loops_clock() -> None:
    clocks = Clocks()
    stamps = clocks.make()
    clocks.t += 0.5
    assert stamps.to_loop(clocks.stamp(50.3)) == pytest.approx(50.3)
    assert stamps.to_loop(clocks.stamp(50.5)) == pytest.approx(50.5)


@pytest.mark.parametrize("step", [3600.0, 0.5, -0.5, -3600.0])
def test_a_clock_step_changes_nothing(step: float) -> None:
    clocks = Clocks()
    stamps = clocks.make()
    before_step = clocks.stamp(50.0001)
    clocks.t += 0.0005
    clocks.offset += step
    after_step = clocks.stamp(50.0004)
    assert stamps.to_loop(before_step) == pytest.approx(50.0001, abs=1e-6)
    assert stamps.to_loop(after_step) == pytest.approx(50.0004, abs=1e-6)
    stamps.drained()
    clocks.t += 0.0005
    assert stamps.to_loop(clocks.stamp(50.0007)) == pytest.approx(50.0007, abs=1e-6)
    assert stamps.steps == 1


def test_slewing_is_followed_and_is_no_step() -> None:
    clocks = Clocks()
    stamps = clocks.make()
    for _ in range(2000):
        clocks.t += 0.0005
        clocks.offset += 0.0005 * 500e-6
        assert stamps.to_loop(clocks.stamp(clocks.t - 0.0001)) == pytest.approx(clocks.t - 0.0001, abs=1e-6)
        stamps.drained()
    assert stamps.steps == 0


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.floats(1e-4, 0.01), st.floats(-1e4, 1e4), st.floats(-1e5, 1e5)), min_size=1, max_size=20
    )
)
def test_no_stamp_is_in_the_future_or_before_what_was_read(events: list[tuple[float, float, float]]) -> None:
    clocks = Clocks()
    stamps = clocks.make()
    for wait, step, error in events:
        drained_at = stamps._drained_at
        clocks.t += wait
        clocks.offset += step
        t = stamps.to_loop(clocks.stamp(clocks.t) + error)
        assert drained_at - SLACK_S <= t <= clocks.t
        stamps.drained()


def test_stamps_of_other_clocks_count_as_now() -> None:
    clocks = Clocks()
    assert clocks.make().to_loop(0.0) == clocks.t
    assert StampClock(lambda: clocks.t, lambda: 1e6, trusted=False).to_loop(123.0) == clocks.t


# Neutral from another process


class FakeSocket:
    """A raw socket with a queue of limited length."""

    def __init__(self, room: int = 1000, error: int = 0) -> None:
        self.frames: list[bytes] = []
        self.room = room
        self.error = error
        self.closed = False

    def send(self, frame: bytes) -> None:
        if self.error:
            raise OSError(self.error, "fails")
        if len(self.frames) >= self.room:
            raise OSError(errno.ENOBUFS, "full")
        self.frames.append(frame)

    def close(self) -> None:
        self.closed = True


def neutral_writer(monkeypatch: pytest.MonkeyPatch, rig: Rig, *sockets: FakeSocket) -> SocketcanNeutral:
    supply = iter(sockets)
    monkeypatch.setattr("drivers.neutral._raw_socket", lambda channel, fd: next(supply))
    writer = open_neutral(rig.driver.neutral_recipe())
    assert isinstance(writer, SocketcanNeutral)
    return writer


def test_the_neutral_cycle_begins_with_the_counter_that_is_expected(
    monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    raw = FakeSocket()
    writer = neutral_writer(monkeypatch, rig, raw)
    assert writer.write(21) == ""
    frames = [CLASSIC.unpack(frame) for frame in raw.frames]
    decoded = [CODEC.decode(frame_id, False, data[:length]) for frame_id, length, data in frames]
    assert [frame.counter for frame in decoded] == [(21 + n) % 16 for n in range(16)]
    assert all(frame.values["voltage"] == 0.0 and frame.checksum_ok for frame in decoded)


def test_the_neutral_writer_says_what_is_wrong_and_takes_a_new_interface(
    monkeypatch: pytest.MonkeyPatch, rig: Rig
) -> None:
    full, gone, new = FakeSocket(room=5), FakeSocket(error=errno.ENODEV), FakeSocket()
    writer = neutral_writer(monkeypatch, rig, full, gone, new)
    assert writer.write(0) == "can0: only 5 of 16 neutral frames found room in the queue"
    full.error = errno.ENETDOWN
    assert writer.write(0) == "can0: fails"
    full.error = errno.ENXIO
    assert writer.write(0) == "can0 is gone"
    assert full.closed
    assert gone.closed
    assert writer.write(0) == ""
    assert len(new.frames) == 16
    writer.close()
    writer.close()


def test_an_interface_that_is_not_there_is_told_and_leaves_nothing_open(rig: Rig) -> None:
    writer = open_neutral(rig.driver.neutral_recipe())
    assert writer.write(0).startswith("can0: ")
    writer.close()


def test_frames_have_the_kernels_layout() -> None:
    frame = {"id": 0x123, "extended": True, "fd": False, "bit_rate_switch": False, "data": "0102"}
    assert CLASSIC.size == 16
    assert FLEXIBLE.size == 72
    assert (
        pack_frame(frame).hex() == (0x80000123).to_bytes(4, "little").hex() + "02000000" + "0102" + "00" * 6
    )
    flexible = pack_frame({**frame, "fd": True, "bit_rate_switch": True})
    assert len(flexible) == 72
    assert flexible[4:8].hex() == "02050000"


def test_rigs_that_no_other_process_reaches_say_so() -> None:
    writer = open_neutral({"kind": "none", "why": "it is simulated"})
    assert isinstance(writer, NoNeutral)
    assert writer.write(3) == "it is simulated"
    with pytest.raises(ValueError, match="'serial'"):
        open_neutral({"kind": "serial"})
