"""What the daemon on a serial line, and the rig at its other end, go on after: one pair of processes serves.

Each test begins with the axis idle, and as a new client of both.
"""

from __future__ import annotations

import signal
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, Rpc, RpcError, find_process, kill, recover, until
from tests.test_serial import Daemon, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_rig_file(tmp_path_factory.mktemp("serial"))


@pytest.fixture(scope="module")
def back_door(rig_file: Path) -> Iterator[int]:
    """The port of `seod rig`."""
    program = Program(rig_file.with_suffix(".rig.log"), "rig", rig_file)
    yield program.ready()["control_port"]
    program.stop()
    print(program.said())


@pytest.fixture
def rig(back_door: int) -> Iterator[Rpc]:
    rpc = Rpc(back_door)
    yield rpc
    rpc.close()


@pytest.fixture(scope="module")
def shared(back_door: int, rig_file: Path) -> Iterator[Daemon]:
    del back_door
    daemon = Daemon(rig_file)
    daemon.rpc.close()
    yield daemon
    daemon.close()


@pytest.fixture
def daemon(rig: Rpc, shared: Daemon) -> Iterator[Daemon]:
    rig.call("clear")
    shared.connect()
    try:
        yield shared
        recover(shared.rpc)
    finally:
        shared.rpc.close()


def test_zeta_over_a_serial_line_and_through_its_faults(rig: Rpc, daemon: Daemon) -> None:
    truth = rig.call("truth")["motor"]
    daemon.rpc.call("start")
    last = daemon.estimates(10)[-1]
    assert last["omega_n"] == pytest.approx(truth["omega_n"], rel=0.03)
    assert last["zeta"] == pytest.approx(truth["zeta"], rel=0.1)
    for name, fault in (
        ("crc_errors", {"kind": "corrupt", "probability": 0.05}),
        ("lost", {"kind": "drop", "probability": 0.05}),
        ("bad_frames", {"kind": "garbage", "rate_hz": 200.0}),
    ):
        before = daemon.counter(name)
        rig.call("fault", **fault)
        until(name, lambda name=name, before=before: daemon.counter(name) > before)
        rig.call("clear")
    daemon.estimates(3)


def test_a_second_daemon_on_the_port_is_refused_whatever_its_rig_and_the_port_are_called(
    daemon: Daemon, rig_file: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    line = rig_file.with_name("board")
    (tmp_path / "same").symlink_to(line)
    text = rig_file.read_text().replace("rig: on-", "rig: other-").replace(f"{line}", f"{tmp_path}/same")
    assert f"{tmp_path}/same" in text
    other.write_text(text)
    second = Program(tmp_path / "second.log", "run", other)
    assert second.wait() == 1
    assert f"is commanded already by process {daemon.program.pid}" in second.said()
    assert daemon.rpc.call("get", axis="motor")["state"] == "idle"


def test_an_unplugged_board_is_a_fault_and_can_be_started_again(rig: Rpc, daemon: Daemon) -> None:
    daemon.rpc.call("start")
    daemon.estimates(2)
    reopened, handshakes = daemon.counter("reopened"), daemon.counter("handshakes")
    rig.call("unplug", seconds=1.0)
    fault = daemon.rpc.event(event="fault")
    assert "is gone" in fault["why"]
    until(
        "the board again",
        lambda: (daemon.counter("reopened"), daemon.counter("handshakes")) == (reopened + 1, handshakes + 1),
    )

    daemon.rpc.call("reset")

    def start() -> bool:
        with suppress(RpcError):  # not before neutral has passed
            daemon.rpc.call("start")
            return True
        return False

    until("the start", start)
    daemon.estimates(2)


def test_when_the_loop_is_killed_the_supervisor_writes_neutral(rig: Rpc, daemon: Daemon) -> None:
    daemon.rpc.call("start")
    daemon.estimates(1)
    assert rig.call("history", plant="motor")[-1][1] != 0.0
    before = rig.call("state")["plants"]["motor"]["watchdog_trips"]
    kill(find_process("seod.loop", daemon.program.pid), signal.SIGKILL)
    until("neutral", lambda: rig.call("history", plant="motor")[-1][1] == 0.0)
    trips = rig.call("state")["plants"]["motor"]["watchdog_trips"]
    assert trips == before  # half a second had not passed: it was the supervisor
