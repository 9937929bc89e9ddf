"""What the daemon goes on after: parts of it die, hang, are stopped.

One daemon serves, for a start takes 4 s of processor time. Each test begins with it idle, as a new client.
"""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, Rpc, find_process, kill, port_open, until, write_rig_file
from tests.test_daemon import Daemon, alive, running, spoken_to

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    with running(write_rig_file(tmp_path_factory.mktemp("shared"))) as daemon:
        daemon.rpc.close()
        yield daemon


@pytest.fixture
def daemon(shared: Daemon) -> Iterator[Daemon]:
    """Its gateways may end five times in all."""
    with spoken_to(shared) as it:
        yield it


def test_estimates_are_the_rigs_truth(daemon: Daemon) -> None:
    daemon.excite()
    truth = daemon.rpc.call("info")["truth"]["motor"]
    deadline = time.monotonic() + 3.0
    while time.monotonic() < deadline:
        estimate = daemon.estimate()
    assert estimate["omega_n"] == pytest.approx(truth["omega_n"], rel=0.02)
    assert estimate["zeta"] == pytest.approx(truth["zeta"], rel=0.02)
    daemon.rpc.call("stop")
    until("idle", lambda: daemon.state() == "idle")


def test_what_estimates_is_never_real_time_and_the_gateway_is_behind_the_loop(daemon: Daemon) -> None:
    realtime = daemon.rpc.call("info")["realtime"]
    gateway = daemon.child("seod.gateway")
    processes = {
        "supervisor": daemon.program.pid,
        "loop": daemon.child("seod.loop"),
        "gateway": gateway,
        "observer": find_process("seod.observe", gateway),
    }
    policies = {name: os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK for name, pid in processes.items()}
    priorities = {name: os.sched_getparam(pid).sched_priority for name, pid in processes.items()}
    assert policies["observer"] == os.SCHED_OTHER
    if realtime["ok"]:
        assert policies["loop"] == policies["supervisor"] == os.SCHED_FIFO
        assert priorities["gateway"] < priorities["loop"] < priorities["supervisor"]
    else:
        assert any("refused" in why for why in realtime["why"])


def test_second_daemon_on_the_rig_is_refused_by_name(daemon: Daemon, tmp_path: Path) -> None:
    second = Program(tmp_path / "second", "run", daemon.rig_file)
    assert second.wait() == 1
    assert f"run already by process {daemon.program.pid}" in second.said()
    assert daemon.state() == "idle"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_dead_or_hung_loop_is_a_fault_that_a_reset_ends(daemon: Daemon, number: signal.Signals) -> None:
    daemon.excite()
    loop = daemon.child("seod.loop")
    os.kill(loop, number)
    fault = daemon.rpc.event(event="fault")
    assert "loop process" in fault["why"]
    assert {signal.SIGKILL: "SIGKILL", signal.SIGSTOP: "hung", signal.SIGTERM: "exit"}[number] in fault["why"]
    assert daemon.state() == "fault"
    until("its end, fenced or not", lambda: not alive(loop))
    kill(loop, signal.SIGCONT)
    daemon.rpc.call("reset")
    until("the next loop", lambda: daemon.state() == "idle")
    assert daemon.child("seod.loop") != loop
    daemon.excite()
    assert daemon.estimate()["omega_n"] == pytest.approx(117.0, rel=0.05)


def test_supervisor_that_stands_still_is_a_fault_and_may_go_on(daemon: Daemon) -> None:
    daemon.excite()
    loop, pid = daemon.child("seod.loop"), daemon.program.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        fault = daemon.rpc.event(event="fault")
        assert fault["code"] == "supervisor"
        assert daemon.state() == "fault"
        daemon.rpc.call("reset")
        assert daemon.rpc.event(event="fault")["code"] == "supervisor", "while it still stands still"
    finally:
        os.kill(pid, signal.SIGCONT)
    until("idle", lambda: daemon.rpc.call("reset") and daemon.state() == "idle")
    daemon.excite()
    assert daemon.estimate()["omega_n"] == pytest.approx(117.0, rel=0.05)
    assert daemon.child("seod.loop") == loop, "the loop that went on is the one that writes"
    assert not [m for m in daemon.rpc.heard if m["params"].get("code") == "loop_died"]


def test_dead_gateway_stops_the_rig_and_comes_back(daemon: Daemon) -> None:
    daemon.excite()
    gateway = daemon.child("seod.gateway")
    os.kill(gateway, signal.SIGKILL)
    until("another gateway", lambda: find_process("seod.gateway", daemon.program.pid) not in (0, gateway))
    until("its port", lambda: port_open(daemon.port))
    daemon.rpc.close()
    daemon.rpc = Rpc(daemon.port)
    until("the fault", lambda: daemon.state() == "fault")
    assert "gateway" in daemon.rpc.call("get", axis="motor")["fault"]["why"]
    daemon.rpc.call("reset")
    daemon.excite()


def test_a_gateway_that_starts_after_the_loop_died_knows_of_it(daemon: Daemon) -> None:
    """Else a reset waits for a loop that is not there, for good."""
    daemon.excite()
    gateway = daemon.child("seod.gateway")
    os.kill(daemon.child("seod.loop"), signal.SIGKILL)
    until("the fault", lambda: daemon.state() == "fault")
    os.kill(gateway, signal.SIGKILL)
    until("another gateway", lambda: find_process("seod.gateway", daemon.program.pid) not in (0, gateway))
    until("its port", lambda: port_open(daemon.port))
    daemon.rpc.close()
    daemon.rpc = Rpc(daemon.port)
    until("the fault", lambda: daemon.state() == "fault")
    daemon.rpc.call("reset")
    daemon.excite()


def test_a_dead_process_that_estimates_is_the_gateways_end(daemon: Daemon) -> None:
    daemon.excite()
    gateway = daemon.child("seod.gateway")
    kill(find_process("seod.observe", gateway), signal.SIGKILL)
    until("another gateway", lambda: find_process("seod.gateway", daemon.program.pid) not in (0, gateway))
    until("its port", lambda: port_open(daemon.port))
    daemon.rpc.close()
    daemon.rpc = Rpc(daemon.port)
    until("the fault", lambda: daemon.state() == "fault")
    assert "the process that estimates has ended" in daemon.program.said()
