"""How a daemon ends, and what it refuses: always at neutral."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest
from bus import CONFIG, command
from conftest import run_daemon

from tests.peers import REPO, find_process, kill, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bus import Listener
    from conftest import Bench

    from tests.peers import Rpc

LOOP, GATEWAY = "seod.loop", "seod.gateway"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_told_end_is_neutral_and_clean(
    own_bench: Bench, listener: Listener, number: signal.Signals
) -> None:
    bench = own_bench
    bench.excite()
    os.kill(bench.program.pid, number)
    assert bench.program.wait() == 0
    assert listener.read()[-1].volts == 0.0
    assert bench.rig_is_neutral()
    assert not find_process(LOOP)
    assert not find_process(GATEWAY)


def test_sigkill_of_the_supervisor(own_bench: Bench, listener: Listener) -> None:
    bench = own_bench
    bench.excite()
    kill(bench.program.pid, signal.SIGKILL)
    until("the end of the others", lambda: not find_process(LOOP) and not find_process(GATEWAY))
    assert [frame.volts for frame in listener.read()][-5:] == [0.0] * 5  # one of them can be lost
    assert bench.rig_is_neutral()


def test_sigkill_of_the_gateway_stops_the_rig(own_bench: Bench) -> None:
    bench = own_bench
    bench.excite()
    kill(find_process(GATEWAY, bench.program.pid), signal.SIGKILL)
    until("neutral", bench.rig_is_neutral)
    until("a new gateway", lambda: find_process(GATEWAY, bench.program.pid))
    bench.daemon.close()
    bench.connect()
    assert bench.state() == "fault"


def test_a_wrong_sign_is_found_before_the_loop_is_closed(
    rig: Rpc, tmp_path: Path, listener: Listener
) -> None:
    text = CONFIG.read_text().replace("../../..", str(REPO))
    config = tmp_path / "wrong.yaml"
    config.write_text(
        text.replace("    channel: Valve.voltage\n", "    channel: Valve.voltage\n    scale: -1\n")
    )
    with run_daemon(rig, config, tmp_path) as bench:
        bench.daemon.call("start")
        polarity = bench.daemon.event(event="polarity")
        assert polarity["ok"] is False
        assert bench.daemon.event(event="fault")["code"] == "polarity"
        until("neutral", bench.rig_is_neutral)
        signs = {frame.volts > 0 for frame in listener.read() if frame.volts}
        assert len(signs) == 1, "one pulse, one direction: the relay never switched"


@pytest.fixture
def warned(rig: Rpc, tmp_path: Path) -> Iterator[Bench]:
    """A daemon whose rig file has a warning instead."""
    text = CONFIG.read_text().replace("../../..", str(REPO))
    config = tmp_path / "warn.yaml"
    config.write_text(text.replace("guard:\n", "guard:\n  foreign_command: warn\n"))
    with run_daemon(rig, config, tmp_path) as bench:
        yield bench


def test_a_warning_where_the_rig_file_says_so_and_no_estimate_is_ok(warned: Bench) -> None:
    bench = warned
    bench.center()
    bench.excite()
    bench.daemon.call("subscribe", topics=["estimate"])
    bench.daemon.wait_for("an ok estimate", lambda m: m["params"].get("quality") == "ok")
    command(0.0, count=3, pause_s=0.1)
    assert "Valve" in bench.daemon.event(event="warning", code="foreign_command")["why"]
    bench.daemon.wait_for("quality fault", lambda m: m["params"].get("quality") == "fault")
    assert bench.state() == "exciting"
    bench.daemon.wait_for("ok again", lambda m: m["params"].get("quality") == "ok")
