"""The systemd unit as shipped: it becomes active, is watched, restarts a hung daemon and stops at neutral."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from bus import CONFIG
from conftest import PORT

from seod.client import Client, RequestError
from tests.peers import REPO, SEOD, Rpc, kill, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bus import Listener

UNIT = "seod@can.service"
RIG_FILES = Path("/etc/seod")
UNITS = Path("/etc/systemd/system")


def systemctl(*arguments: str) -> str:
    """Standard output; stays on the test's own log if it fails."""
    return subprocess.run(["systemctl", *arguments], check=True, stdout=subprocess.PIPE, text=True).stdout


def rig_file() -> str:
    """The guest's rig file for a folder that has its DBC."""
    return CONFIG.read_text().replace("../../../configs/", "")


def property_of(name: str) -> str:
    """One property of the unit."""
    return systemctl("show", "--value", "-p", name, UNIT).strip()


@pytest.fixture(scope="module")
def installed() -> Iterator[None]:
    """Unit, rig file and an override that starts this checkout's environment instead of /opt/seod."""
    RIG_FILES.mkdir(exist_ok=True)
    shutil.copy(REPO / "configs" / "motor.dbc", RIG_FILES)
    (RIG_FILES / "can.yaml").write_text(rig_file())
    shutil.copy(REPO / "systemd" / "seod@.service", UNITS)
    override = UNITS / "seod@.service.d"
    override.mkdir(parents=True)
    # The environment may lie in a home or under /tmp, which the unit hides: show it these.
    folders = {str(REPO), sys.prefix, sys.base_prefix}
    (override / "here.conf").write_text(
        f"[Service]\nExecStart=\nExecStart={SEOD} run {RIG_FILES}/%i.yaml\n"
        f"ProtectHome=tmpfs\nBindReadOnlyPaths={' '.join(folders)}\n"
    )
    systemctl("daemon-reload")
    yield
    _stop()


def _stop() -> None:
    systemctl("stop", UNIT)
    systemctl("reset-failed")


@pytest.fixture
def unit(installed: None, rig: Rpc) -> Iterator[Rpc]:
    """A client of the daemon that systemd started; it runs on, for a start takes a dozen seconds."""
    systemctl("start", UNIT)  # returns once the daemon says READY=1, at once where it runs
    daemon = Rpc(PORT)
    yield daemon
    daemon.close()
    log = subprocess.run(["journalctl", "-q", "-u", UNIT], check=False, stdout=subprocess.PIPE, text=True)
    print(log.stdout)


def excite(daemon: Rpc) -> None:
    """Start, and wait for an estimate that is good."""
    daemon.call("subscribe", topics=["estimate", "event"])
    daemon.call("start")
    daemon.wait_for("an ok estimate", is_good)


def is_good(message: dict[str, Any]) -> bool:
    """An estimate that is good; a fault ends the wait with its reason."""
    told = message.get("params", {})
    assert told.get("event") != "fault", told
    return bool(told.get("quality") == "ok")


def test_it_does_not_run_as_root(unit: Rpc) -> None:
    del unit
    status = Path(f"/proc/{property_of('MainPID')}/status").read_text()
    uid = next(line for line in status.splitlines() if line.startswith("Uid:")).split()[1]
    assert uid != "0"


def test_its_watchdog_is_fed(unit: Rpc) -> None:
    """Longer than the watchdog's time goes by, and the same process still runs."""
    first = property_of("MainPID")
    fed = property_of("WatchdogTimestampMonotonic")
    ticks = unit.call("status")["health"]["ticks"]
    until("five seconds of ticks", lambda: unit.call("status")["health"]["ticks"] > ticks + 500)
    assert property_of("WatchdogTimestampMonotonic") != fed
    assert property_of("MainPID") == first
    assert property_of("NRestarts") == "0"


def test_it_runs_and_measures_and_stops_at_neutral(unit: Rpc, rig: Rpc, listener: Listener) -> None:
    assert property_of("ActiveState") == "active"
    refused = [why for why in unit.call("info")["realtime"]["why"] if "cpu_dma_latency" not in why]
    assert refused == []  # (the guest has no such device)
    excite(unit)
    truth = rig.call("truth")["motor"]
    estimate = unit.call("get", axis="motor")["estimate"]
    assert abs(estimate["omega_n"] / truth["omega_n"] - 1.0) < 0.05
    systemctl("stop", UNIT)
    assert property_of("Result") == "success"
    assert listener.read()[-1].volts == 0.0
    assert rig.call("state")["plants"]["motor"]["voltage"] == 0.0
    assert not port_open(PORT)


