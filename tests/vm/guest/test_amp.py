"""An amplifier with enable, mode and key signals, validity bits and two e-stop lines, on the kernel's bus.

Rig and daemon are processes of their own. What is on the bus is read bit by bit, without the DBC.
"""

from __future__ import annotations

import select
import signal
import socket
import struct
import time
from typing import TYPE_CHECKING, NamedTuple

import pytest

from tests.peers import Program, Rpc, RpcError, find_process, kill, port_open, until
from tests.unit.amp_rig import RIG, folder

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PORT = 7600
START_S = 120.0
"""A daemon starts in some 15 s; on a host with ten processes for each processor it has taken over 45 s."""
COMMAND_ID = 0x18FF6201
"""Of AmpCmd, 29 bits."""

EDITS = (
    ("kind: can\n", "kind: can\n  confirm_timeout_s: 0.6\n"),
    ("rate_hz: 500}", "rate_hz: 100}"),
    ("  rate_hz: 500\n", "  rate_hz: 100\n  hang_timeout: 600 ms\n"),
    ("amplitude: 50 mm", "amplitude: 50 mm\n      growth: 10"),
    ("movement: 1 mm", "movement: 1 mm, duration: 400 ms"),  # a guest may stand still meanwhile
    ("stale: 20 ms", "stale: 600 ms\n  frozen: 1200 ms\n  overruns: {count: 45, window: 600 ms}"),
    ("rig_watchdog: 50 ms", "rig_watchdog: 250 ms"),
)
SIMULATION = """
simulation:
  plants:
    ram:
      input: AmpCmd.Current
      output: AmpStat.Position
      K_L: 0.025
      omega_n: 20
      zeta: 0.3
      noise: 1.0e-5
      enabled_by: {AmpCmd.Enable: 1, AmpCmd.Mode: 2, AmpCmd.Key: 90}
  constants:
    AmpStat.PosValid: 1
    AmpStat.Chain: 1
    AmpStat.Panel: 0
  watchdog_s: 0.25
  sensor_rate_hz: 100
  control_port: 0
"""


ENABLE = "    enable: {channel: AmpCmd.Enable, on: 1, off: 0, drop_on_fault: true}\n"


class Command(NamedTuple):
    """What a command frame holds."""

    current: float
    enable: int
    mode: int
    reserve: int
    key: int


