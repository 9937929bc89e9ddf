"""A simulated rig and a daemon on vcan0, shared by the tests of a file; each begins with both in order."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from bus import CAN_ERR_FLAG, CAN_ERR_RESTARTED, CONFIG, Listener, ip, send_raw

from tests.peers import Program, Rpc, RpcError, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PORT = 7600


class Bench:
    """Both ends of the bus with their back doors."""

    def __init__(self, rig: Rpc, program: Program) -> None:
        self.rig = rig
        self.program = program
        self.connect()

    def connect(self) -> None:
        """Be a client of the daemon, as soon as its loop ticks."""
        until("the daemon's port", lambda: port_open(PORT) or self.program.process.poll() is not None)
        self.daemon = Rpc(PORT)
        until("the loop", lambda: self.daemon.call("status")["health"]["ticks"])
        self.daemon.call("subscribe", topics=["event"])

    def rig_state(self) -> dict[str, float]:
        """What the simulated actuator does."""
        state: dict[str, float] = self.rig.call("state")["plants"]["motor"]
        return state

    def rig_is_neutral(self) -> bool:
        """The amplifier puts out 0 V."""
        return self.rig_state()["voltage"] == 0.0

    def state(self) -> str:
        """The axis' state as the daemon tells it."""
        state: str = self.daemon.call("get", axis="motor")["state"]
        return state

    def health(self) -> dict[str, float]:
        """The newest health message."""
        health: dict[str, float] = self.daemon.call("status")["health"]
        return health

    def counters(self) -> dict[str, int]:
        """The driver's health counters."""
        counters: dict[str, int] = self.daemon.call("status")["health"]["counters"]
        return counters

    def wait_state(self, state: str) -> None:
        """Until the axis is in this state."""
        until(f"state {state}", lambda: self.state() == state)

    def excite(self) -> None:
        """Start, and wait for the relay."""
        self.daemon.call("start")
        until("the relay", lambda: self.state() in ("exciting", "fault"))
        axis = self.daemon.call("get", axis="motor")
        assert axis["state"] == "exciting", axis["fault"]

    def recover(self) -> None:
        """Reset a fault, or stop and wait until the axis is back."""
        until("reset or stop", self._recovers)
        self.wait_state("idle")

    def _recovers(self) -> bool:
        """A reset is refused while the fault's cause is still there."""
        try:
            self.daemon.call("reset" if self.state() == "fault" else "stop")
        except RpcError as why:
            print(why)
            return False
        return True

    def center(self) -> None:
        """Put the load back to where it stood at first: without commands it moves until the watchdog."""
        self.rig.call("set", plant="motor", position=0.0)
        self.daemon.wait_for_centre("motor")


@contextmanager
def run_daemon(rig: Rpc, config: Path, log_directory: Path, *arguments: str) -> Iterator[Bench]:
    """`seod run`, once its loop ticks; its output is shown with failures."""
    program = Program(log_directory / "log", "run", config, *arguments)
    try:
        bench = Bench(rig, program)
        yield bench
        bench.daemon.close()
    finally:
        program.stop()
        print(program.said())


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rpc]:
    program = Program(tmp_path_factory.mktemp("rig") / "log", "rig", CONFIG)
    try:
        until(
            "the rig's ready line", lambda: program.said().count("\n") or program.process.poll() is not None
        )
        rpc = Rpc(json.loads(program.said().splitlines()[0])["control_port"])
        yield rpc
        rpc.close()
    finally:
        program.stop()


@pytest.fixture(scope="module")
def shared_bench(rig: Rpc, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with run_daemon(rig, CONFIG, tmp_path_factory.mktemp("daemon")) as bench:
        yield bench


@pytest.fixture
def bench(shared_bench: Bench) -> Iterator[Bench]:
    """The file's daemon, idle; brought back to that at the end."""
    yield shared_bench
    shared_bench.rig.call("clear")
    shared_bench.rig.call("constant", channel="Encoder.run_enable", value=1.0)
    ip("link", "set", "vcan0", "up")
    send_raw(CAN_ERR_FLAG | CAN_ERR_RESTARTED, bytes(8))
    until("the rig is heard again", lambda: shared_bench.health()["sample_age_s"] < 0.1)
    shared_bench.recover()
    shared_bench.center()
    shared_bench.daemon.heard.clear()


@pytest.fixture
def own_bench(rig: Rpc, tmp_path: Path) -> Iterator[Bench]:
    """A daemon that the test may end."""
    with run_daemon(rig, CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
def listener() -> Iterator[Listener]:
    it = Listener()
    yield it
    it.close()
