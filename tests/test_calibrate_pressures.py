"""`seod calibrate --pressures` from end to end: a supply that is moved between the measurements.

The daemon is real processes; the simulated valve's flow goes with the square root of the supply pressure, the
rig file believes Eq. 9 until the command has written what it found.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from seod.config.gain_in_force import gain_of
from seod.config.load import load_rig
from tests import door
from tests.peers import REPO, Rpc, free_port, port_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

NOMINAL, K_L = 8.0e6, 17.434
PRESSURES = (8.0e6, 10.0e6, 5.0e6)
"""In the order in which they are set; the first one is there already."""


def true_gain(ps: float) -> float:
    return K_L * math.sqrt(ps / NOMINAL)


@pytest.fixture
def door_port() -> int:
    return free_port()


@pytest.fixture
def rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, door_port: int) -> Path:
    """The shipped servo motor on simulated time, with a valve that follows the pressure."""
    door.install(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(REPO)]))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    text = (REPO / "configs" / "servo-virtual.yaml").read_text()
    effects = "{square_root_flow: {supply: 4.0e+4}, null_shift: {voltage: 0.05}}"
    follows = f"supply_pressure: pressure\n      nominal_pressure: {NOMINAL:.1f}\n      effects: {effects}\n"
    for old, new in (
        ("  kind: virtual\n", f"  kind: virtual-with-a-door\n  door: {door_port}\n  realtime: false\n"),
        ("rate_hz: 2000", "rate_hz: 1000"),
        ("port: 7600", f"port: {free_port()}\n  panel: false"),
        ("rig: virtual-servo", f"rig: servo-{door_port}"),
        ("      noise: 0.2 ", f"      {follows}      noise: 0.05 "),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    return path


@pytest.fixture
def command(rig_file: Path) -> Iterator[subprocess.Popen[str]]:
    words = ["calibrate", str(rig_file), "--pressures", str(len(PRESSURES)), "--yes", "--json"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-m", "seod.cli", *words], text=True, **pipes) as process:
        yield process
        process.kill()


def hear(process: subprocess.Popen[str], wanted: str) -> None:
    """Read what it says to people until it says that."""
    assert process.stderr is not None
    said = ""
    while wanted not in said:
        character = process.stderr.read(1)
        assert character, f"it never said {wanted!r}: {said}"
        said += character


def set_pressure(rpc: Rpc, port: int, ps: float) -> None:
    """Move the supply, and wait until the daemon sees it."""
    door.move(port, "pressure", ps)
    rpc.call("subscribe", topics=["sample"], rate_hz=20.0)
    rpc.wait_for("the pressure", lambda m: m.get("method") == "sample" and m["params"]["ps"] == ps)


def test_gains_at_three_pressures_become_a_table_of_the_truth(
    command: subprocess.Popen[str], rig_file: Path, door_port: int
) -> None:
    assert command.stdin is not None
    for number, ps in enumerate(PRESSURES[1:], start=2):
        hear(command, f"Set supply pressure {number} of 3, then press Enter.")
        rpc = Rpc(port_of(rig_file))
        set_pressure(rpc, door_port, ps)
        rpc.close()
        command.stdin.write("\n")
        command.stdin.flush()
    out, said = command.communicate(timeout=100)
    assert command.returncode == 0, said
    found = json.loads(out.splitlines()[-1])["motor"]
    assert [each["ps"] for each in found["pressures"]] == sorted(PRESSURES)
    for each in found["pressures"]:
        value, sd = each["K_L"]["value"], each["K_L"]["sd"]
        assert value == pytest.approx(true_gain(each["ps"]), rel=0.005)
        assert abs(value - true_gain(each["ps"])) < 7.0 * sd
    assert found["null"]["value"] == pytest.approx(0.05, abs=2e-3)
    axis = load_rig(rig_file).axes["motor"]
    gain = gain_of(axis.K_L)
    assert [gain(ps) for ps in PRESSURES] == pytest.approx([true_gain(ps) for ps in PRESSURES], rel=0.005)
    assert gain(9.0e6) == pytest.approx(true_gain(9.0e6), rel=0.01)
    assert axis.calibration is not None
    assert axis.calibration.supply_pressure == PRESSURES[0]
