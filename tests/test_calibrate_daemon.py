"""`seod calibrate` from end to end: a daemon of real processes on a simulated rig, and its rig file."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from seod.config.load import load_rig
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.processes


@pytest.fixture
def rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The shipped rig with a null shift; a busy machine and a slow way back are not what is tested here."""
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    text = (configs_dir() / "virtual.yaml").read_text().replace("port: 7600", f"port: {port}\n  panel: false")
    text = text.replace("hang_timeout: 50 ms", "hang_timeout: 1 s").replace("count: 20,", "count: 150,")
    text = text.replace("bandwidth: 5 rad/s", "bandwidth: 20 rad/s").replace("stale: 10 ms", "stale: 80 ms")
    text = text.replace("      effects:", "      effects:\n        null_shift: {voltage: 0.02}")
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    return path


@pytest.mark.timeout(300)
def test_the_command_finds_the_truth_and_writes_it(rig_file: Path) -> None:
    before = rig_file.read_text()
    for old, new in (("rate_hz: 2000 ", "rate_hz: 1000 "), ("count: 150,", "count: 75,")):
        assert before.count(old) == 1, old
        before = before.replace(old, new)
    rig_file.write_text(before)
    command = [sys.executable, "-m", "seod.cli", "calibrate", str(rig_file), "--yes", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["motor"]
    assert found["polarity"] == "ok"
    assert found["K_L"]["value"] == pytest.approx(17.0, rel=0.01)
    assert found["null"]["value"] == pytest.approx(0.02, abs=0.005)
    for name, truth in (
        ("K_L", 17.0),
        ("null", 0.02),
        ("delay", 0.0),
    ):  # 7 sd of 5 degrees of freedom: one run in a thousand
        value, sd = found[name]["value"], found[name]["sd"]
        assert abs(value - truth) < 7.0 * sd, (name, value, sd)
    axis = load_rig(rig_file).axes["motor"]
    assert pytest.approx(17.0, rel=0.01) == axis.K_L
    assert axis.relay.bias == pytest.approx(0.02, abs=0.005)
    assert rig_file.with_name("rig.yaml.bak").read_text() == before


def test_without_anybody_to_ask_nothing_moves(rig_file: Path) -> None:
    command = [sys.executable, "-m", "seod.cli", "calibrate", str(rig_file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    assert done.returncode == 1
    assert "--yes" in done.stderr
