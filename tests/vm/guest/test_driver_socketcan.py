"""The CAN driver on the kernel's own bus: what no fake can show."""

from __future__ import annotations

import math
import select
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bus import ip, tc

from drivers.can import CanDriver
from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions
from drivers.neutral import open_neutral, pack_frame
from tests.peers import until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.base import Sample

pytestmark = pytest.mark.vm

CONFIGS = Path(__file__).parents[3] / "configs"
BUS = "drv0"
ENCODER, VALVE = 257, 513
CAN_ERR_FLAG = 0x20000000


def make_options(**changes: object) -> CanOptions:
    section = {"kind": "can", "channel": BUS, "dbc": "motor.dbc", **changes}
    return CanOptions.model_validate(section, context={"directory": CONFIGS})


CODEC = CanCodec(make_options())


def add_bus() -> None:
    ip("link", "add", "dev", BUS, "type", "vcan")
    ip("link", "set", BUS, "mtu", "72", "up")


class Rig:
    """A driver, and the rig's end of the bus in the test's hand."""

    def __init__(self, **changes: object) -> None:
        self.peer = self.connect()
        self.counter = 0
        self.driver = CanDriver(make_options(**changes), time.monotonic)
        self.driver.open(["Encoder.angle"], ["Valve.voltage"])
        self.driver.start()

    def connect(self) -> socket.socket:
        peer = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
        peer.bind((BUS,))
        return peer

    def reconnect(self) -> None:
        self.peer.close()
        self.peer = self.connect()

    def encoder(self, angle: float) -> None:
        data = CODEC.encode("Encoder", {"angle": angle, "run_enable": 1}, self.counter)
        self.counter += 1
        self.send(ENCODER, data)

    def arrived(self) -> None:
        """Until something can be read: the kernel hands frames on when it likes."""
        assert select.select([self.driver._link._bus], [], [], 10.0)[0]

    def hear(self, angle: float) -> Sample:
        """Send a sensor frame, and read until it is there."""
        self.encoder(angle)
        until("the sample", lambda: self.read().value == pytest.approx(angle))
        return self.read()

    def read(self) -> Sample:
        return self.driver.read(time.monotonic())[0]

    def send(self, frame_id: int, data: bytes) -> None:
        frame = {"id": frame_id, "extended": False, "fd": False, "data": data.hex()}
        self.peer.send(pack_frame(frame))

    def tick(self, volts: float | None = None) -> float:
        t = time.monotonic()
        self.driver.read(t)
        return self.driver.neutral(t) if volts is None else self.driver.write(t, [volts])

    def commands(self) -> list[float]:
        """Voltages of the commands that left since the last call."""
        found = []
        while True:
            try:
                frame = self.peer.recv(72)
            except BlockingIOError:
                return found
            except OSError:  # the interface went down: told once
                continue
            if int.from_bytes(frame[:4], "little") == VALVE:
                found.append(CODEC.decode(VALVE, False, frame[8 : 8 + frame[4]]).values["voltage"])

    def count(self, name: str) -> int:
        return self.driver.counters[self.driver.counter_names.index(name)]

    def close(self) -> None:
        self.driver.close()
        self.peer.close()


@pytest.fixture
def rig() -> Iterator[Rig]:
    add_bus()
    rig = Rig()
    yield rig
    rig.close()
    ip("link", "delete", BUS)


def test_samples_have_the_kernels_time(rig: Rig) -> None:
    before = time.monotonic()
    rig.encoder(0.25)
    rig.arrived()
    after = time.monotonic()
    time.sleep(0.05)  # the time of reading must not matter
    sample = rig.read()
    assert sample.value == pytest.approx(0.25)
    assert before - 1e-4 <= sample.t <= after + 1e-4


def test_only_the_frames_that_are_needed_are_woken_for(rig: Rig) -> None:
    rig.send(0x300, bytes(8))
    rig.send(258, bytes(4))
    rig.hear(1.0)
    assert rig.count("frames_received") == 1
    assert rig.count("unknown_frames") == rig.count("wrong_length") == 0


