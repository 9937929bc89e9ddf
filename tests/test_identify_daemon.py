"""A running daemon's recording identified afterwards, and its advice for the position controller over TCP."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from tests.peers import Program, Rpc, port_of, port_open, until, write_rig_file

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.processes


class Run:
    """What a daemon told while it recorded."""

    def __init__(self, folder: Path) -> None:
        self.rig_file, self.recording = write_rig_file(folder), folder / "run.mcap"
        program = Program(folder / "log", "run", self.rig_file, "--record", str(self.recording))
        port = port_of(self.rig_file)
        until("the port", lambda: port_open(port) or program.process.poll() is not None)
        rpc = Rpc(port)
        try:
            self.truth = rpc.call("info")["truth"]["motor"]
            self.idle = rpc.call("get", axis="motor")
            rpc.call("subscribe", topics=["estimate"])
            until("the loop", lambda: rpc.call("status")["health"]["ticks"])
            rpc.call("start")
            for _ in range(40):
                rpc.wait_for("an estimate", lambda m: m["params"].get("quality") == "ok")
            self.running = rpc.call("get", axis="motor")
            rpc.call("stop")
        finally:
            rpc.close()
            program.stop()
            print(program.said())

    def identify(self, *options: str) -> dict[str, Any]:
        """The answer of `seod identify` on its recording."""
        command = [sys.executable, "-m", "seod.cli", "identify", str(self.recording), "--json", *options]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(tmp_path_factory.mktemp("run"))


def test_get_tells_gains_once_the_estimate_is_believed(run: Run) -> None:
    assert run.idle["controller"] is None
    advice, estimate = run.running["controller"], run.running["estimate"]
    assert estimate["quality"] == "ok"
    corner = 2.0 * (estimate["zeta"] - 1.96 * estimate["zeta_sd"]) * estimate["omega_n"]
    assert 0.99 * corner < advice["velocity_gain_limit"] <= 1.00001 * corner
    gain = advice["velocity_gain_limit"] / estimate["K_L"]
    assert advice["controller_gain_limit"] == pytest.approx(gain, rel=1e-5)
    assert advice["velocity_gain"] <= 0.5 * advice["velocity_gain_limit"] * 1.0001
    assert (advice["gain_margin"], advice["phase_margin"]) == (2.0, pytest.approx(0.785398))


@pytest.mark.parametrize("method", ["output_error", "wave", "exact"])
def test_its_recording_gives_the_same_plant_afterwards(run: Run, method: str) -> None:
    found = run.identify("--config", str(run.rig_file), "--method", method)
    assert found["quality"] == "ok"
    assert found["configured"]["K_L"] == run.truth["K_L"]
    for name in ("omega_n", "zeta"):
        off = abs(found[name]["value"] - run.truth[name])
        assert off < max(4.0 * found[name]["sd"], 0.003 * run.truth[name]), name
    limit = found["advice"]["velocity_gain_limit"] / (2.0 * run.truth["zeta"] * run.truth["omega_n"])
    assert (0.8 if method == "exact" else 0.98) < limit < 1.02  # exact cannot learn a delay that nobody told
