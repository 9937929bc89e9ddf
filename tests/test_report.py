"""`seod report` whole: a rig is recorded, archived, and its sheet made, each by a process of its own."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
from typing import TYPE_CHECKING, Any

import pytest

from tests.peers import SEOD, Program, Rpc, port_of, port_open, until, write_rig_file

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

CALIBRATION = """
    calibration:
      date: 2026-10-30
      K_L: {value: 17.01, sd: 0.01, interval: [16.99, 17.03]}
      null: {value: 0.02, sd: 1.0e-5, interval: [0.01998, 0.02002]}
      deadband_up: {interval: [0.0202, 0.0205]}
      deadband_down: {interval: [0.0195, 0.0198]}
      delay: {value: 0.0, sd: 1.0e-5, interval: [-2.0e-5, 2.0e-5]}

guard:
"""


def seod(*words: str | Path) -> str:
    """What a command prints."""
    env = os.environ | {"SOURCE_DATE_EPOCH": "1800000000"}
    done = subprocess.run([SEOD, *words], capture_output=True, text=True, timeout=240, env=env, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def record(rig_file: Path, path: Path) -> None:
    """Some cycles of excitation, then an e-stop: a fault."""
    program = Program(rig_file.with_suffix(".log"), "run", rig_file, "--record", path)
    port = port_of(rig_file)
    rpc = None
    try:
        until("the port", lambda: port_open(port) or program.process.poll() is not None)
        rpc = Rpc(port)
        rpc.call("subscribe", topics=["event", "estimate"])
        until("the loop", lambda: rpc.call("status")["health"]["ticks"])
        rpc.call("start")
        for _ in range(12):
            rpc.wait_for("an estimate", lambda m: m["params"].get("quality") == "ok")
        rpc.call("estop")
        until("the fault", lambda: rpc.call("get", axis="motor")["state"] == "fault")
    finally:
        if rpc is not None:
            rpc.close()
        program.stop()
        print(program.said())


def test_the_sheet_of_a_rig_that_was_recorded(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    text = rig_file.read_text()
    assert "\nguard:\n" in text
    rig_file.write_text(text.replace("\nguard:\n", CALIBRATION, 1))
    rig = re.findall(r"^rig: (\S+)", text, re.MULTILINE)[0]
    archive = tmp_path / "recordings"
    archive.mkdir()
    record(rig_file, archive / "run.mcap")
    seod("archive", archive)

    told: dict[str, Any] = json.loads(seod("report", rig, "--archive", archive, "--json"))
    axis = told["axes"]["motor"]
    terms = {each["term"]: each for each in axis["terms"]}
    assert told["recordings"] == told["simulated"] == 1
    assert told["rig_file"] == "the rig file in run.mcap"
    assert axis["calibration"]["date"] == "2026-10-30"
    assert axis["hours"]["excited"] > 0.0
    assert [each["code"] for each in axis["faults"]] == ["estop"]
    omega = axis["trends"]["omega_n"]["days"][-1]
    assert omega["value"] == pytest.approx(117.0, rel=0.05)
    at_90 = terms["frequency response, -90 deg"]
    assert at_90["value"] == pytest.approx(omega["value"] / math.tau)
    assert terms["null bias"]["value"] == 0.02
    assert terms["hysteresis"]["how"] == "not measured"

    first, again = tmp_path / "first.html", tmp_path / "again.html"
    for out in (first, again):
        seod("report", rig, "--archive", archive, "--config", rig_file, "--out", out)
    assert first.read_bytes() == again.read_bytes()
    assert "SIMULATED" in first.read_text()


def test_a_response_of_a_recording_is_read_as_the_command_prints_it(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    from seod.sheet.response import read_response

    sweep = tmp_path / "sweep.csv"
    rig_file = write_rig_file(tmp_path)
    seod("simulate", rig_file, "--out", sweep, "--excitation", "multisine", "--seed", "3")
    bode = tmp_path / "bode.json"
    bode.write_text(seod("response", sweep, "--units", "y=rad", "--json"))
    found = read_response(bode)
    at_90 = found.minus_90_deg()
    assert at_90 is not None
    assert at_90.value * math.tau == pytest.approx(117.0, rel=0.05)