def test_commands_are_confirmed_with_the_time_they_left(rig: Rig) -> None:
    before = time.monotonic()
    rig.tick(1.5)
    until("the echo", lambda: rig.read() and math.isfinite(*rig.driver.left()))
    assert before <= rig.driver.left()[0] <= time.monotonic()
    assert rig.commands() == [1.5]


def test_wait_wakes_for_a_sample(rig: Rig) -> None:
    rig.encoder(1.0)
    assert rig.driver.wait(time.monotonic() + 5.0)
    began = time.monotonic()
    assert not rig.driver.wait(began + 0.05)
    assert time.monotonic() >= began + 0.05


def test_a_clock_step_changes_nothing(rig: Rig) -> None:
    for step in (3600.0, -3600.0):
        rig.hear(1.0)
        before = time.monotonic()
        rig.encoder(2.0)
        rig.arrived()
        after = time.monotonic()
        time.clock_settime(time.CLOCK_REALTIME, time.time() + step)
        sample = rig.read()
        assert sample.value == pytest.approx(2.0)
        assert before - 1e-3 <= sample.t <= after + 1e-3
        before = time.monotonic()
        assert before - 1e-3 <= rig.hear(3.0).t <= time.monotonic()
    assert rig.count("clock_steps") == 2


def test_down_and_up_begins_with_neutral(rig: Rig) -> None:
    rig.tick(1.0)
    ip("link", "set", BUS, "down")
    for _ in range(10):
        rig.tick(2.0)
    assert "is down" in rig.driver.trouble
    assert rig.count("interface_down") == 1
    rig.commands()
    ip("link", "set", BUS, "up")
    until("recovery", lambda: math.isfinite(rig.tick(3.0)) and not rig.driver.trouble)
    rig.tick(4.0)
    rig.hear(1.0)
    left: list[float] = []
    until("the command", lambda: left.extend(rig.commands()) or 4.0 in left)
    assert left[0] == 0.0
    assert 2.0 not in left


def test_a_deleted_interface_that_returns_is_taken_again(rig: Rig) -> None:
    rig.tick(1.0)
    ip("link", "delete", BUS)
    rig.tick(2.0)
    assert rig.driver.trouble
    until("gone", lambda: "is gone" in rig.driver.trouble or rig.tick(2.0) == 0)
    add_bus()
    rig.reconnect()
    until("recovery", lambda: math.isfinite(rig.tick(3.0)) and not rig.driver.trouble)
    rig.tick(4.0)
    rig.hear(1.0)
    left: list[float] = []
    until("the command", lambda: left.extend(rig.commands()) or 4.0 in left)
    assert left[0] == 0.0
    assert rig.count("reopened") == 1


def test_error_frames_hold_the_commands_until_the_restart(rig: Rig) -> None:
    rig.send(CAN_ERR_FLAG | 0x004, bytes([0, 0x08, 0, 0, 0, 0, 0, 0]))
    rig.send(CAN_ERR_FLAG | 0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]))
    rig.send(CAN_ERR_FLAG | 0x020, bytes(8))
    until("error frames", lambda: rig.tick(1.0) and rig.count("error_frames") == 3)
    names = ("error_warning", "error_passive", "ack_errors")
    assert [rig.count(name) for name in names] == [1, 1, 1]
    assert rig.driver.trouble == ""
    rig.send(CAN_ERR_FLAG | 0x040, bytes(8))
    until("bus-off", lambda: rig.read() and "bus-off" in rig.driver.trouble)
    rig.commands()
    for _ in range(5):
        assert math.isnan(rig.tick(2.0))
    assert rig.commands() == []
    rig.send(CAN_ERR_FLAG | 0x100, bytes(8))
    until("restart", lambda: math.isfinite(rig.tick(3.0)))
    rig.tick(4.0)
    seen: list[float] = []
    until("the command", lambda: seen.extend(rig.commands()) or 4.0 in seen)
    assert seen == [0.0, 4.0]


