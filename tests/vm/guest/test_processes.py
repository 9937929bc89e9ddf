"""Processes that die or hang under a daemon that goes on."""

from __future__ import annotations

import signal
import subprocess
import time
from typing import TYPE_CHECKING

from bus import CONFIG

from tests.peers import SEOD, find_process, kill, until

if TYPE_CHECKING:
    from bus import Listener
    from conftest import Bench

LOOP = "seod.loop"


def test_sigkill_of_the_loop(bench: Bench, listener: Listener) -> None:
    bench.excite()
    commands = bench.rig_state()["commands"]
    kill(find_process(LOOP, bench.program.pid), signal.SIGKILL)
    fault = bench.daemon.event(event="fault")
    assert fault["code"] == "loop_died"
    assert "SIGKILL" in fault["why"]
    assert bench.state() == "fault"
    until("neutral", bench.rig_is_neutral)
    # written by the supervisor, and understood: the amplifier's own watchdog would have ended the commands
    until("commands by the supervisor", lambda: bench.rig_state()["commands"] > commands + 10)
    assert not bench.rig_state()["watchdog_tripped"]
    assert {f.volts for f in listener.read() if f.t > fault["t"]} == {0.0}
    bench.daemon.call("reset")
    bench.wait_state("idle")
    bench.excite()


def test_a_loop_that_wakes_up_finds_itself_fenced(bench: Bench, listener: Listener) -> None:
    bench.excite()
    loop = find_process(LOOP, bench.program.pid)
    kill(loop, signal.SIGSTOP)
    stopped = time.monotonic()
    fault = bench.daemon.event(event="fault")
    kill(loop, signal.SIGCONT)
    until("neutral", bench.rig_is_neutral)
    assert "hung" in fault["why"]
    until("the end of the loop", lambda: find_process(LOOP, bench.program.pid) == 0)
    until("commands by the supervisor", lambda: len([f for f in listener.read() if f.t > stopped]) > 20)
    assert {f.volts for f in listener.frames if f.t > stopped} == {0.0}
    bench.recover()


def test_one_daemon_for_a_rig(bench: Bench) -> None:
    second = subprocess.run([SEOD, "run", CONFIG], capture_output=True, text=True, check=False)
    assert second.returncode != 0
    assert f"is run already by process {bench.program.pid}" in second.stderr
