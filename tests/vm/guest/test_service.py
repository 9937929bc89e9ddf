"""The service as administrators have it: installed, crashed, with a wrong rig file, without a bus, twice."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from bus import CONFIG, ip
from conftest import PORT

import seod
from tests.peers import REPO, Rpc, kill, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bus import Listener

RIG_FILES = Path("/etc/seod")
UNITS = Path("/etc/systemd/system")
HOUSES = Path(os.environ.get("SEOD_WHEELHOUSES", ""))
SLOW_S = 200.0
"""A start takes a guest whose host is busy so long."""
UNIT, SECOND = "seod@can.service", "seod@second.service"

pytestmark = pytest.mark.timeout(400)


def systemctl(*words: str, check: bool = True) -> str:
    done = subprocess.run(["systemctl", *words], check=False, capture_output=True, text=True)
    assert done.returncode == 0 or not check, done.stderr + journal("-u", UNIT)
    return done.stdout.strip()


def journal(*words: str) -> str:
    command = ["journalctl", "-q", "-o", "cat", *words]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def fields(*words: str) -> list[dict[str, Any]]:
    command = ["journalctl", "-q", "-o", "json", *words]
    lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    return [json.loads(line) for line in lines]


def show(name: str, unit: str = UNIT) -> str:
    return systemctl("show", "--value", "-p", name, unit)


def manage(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, REPO / "systemd/install.py", *words]
    return subprocess.run(command, check=False, capture_output=True, text=True)


def install(house: str) -> subprocess.CompletedProcess[str]:
    return manage("install", "--wheelhouse", HOUSES / house)


def rig_file() -> str:
    return CONFIG.read_text().replace("../../../configs/", "")


@pytest.fixture(scope="module")
def installed() -> Iterator[None]:
    """This checkout's wheel, and two rig files: one on vcan0, one on vcan1."""
    RIG_FILES.mkdir(exist_ok=True)
    shutil.copy(REPO / "configs" / "motor.dbc", RIG_FILES)
    (RIG_FILES / "can.yaml").write_text(rig_file())
    second = rig_file().replace("rig: guest-motor", "rig: second").replace("vcan0", "vcan1")
    (RIG_FILES / "second.yaml").write_text(second.replace("port: 7600", "port: 7610"))
    drop = UNITS / "seod@.service.d"
    drop.mkdir(parents=True)
    # The interpreter may lie in a home, which the unit hides; the guest is slow to start Python.
    folders = {str(REPO), sys.prefix, sys.base_prefix}
    (drop / "here.conf").write_text(
        f"[Service]\nProtectHome=tmpfs\nBindReadOnlyPaths={' '.join(sorted(folders))}\n"
        "TimeoutStartSec=300\nTimeoutStopSec=60\n"
    )
    done = install("now")
    assert done.returncode == 0, done.stderr
    yield
    systemctl("stop", "seod@*", check=False)


@pytest.fixture
def unit(installed: None) -> Iterator[Rpc]:
    """A client of the daemon; it runs on, for a start takes a dozen seconds."""
    systemctl("start", UNIT)
    daemon = Rpc(PORT)
    yield daemon
    daemon.close()


def test_it_is_ready_once_it_has_ticked_and_tells_the_journal(unit: Rpc, listener: Listener) -> None:
    assert unit.call("info")["version"] == seod.__version__
    assert unit.call("status")["health"]["ticks"] > 0
    assert show("NRestarts") == "0"
    unit.call("estop")
    faults = until("the fault", lambda: fields("CODE=estop", "RIG=guest-motor"))
    assert faults[-1]["PRIORITY"] == "3"
    assert "e-stop by a client" in faults[-1]["MESSAGE"]
    status = Path(f"/proc/{show('MainPID')}/status").read_text()
    assert [line.split()[1] for line in status.splitlines() if line.startswith("CapEff")] == ["0" * 16]
    del listener