def test_a_supervisor_that_hangs_is_restarted(unit: Rpc, rig: Rpc) -> None:
    excite(unit)
    first = property_of("MainPID")
    kill(int(first), signal.SIGSTOP)
    until("a new process", lambda: property_of("MainPID") not in (first, "0"))
    until("active again", lambda: property_of("ActiveState") == "active")
    assert property_of("NRestarts") == "1"
    assert rig.call("state")["plants"]["motor"]["voltage"] == 0.0
    again = Rpc(PORT)
    assert again.call("get", axis="motor")["state"] == "idle"
    again.close()


COMMAND = "c0mm4nd-Yt5RmPd2hGe"
CREDENTIALS = Path("/etc/credstore")
SECURE = """server:
  tls: {certificate: cert.pem, key: $CREDENTIALS_DIRECTORY/tls_key}
  command_token_file: $CREDENTIALS_DIRECTORY/command_token
"""


@pytest.fixture
def secure_unit(installed: None, rig: Rpc) -> Iterator[str]:
    """A unit whose rig file names credentials: a token, and the key of its certificate."""
    _stop()  # the other has the same port
    subprocess.run(
        ["mount", "--make-rshared", "/"], check=True
    )  # as on a machine that has booted; else none arrive
    CREDENTIALS.mkdir(exist_ok=True)
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=localhost"
    key, certificate = CREDENTIALS / "seod.secure.tls_key", RIG_FILES / "cert.pem"
    files = ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run(["openssl", *words.split(), *files], check=True, capture_output=True)
    token = CREDENTIALS / "seod.secure.command_token"
    token.write_text(COMMAND + "\n")
    for path in (key, token):
        path.chmod(0o600)
    text = rig_file()
    assert "\nserver:\n" in text
    (RIG_FILES / "secure.yaml").write_text(text.replace("\nserver:\n", f"\n{SECURE}"))
    yield "seod@secure.service"
    systemctl("stop", "seod@secure.service")
    systemctl("reset-failed")


def test_token_and_key_come_from_credentials(secure_unit: str) -> None:
    systemctl("start", secure_unit)
    certificate = RIG_FILES / "cert.pem"
    with (
        Client("127.0.0.1", PORT, tls=certificate) as nobody,
        pytest.raises(RequestError, match="authenticate first"),
    ):
        nobody.status()
    with Client("127.0.0.1", PORT, COMMAND, tls=certificate) as client:
        assert client.status()["rig"]
        client.estop()
    pid = systemctl("show", "--value", "-p", "MainPID", secure_unit).strip()
    shown = (Path(f"/proc/{pid}/environ").read_bytes(), Path(f"/proc/{pid}/cmdline").read_bytes())
    assert all(COMMAND.encode() not in data for data in shown)
    nobody_else = [
        "setpriv",
        "--reuid=65534",
        "--clear-groups",
        "cat",
        f"/run/credentials/{secure_unit}/command_token",
    ]
    assert subprocess.run(nobody_else, check=False, capture_output=True).returncode != 0
    assert systemctl("show", "--value", "-p", "UMask", secure_unit).strip() == "0077"


def test_a_credential_that_is_missing_is_told(secure_unit: str) -> None:
    (CREDENTIALS / "seod.secure.command_token").unlink()
    assert subprocess.run(["systemctl", "start", secure_unit], check=False).returncode != 0
    words = ["journalctl", "-q", "-o", "cat", "-u", secure_unit]
    said = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert "server.command_token_file" in said
    assert "No such file or directory" in said


def test_a_wrong_rig_file_fails_with_its_reason(installed: None) -> None:
    (RIG_FILES / "wrong.yaml").write_text(rig_file().replace("rate_hz: 100", "rate_hz: -1"))
    started = subprocess.run(["systemctl", "start", "seod@wrong"], check=False)
    assert started.returncode != 0
    systemctl("stop", "seod@wrong")
    log = subprocess.run(
        ["journalctl", "-q", "-o", "json", "-u", "seod@wrong"], check=True, stdout=subprocess.PIPE, text=True
    )
    said = "\n".join(str(json.loads(line)["MESSAGE"]) for line in log.stdout.splitlines())
    assert "rate_hz" in said
    assert os.fspath(RIG_FILES / "wrong.yaml") in said
