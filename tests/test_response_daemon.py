"""`seod response` from end to end: a daemon of real processes on a simulated rig."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

from seod.client import Client
from seod.launch.daemon import spawn
from seod.launch.with_client import READY_S
from tests.test_calibrate_daemon import rig_file as shifted_file

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

__all__ = ["shifted_file"]

SHORT = ("--band", "2:45", "--period", "0.7", "--periods", "3", "--realisations", "2")


@pytest.fixture
def rig_file(shifted_file: Path) -> Path:
    """The shipped rig on a free port, without the null shift that lets it drift while it is idle."""
    shifted_file.write_text(shifted_file.read_text().replace("{voltage: 0.02}", "{voltage: 0.0}"))
    return shifted_file


def response(*words: str) -> list[str]:
    return [sys.executable, "-m", "seod.cli", "response", *words]


def test_response_and_limit_cycle_agree_with_the_truth(rig_file: Path, tmp_path: Path) -> None:
    plot = tmp_path / "bode.png"
    command = response("--config", str(rig_file), *SHORT, "--e-a", "0.4", "--json", "--plot", str(plot))
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["quality"] == "ok", found["message"]
    for name, truth in (("K_L", 17.0), ("omega_n", 117.0), ("zeta", 0.21), ("delay", 0.0)):
        value, sd = found["fit"][name]["value"], found["fit"][name]["sd"]
        assert abs(value - truth) < 6.0 * sd + 1e-3 * truth, (name, value, sd)
    assert abs(found["difference"]["omega_n"]) < 0.01
    assert abs(found["difference"]["zeta"]) < 0.03
    assert found["limit_cycle"]["e_a"] == 0.4
    assert len(found["points"]) > 10
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_an_interrupted_response_leaves_the_axis_where_it_stood(rig_file: Path) -> None:
    daemon = spawn(rig_file, None, None)
    port = int(rig_file.read_text().partition("port: ")[2].split()[0])
    try:
        with Client(port=port, wait=READY_S) as client:
            before = client.get("motor")["settings"]
            asked = subprocess.Popen(response("--config", str(rig_file), *SHORT, "--no-relay"))
            patience = time.monotonic() + 150.0
            while (
                client.get("motor")["state"] != "exciting"
                and asked.poll() is None
                and time.monotonic() < patience
            ):
                time.sleep(0.05)
            asked.send_signal(signal.SIGTERM)
            assert asked.wait(120.0) == 130
            now = client.get("motor")
            assert (now["state"], now["settings"], now["fault"]) == ("idle", before, None)
    finally:
        daemon.terminate()
        daemon.wait()


def test_what_does_not_fit_moves_nothing(rig_file: Path) -> None:
    command = response("--config", str(rig_file), "--amplitude", "1.9", "--band", "0.2:45", "--no-relay")
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
    assert done.returncode == 1
    assert "of the axis' limits" in done.stderr
    assert "V fits" in done.stderr
