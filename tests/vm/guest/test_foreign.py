"""Others on the bus who command our actuator: another program on this computer, and a second daemon."""

from __future__ import annotations

import signal
import subprocess
from typing import TYPE_CHECKING

import pytest
from bus import CONFIG, command

from tests.peers import REPO, SEOD, find_process, kill, until

if TYPE_CHECKING:
    from pathlib import Path

    from bus import Listener
    from conftest import Bench

LOOP = "seod.loop"


@pytest.mark.parametrize("volts", [0.0, 5.0], ids=["neutral", "a movement"])
def test_one_frame_of_another_program_is_a_fault(bench: Bench, listener: Listener, volts: float) -> None:
    bench.excite()
    before = bench.counters()["foreign_commands"]
    command(volts)
    fault = bench.daemon.event(event="fault")
    assert fault["code"] == "foreign_command"
    assert (
        f"another program on this computer sends our command Valve (id 0x201): voltage {volts:g} V"
        in fault["why"]
    )
    until("neutral", bench.rig_is_neutral)
    until("the counter", lambda: bench.counters()["foreign_commands"] == before + 1)
    assert {f.volts for f in listener.read() if f.t > fault["t"]} == {0.0}
    bench.daemon.call("reset")
    bench.wait_state("idle")
    bench.center()
    bench.excite()


def test_it_is_a_fault_of_a_rig_at_rest_too(bench: Bench) -> None:
    command(1.0)
    assert bench.daemon.event(event="fault")["code"] == "foreign_command"


def test_our_own_commands_never_are(bench: Bench) -> None:
    bench.excite()
    before = bench.counters()
    until("500 commands", lambda: bench.counters()["frames_sent"] > before["frames_sent"] + 500)
    assert bench.state() == "exciting"
    assert bench.counters()["foreign_commands"] == before["foreign_commands"]


def test_neutral_of_the_supervisor_is_not_foreign_to_the_next_loop(bench: Bench) -> None:
    before = bench.counters()["foreign_commands"]
    kill(find_process(LOOP, bench.program.pid), signal.SIGKILL)
    assert bench.daemon.event(event="fault")["code"] == "loop_died"
    bench.daemon.call("reset")
    bench.wait_state("idle")
    sent = bench.counters()["frames_sent"]
    until("two seconds of the next loop", lambda: bench.counters()["frames_sent"] > sent + 200)
    assert bench.state() == "idle"
    assert bench.counters()["foreign_commands"] <= before, "a new loop counts from 0"


def test_a_second_daemon_on_the_bus_is_refused_whatever_its_rig_is_called(
    bench: Bench, tmp_path: Path
) -> None:
    before = bench.counters()["foreign_commands"]
    text = CONFIG.read_text().replace("../../..", str(REPO))
    config = tmp_path / "second.yaml"
    config.write_text(text.replace("rig: guest-motor", "rig: another-name").replace("port: 7600", "port: 0"))
    second = subprocess.run([SEOD, "run", config], capture_output=True, text=True, check=False, timeout=60)
    assert second.returncode != 0
    assert f"socketcan vcan0 id 0x201 is commanded already by process {bench.program.pid}" in second.stderr
    assert bench.state() == "idle"
    assert bench.counters()["foreign_commands"] == before