def test_a_crash_ends_in_neutral_and_a_new_start(unit: Rpc, listener: Listener) -> None:
    first = show("MainPID")
    kill(int(first), signal.SIGKILL)
    until("neutral, after the end", lambda: "neutral written" in journal("-u", UNIT), SLOW_S)
    again = lambda: show("MainPID") not in (first, "0") and show("ActiveState") == "active"  # noqa: E731
    until("a new process", again, SLOW_S)
    assert show("NRestarts") == "1"
    assert {frame.volts for frame in listener.read()} == {0.0}


def test_a_wrong_rig_file_is_one_line_and_no_storm(installed: None) -> None:
    (RIG_FILES / "wrong.yaml").write_text(rig_file().replace("rate_hz: 100\n  hang", "rate_hz: -1\n  hang"))
    assert subprocess.run(["systemctl", "start", "seod@wrong"], check=False).returncode != 0
    assert show("NRestarts", "seod@wrong") == "0"
    assert show("ExecMainStatus", "seod@wrong") == "78"
    assert show("ActiveState", "seod@wrong") == "failed"
    said = journal("-u", "seod@wrong", "-t", "seod")
    assert said.count("rate_hz") == 1, said
    (RIG_FILES / "wrong.yaml").unlink()


def test_two_rigs_on_one_machine(unit: Rpc) -> None:
    systemctl("start", "seod-vcan@vcan1")
    systemctl("start", SECOND)
    other = Rpc(7610)
    assert [each.call("info")["rig"] for each in (unit, other)] == ["guest-motor", "second"]
    other.close()
    systemctl("stop", SECOND)
    assert unit.call("status")["health"]["ticks"] > 0


def processes(cgroup: Path) -> dict[str, str]:
    """Modules and process ids of the daemon's parts."""
    found = {}
    for pid in (cgroup / "cgroup.procs").read_text().split():
        words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        found[words[words.index("-m") + 1] if "-m" in words else words[0]] = pid
    return found


HOG = """
import os, sys, time
open(sys.argv[1], "w").write(str(os.getpid()))
open("/proc/self/oom_score_adj", "w").write("-1000")
held = bytearray(int(sys.argv[2]))
held[::4096] = b"1" * len(held[::4096])
print("held", flush=True)
time.sleep(600)
"""


def killed_for_memory() -> list[str]:
    """Process ids, as the kernel says."""
    said = subprocess.run(["dmesg"], check=True, stdout=subprocess.PIPE, text=True).stdout
    return re.findall(r"out of memory: Killed process (\d+)", said)


def test_where_memory_runs_out_the_loop_and_the_supervisor_are_not_taken(unit: Rpc) -> None:
    cgroup = Path("/sys/fs/cgroup") / show("ControlGroup").lstrip("/")
    parts, main = processes(cgroup), show("MainPID")
    limit = int((cgroup / "memory.current").read_text()) + (16 << 20)
    systemctl("set-property", "--runtime", UNIT, f"MemoryMax={limit}", "MemorySwapMax=0")
    hog = subprocess.Popen([sys.executable, "-c", HOG, cgroup / "cgroup.procs", str(48 << 20)])
    try:
        taken = until("somebody's end", killed_for_memory, SLOW_S)
    finally:
        hog.kill()
        hog.wait()
        systemctl("set-property", "--runtime", UNIT, "MemoryMax=infinity")
    assert taken[0] in parts.values()
    assert not {parts["seod.loop"], main} & {*taken}


def test_a_bus_that_appears_later_is_taken(installed: None) -> None:
    systemctl("stop", UNIT)
    ip("link", "del", "vcan0")
    try:
        systemctl("start", "--no-block", UNIT)
        until("a try", lambda: int(show("NRestarts")) >= 1, SLOW_S)
        assert not port_open(PORT)
    finally:
        systemctl("start", "seod-vcan@vcan0")
    until("the daemon", lambda: show("ActiveState") == "active", SLOW_S)
    assert "cannot open socketcan channel" in journal("-u", UNIT)
    systemctl("stop", UNIT)