class Listener:
    """A third party on the bus."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        only = struct.pack("=II", COMMAND_ID | socket.CAN_EFF_FLAG, socket.CAN_EFF_MASK | socket.CAN_EFF_FLAG)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only)
        self.socket.bind(("vcan0",))

    def read(self) -> list[Command]:
        """All frames since the last call."""
        found = []
        while select.select([self.socket], [], [], 0)[0]:
            data = self.socket.recv(72)[8:16]
            (current,) = struct.unpack_from(">h", data, 0)
            bits = data[2]
            found.append(Command(current * 0.01, bits & 3, bits >> 2 & 7, bits >> 5, data[3]))
        return found


@pytest.fixture
def listener() -> Iterator[Listener]:
    it = Listener()
    yield it
    it.socket.close()


def write_rig_file(directory: Path, *edits: tuple[str, str]) -> Path:
    text = RIG
    for old, new in (*EDITS, *edits):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder(directory) / "amp.yaml"
    path.write_text(text + SIMULATION)
    return path


class Bench:
    """Both ends of the bus."""

    def __init__(self, rig: Rpc, daemon: Program) -> None:
        self.rig, self.program = rig, daemon
        started = lambda: port_open(PORT) or daemon.process.poll() is not None  # noqa: E731
        until("the daemon's port", started, START_S)
        assert daemon.process.poll() is None, daemon.said()
        self.daemon = Rpc(PORT)
        until("the sensors", lambda: self.daemon.call("status")["health"]["ticks"] > 20)

    def state(self) -> str:
        state: str = self.daemon.call("get")["state"]
        return state

    def fault(self) -> str:
        until("the fault", lambda: self.state() == "fault")
        return str(self.daemon.call("get")["fault"]["why"])

    def excite(self) -> None:
        self.daemon.call("start")
        until("the relay", lambda: self.state() in ("exciting", "fault"))
        assert self.state() == "exciting", self.fault()

    def constant(self, channel: str, value: float) -> None:
        self.rig.call("constant", channel=f"AmpStat.{channel}", value=value)

    def centre(self) -> None:
        """The load in the middle, at rest."""
        until("rest", self._rests)
        self.rig.call("set", plant="ram", position=0.0)
        self.daemon.wait_for_centre("ram", 1e-4)  # the jump must not fall into the polarity check

    def _rests(self) -> bool:
        """It does not only turn: a ring of 20 rad/s stands still twice in each of its periods of 0.3 s."""
        for _ in range(6):
            if abs(self.rig.call("state")["plants"]["ram"]["velocity"]) > 1e-3:
                return False
            time.sleep(0.08)
        return True

    def recover(self) -> None:
        """Reset, and the load where it was at first."""
        until("reset", lambda: self.daemon.call("reset") is not None and self.state() == "idle")
        self.centre()


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rpc]:
    """One for all daemons: to start a process takes long in the guest."""
    directory = tmp_path_factory.mktemp("rig")
    program = Program(directory / "log", "rig", write_rig_file(directory))
    try:
        door = Rpc(program.ready()["control_port"])
        yield door
        door.close()
    finally:
        program.stop()
        print(program.said())


@pytest.fixture
def bench(request: pytest.FixtureRequest, rig: Rpc, tmp_path: Path) -> Iterator[Bench]:
    path = write_rig_file(tmp_path, *getattr(request, "param", ()))
    daemon = Program(tmp_path / "daemon", "run", path)
    try:
        it = Bench(rig, daemon)
        it.centre()
        yield it
        it.daemon.close()
    finally:
        daemon.stop()
        print(daemon.said())


def test_enable_validity_and_e_stops_of_the_amplifier(bench: Bench, listener: Listener) -> None:
    until("commands", lambda: {frame[1:] for frame in listener.read()} == {(0, 2, 0, 90)})
    bench.excite()
    assert {frame[1:] for frame in listener.read() if frame.current} == {(1, 2, 0, 90)}
    assert bench.rig.call("state")["plants"]["ram"]["enabled"] is True
    bench.constant("PosValid", 0)
    assert "AmpStat.PosValid reads 0: readings are valid at 1" in bench.fault()
    bench.daemon.call("reset")
    with pytest.raises(RpcError, match=r"AmpStat\.PosValid reads 0"):
        bench.daemon.call("start")
    bench.constant("PosValid", 1)
    for channel, stopping, running in (("Panel", 1, 0), ("Chain", 0, 1)):
        bench.recover()
        bench.excite()
        bench.constant(channel, stopping)
        told = f"AmpStat.{channel} reads {stopping}, movement is allowed at {running}"
        assert bench.fault() == f"e-stop: {told}"
        bench.constant(channel, running)
    bench.recover()
    bench.excite()
    kill(find_process("seod.loop", bench.program.pid), signal.SIGKILL)
    assert "SIGKILL" in bench.fault()
    until("neutral", lambda: bench.rig.call("state")["plants"]["ram"]["enabled"] is False)
    listener.read()
    until("commands by the supervisor", lambda: set(listener.read()) == {Command(0.0, 0, 2, 0, 90)})


@pytest.mark.parametrize("bench", [[("drop_on_fault: true", "drop_on_fault: false")]], indirect=True)
def test_an_amplifier_that_must_stay_enabled_does_so_in_neutral_too(bench: Bench, listener: Listener) -> None:
    bench.excite()
    bench.daemon.call("estop")
    bench.fault()
    listener.read()
    until("neutral", lambda: set(listener.read()) == {Command(0.0, 1, 2, 0, 90)})
    kill(find_process("seod.loop", bench.program.pid), signal.SIGKILL)
    until("the end of the loop", lambda: find_process("seod.loop", bench.program.pid) == 0)
    time.sleep(0.2)
    listener.read()
    until("commands by the supervisor", lambda: set(listener.read()) == {Command(0.0, 1, 2, 0, 90)})


@pytest.mark.parametrize(
    "bench",
    [[("    enable: {channel: AmpCmd.Enable, on: 1, off: 0, drop_on_fault: true}\n", "")]],
    indirect=True,
)
def test_without_the_enable_signal_nothing_moves_and_the_fault_names_it(bench: Bench) -> None:
    bench.daemon.call("start")
    why = bench.fault()
    assert "no movement" in why
    assert "outputs.valve.enable" in why