def slow_bus() -> None:
    tc("add", "dev", BUS, "root", "tbf", "rate", "30kbit", "burst", "1kb", "latency", "10s")


def test_a_slow_bus_bounds_what_is_in_flight(rig: Rig) -> None:
    slow_bus()
    for _ in range(300):
        rig.tick(1.0)
    in_flight = rig.driver._outputs._commands[0].in_flight
    assert in_flight <= 3
    assert rig.count("deferred") > 100
    assert rig.count("no_buffers") == 0
    rig.commands()
    assert math.isfinite(rig.tick())  # neutral has its place at once
    seen: list[float] = []
    until("neutral leaves", lambda: seen.extend(rig.commands()) or 0.0 in seen)
    assert seen.index(0.0) <= 3
    tc("del", "dev", BUS, "root")


def test_a_full_queue_is_counted_and_no_trouble(rig: Rig) -> None:
    rig.close()
    unbounded = Rig(echo=False)
    rig.peer, rig.driver = unbounded.peer, unbounded.driver
    slow_bus()
    for _ in range(300):
        rig.tick(1.0)
    assert rig.count("no_buffers") > 100
    assert rig.driver.trouble == ""
    tc("del", "dev", BUS, "root")
    until("room", lambda: math.isfinite(rig.tick(2.0)))


def test_frames_that_do_not_leave_are_trouble(rig: Rig) -> None:
    tc("add", "dev", BUS, "root", "plug")  # holds every frame, like a bus on which nobody acknowledges
    tc("change", "dev", BUS, "root", "plug", "block")
    until("trouble", lambda: math.isnan(rig.tick(1.0)) and "do not leave" in rig.driver.trouble)
    assert rig.commands() == []
    tc("del", "dev", BUS, "root")
    until("recovery", lambda: math.isfinite(rig.tick(2.0)) and not rig.driver.trouble)


def test_neutral_from_another_process(rig: Rig) -> None:
    writer = open_neutral(rig.driver.neutral_recipe())
    assert writer.write(5) == ""
    seen: list[float] = []
    until("the cycle", lambda: seen.extend(rig.commands()) or len(seen) >= 16)
    assert seen == [0.0] * 16
    ip("link", "set", BUS, "down")
    assert "down" in writer.write(5)
    ip("link", "delete", BUS)
    add_bus()
    rig.reconnect()
    assert writer.write(5) == ""
    until("the cycle", lambda: seen.extend(rig.commands()) or len(seen) == 32)
    writer.close()


def test_fd_frames(tmp_path: Path) -> None:
    add_bus()
    (tmp_path / "fd.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: seod rig\nBO_ 301 Long: 12 seod\n'
        ' SG_ u : 64|16@1- (1,0) [0|0] "V" rig\n\n'
        'BO_ 302 Back: 12 rig\n SG_ y : 64|16@1- (1,0) [0|0] "V" seod\n'
    )
    options = make_options(dbc=str(tmp_path / "fd.dbc"), fd=True, data_bitrate=4_000_000)
    driver = CanDriver(options, time.monotonic)
    driver.open(["Back.y"], ["Long.u"])
    driver.start()
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as peer:
        peer.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        peer.bind((BUS,))
        driver.write(time.monotonic(), [-5.0])
        frame = peer.recv(72)
        assert (len(frame), frame[4], frame[5] & 1) == (72, 12, 1)
        peer.send(
            pack_frame(
                {
                    "id": 302,
                    "extended": False,
                    "fd": True,
                    "bit_rate_switch": True,
                    "data": "00" * 8 + "0700" + "0000",
                }
            )
        )
        until("the frame", lambda: driver.read(time.monotonic())[0].value == 7)
        assert math.isfinite(*driver.left())
        writer = open_neutral(driver.neutral_recipe())
        assert writer.write(0) == ""
        assert len(peer.recv(72)) == 72
        writer.close()
    driver.close()
    ip("link", "delete", BUS)
