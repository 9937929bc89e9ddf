"""The daemon on the virtual rig as real processes: any of the three may die, hang or be stopped.

What it goes on after, with the rig file as it is, stands in `test_daemon_goes_on`, so that one daemon serves.
"""

from __future__ import annotations

import os
import signal
import socket
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.peers import Program, Rpc, find_process, port_of, port_open, recover, until, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.processes


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    return write_rig_file(tmp_path)


class Daemon:
    def __init__(self, rig_file: Path, *arguments: str) -> None:
        self.program = Program(rig_file.with_name("log"), "run", rig_file, *arguments)
        self.rig_file, self.port = rig_file, port_of(rig_file)
        until("the port", lambda: port_open(self.port) or self.program.process.poll() is not None)
        assert self.program.process.poll() is None, self.program.said()
        self.connect()

    def connect(self) -> None:
        """Be a new client, once its loop is heard."""
        self.rpc = Rpc(self.port)
        until("the loop", self.loop_is_heard)
        self.rpc.call("subscribe", topics=["event", "estimate"])

    def loop_is_heard(self) -> bool:
        """Ticks are counted in shared memory; what the loop says of itself comes with the next poll."""
        status = self.rpc.call("status")
        heard: bool = status["realtime"]["why"] != ["the loop has not started yet"]
        return heard and bool(status["health"]["ticks"])

    def child(self, module: str) -> int:
        return until(module, lambda: find_process(module, self.program.pid))

    def state(self) -> str:
        state: str = self.rpc.call("get", axis="motor")["state"]
        return state

    def excite(self) -> None:
        self.rpc.call("start")
        until("the relay", lambda: self.state() in ("exciting", "fault"))
        assert self.state() == "exciting", self.rpc.call("get", axis="motor")["fault"]

    def estimate(self) -> dict[str, Any]:
        params: dict[str, Any] = self.rpc.wait_for(
            "a good estimate", lambda m: m["method"] == "estimate" and m["params"]["quality"] == "ok"
        )["params"]
        return params


@contextmanager
def running(rig_file: Path, *arguments: str) -> Iterator[Daemon]:
    daemon = Daemon(rig_file, *arguments)
    try:
        yield daemon
    finally:
        daemon.rpc.close()
        daemon.program.stop()
        print(daemon.program.said())


@contextmanager
def spoken_to(daemon: Daemon) -> Iterator[Daemon]:
    """A daemon that others have as well, with a client of one's own; idle again at the end."""
    daemon.connect()
    try:
        yield daemon
        recover(daemon.rpc)
    finally:
        daemon.rpc.close()


def alive(pid: int) -> bool:
    """Whether a process runs; one that only waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def no_children_left(pid: int) -> bool:
    return not any(find_process(module, pid) for module in ("seod.loop", "seod.gateway"))


def test_sigterm_ends_all_of_it(rig_file: Path) -> None:
    with running(rig_file) as daemon:
        daemon.excite()
        pid, loop, gateway = (
            daemon.program.pid,
            daemon.child("seod.loop"),
            daemon.child("seod.gateway"),
        )
        daemon.program.process.terminate()
        assert daemon.program.wait() == 0
        assert not any(map(alive, (pid, loop, gateway)))


def test_time_given_is_time_run(rig_file: Path) -> None:
    program = Program(rig_file.with_name("log"), "run", rig_file, "--for", "0.5")
    assert program.wait() == 0, program.said()


def set_guard(rig_file: Path, **values: str) -> None:
    lines = "".join(f"  {key}: {value}\n" for key, value in values.items())
    text = rig_file.read_text()
    assert "\nguard:\n" in text
    rig_file.write_text(text.replace("\nguard:\n", f"\nguard:\n{lines}"))


@pytest.mark.parametrize("policy", ["stop", "hold"])
def test_hung_gateway_is_killed_and_the_rig_file_says_what_the_rig_does(rig_file: Path, policy: str) -> None:
    set_guard(rig_file, gateway_lost=policy, gateway_timeout="500 ms")
    with running(rig_file) as daemon:
        daemon.excite()
        gateway = daemon.child("seod.gateway")
        observer = find_process("seod.observe", gateway)
        os.kill(gateway, signal.SIGSTOP)
        until("another gateway", lambda: find_process("seod.gateway", daemon.program.pid) not in (0, gateway))
        until("its port", lambda: port_open(daemon.port))
        until("the end of its observer", lambda: not alive(observer))
        daemon.rpc.close()
        daemon.rpc = Rpc(daemon.port)
        until("its end", lambda: daemon.state() == {"stop": "fault", "hold": "idle"}[policy])
        fault = daemon.rpc.call("get", axis="motor")["fault"]
        if policy == "stop":
            assert "gateway process died or hung" in fault["why"]
            daemon.rpc.call("reset")
        daemon.excite()
        assert "hung: no turn for 500 ms" in daemon.program.said()


def test_dead_supervisor_takes_the_others_along(rig_file: Path) -> None:
    with running(rig_file) as daemon:
        daemon.excite()
        children = [daemon.child("seod.loop"), daemon.child("seod.gateway")]
        daemon.program.process.kill()
        daemon.program.process.wait()
        until("their end", lambda: not any(map(alive, children)))


def test_taken_port_is_said_and_nothing_is_left(rig_file: Path) -> None:
    port = port_of(rig_file)
    with socket.create_server(("127.0.0.1", port)):
        program = Program(rig_file.with_name("log"), "run", rig_file)
        assert program.wait() == 1
    assert str(port) in program.said()
    assert "Traceback" not in program.said()
    assert no_children_left(program.pid)


def test_as_fast_as_it_can_nothing_is_lost(rig_file: Path, tmp_path: Path) -> None:
    rig_file.write_text(rig_file.read_text().replace("realtime: true", "realtime: false"))
    record = tmp_path / "fast.csv"
    with running(rig_file, "--record", str(record)) as daemon:
        daemon.excite()
        for _ in range(100):
            estimate = daemon.estimate()
        assert estimate["zeta"] == pytest.approx(0.21, rel=0.05)
        assert daemon.rpc.call("status")["health"]["rows_lost"] == 0
    lines = record.read_text().splitlines()
    column = lines[0].split(",").index("t")
    times = [float(line.split(",")[column]) for line in lines[1:]]
    steps = {round(b - a, 9) for a, b in pairwise(times)}
    assert steps == {5e-4}


@pytest.mark.parametrize(("rate", "pace"), [(100, "timer"), (2000, "sensor"), (10_000, "timer")])
def test_rates_and_paces(rig_file: Path, rate: int, pace: str) -> None:
    text = (
        rig_file.read_text()
        .replace("rate_hz: 2000 ", f"rate_hz: {rate} ")
        .replace("pace: timer", f"pace: {pace}")
    )
    text = text.replace("count: 150, window: 100 ms", "count: 9, window: 100 ms")
    if rate == 100:  # ten samples a cycle are too few for the relay: a slower plant
        text = text.replace("omega_n: 117", "omega_n: 11.7").replace("e_a: 0.5", "e_a: 0.1")
    rig_file.write_text(text)
    with running(rig_file) as daemon:
        before = daemon.rpc.call("status")["health"]
        until("a second", lambda: daemon.rpc.call("status")["health"]["t"] > before["t"] + 1.0)
        after = daemon.rpc.call("status")["health"]
        ticks = (after["ticks"] - before["ticks"]) / (after["t"] - before["t"])
        assert ticks == pytest.approx(rate, rel=0.25)  # a busy machine skips ticks
