"""A rig that stops where nobody holds it any more: one daemon for all ways to let go."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, kill, until, write_rig_file
from tests.test_daemon import Daemon, running, set_guard, spoken_to

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    rig_file = write_rig_file(tmp_path_factory.mktemp("held"))
    set_guard(rig_file, dead_man="1 s")
    with running(rig_file) as daemon:
        daemon.rpc.close()
        yield daemon


@pytest.fixture
def daemon(shared: Daemon) -> Iterator[Daemon]:
    """Idle, and with a client of the test's own."""
    with spoken_to(shared) as it:
        yield it


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP, signal.SIGINT])
def test_who_holds_the_rig_and_falls_silent_or_goes_stops_it(
    daemon: Daemon, tmp_path: Path, end: signal.Signals
) -> None:
    holder = Program(tmp_path / "holder", "start", "--hold", "--port", str(daemon.port))
    try:
        until("the relay", lambda: daemon.state() == "exciting")
        began = time.monotonic()
        until("three times the dead man's time", lambda: time.monotonic() > began + 3.0)
        assert daemon.state() == "exciting"
        holder.process.send_signal(end)
        fault = {} if end is signal.SIGINT else daemon.rpc.event(event="fault")
        told = {
            signal.SIGKILL: "the client that held the rig",
            signal.SIGSTOP: "no client called keepalive",
        }
        assert told.get(end, "") in fault.get("why", "")
        assert fault.get("code") in (None, "dead_man")
        if end is signal.SIGINT:
            assert holder.wait() == 0, holder.said()
            assert daemon.state() == "idle"
    finally:
        kill(holder.process.pid, signal.SIGCONT)
        holder.stop()


def test_a_rig_that_nobody_holds_stops_after_its_time(daemon: Daemon) -> None:
    daemon.rpc.call("start")
    assert daemon.rpc.event(event="fault")["code"] == "dead_man"
