"""From the daemon to the diagnosis by real processes: what is hidden is named, what changes is told."""

from __future__ import annotations

import json
import subprocess
from typing import TYPE_CHECKING, Any

import pytest

from seod.config.edit import edited
from seod.diagnose.record.daemon_part import telling_part
from tests.peers import SEOD, Program, Rpc, port_of, port_open, until, write_rig_file
from tests.test_serial import write_rig_file as write_serial_rig

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.processes, pytest.mark.timeout(400)]

LEVEL = 500.0
FRICTION = {"coulomb_friction": {"level": LEVEL}}


def seod(*words: object) -> str:
    """What a command prints."""
    run = subprocess.run([SEOD, *map(str, words)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """What the daemon records of a rig with friction, and the rig file without it."""
    folder = tmp_path_factory.mktemp("recorded")
    rig = write_rig_file(folder)
    patient = {("guard", "rig_watchdog"): 0.5, ("simulation", "watchdog_s"): 0.5}
    known = edited(
        rig.read_text(), patient
    )  # no recording tells that the amplifier went to neutral by itself
    rig.write_text(edited(known, {("simulation", "plants", "motor", "effects"): FRICTION}))
    seod("run", rig, "--start", "--for", 12, "--record", folder / "run.mcap")
    return folder / "run.mcap", known


def test_what_the_daemon_records_names_what_is_hidden_in_the_rig(
    recorded: tuple[Path, str], tmp_path: Path
) -> None:
    answer = json.loads(seod("diagnose", recorded[0], "--json", "--out", tmp_path))
    effects = {each["name"]: each for each in answer["effects"]}
    assert "coulomb_friction" in effects, answer
    assert effects["coulomb_friction"]["parameters"]["level"]["value"] == pytest.approx(LEVEL, rel=0.05)
    assert answer["extended"]["zeta"] == pytest.approx(0.21, rel=0.05)
    assert any("the rig was excited" in remark for remark in answer["remarks"])
    seod("simulate", tmp_path / "extended.yaml", "--out", tmp_path / "again.csv", "--duration", 1)


def test_beside_the_model_that_was_known_its_replay_tells_that_the_rig_left_it(
    recorded: tuple[Path, str], tmp_path: Path
) -> None:
    recording, known = recorded
    rig, again = tmp_path / "rig.yaml", tmp_path / "again.mcap"
    replay = {"kind": "replay", "file": str(recording), "realtime": True}
    rig.write_text(edited(known, {("driver",): replay}))
    seod("run", rig, "--for", 13, "--record", again)
    part = telling_part(again, None)
    assert part is not None
    assert part.why == "the rig had left its model"


def test_a_rig_that_changes_while_it_runs_is_told_and_found_in_the_recording(tmp_path: Path) -> None:
    config, recording = write_serial_rig(tmp_path), tmp_path / "run.mcap"
    rig = Program(tmp_path / "rig.log", "rig", config)
    door, port = Rpc(rig.ready()["control_port"]), port_of(config)
    daemon = Program(tmp_path / "daemon.log", "run", config, "--record", recording)
    try:
        until("the port", lambda: port_open(port) or daemon.process.poll() is not None)
        rpc = Rpc(port)
        changed, last = _change(rpc, door)
        assert "the rig has left its model" in seod("get", "motor", "--port", port)
        rpc.close()
        door.close()
    finally:
        daemon.stop()
        rig.stop()
        print(daemon.said())
    part = telling_part(recording, None)
    assert part is not None
    assert part.why == "the rig had left its model"
    assert changed < part.start < last <= part.end


def _change(rpc: Rpc, door: Rpc) -> tuple[float, float]:
    """Have the rig get friction once its model holds: the last time it held, and the last of all."""
    rpc.call("subscribe", topics=["event", "model_error"])
    until("the loop", lambda: rpc.call("status")["health"]["ticks"])
    rpc.wait_for_centre("motor")
    rpc.call("start")
    held: dict[str, Any] = {"nrmse": 1.0}
    while held["nrmse"] > held.get("tolerance", 0.0):  # the relay begins to swing
        held = _error(rpc)
        assert not held["left"]
    door.call("set", plant="motor", effects=FRICTION)
    assert "has left its model" in rpc.event(event="warning", code="model")["why"]
    told = _error(rpc)
    begun = told["t"]
    while told["t"] < begun + 4.0:
        told = _error(rpc)
        assert told["left"]
    return held["t"], told["t"]


def _error(rpc: Rpc) -> dict[str, Any]:
    params: dict[str, Any] = rpc.wait_for("a model error", lambda m: m.get("method") == "model_error")[
        "params"
    ]
    return params
