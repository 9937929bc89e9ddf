"""A daemon whose rig's supply is nearly spent: each amplitude alone looks good, two tell that it is not."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, Rpc, port_of, port_open, until, write_rig_file

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.processes

SUPPLY = 2.0 * 17.0 * 0.5 * 117.0
"""Twice what the load's acceleration needs at e_a = 0.5 V [rad/s^2]."""


def weak_rig(folder: Path) -> Path:
    """On simulated time: nothing depends on how busy the machine is."""
    rig_file = write_rig_file(folder)
    text = rig_file.read_text().replace("realtime: true ", "realtime: false", 1)
    weak = f"sensor_quantization: {{step: 1.0e-6}}\n        square_root_flow: {{supply: {SUPPLY}}} #"
    text = text.replace(
        "      delay: 0 s ", "      delay: 0 s\n      delay_sd: 0 s ", 1
    )  # as a calibrated rig
    rig_file.write_text(text.replace("sensor_quantization: {step: 1.0e-6}", weak, 1))
    return rig_file


def test_a_change_of_e_a_shows_what_one_amplitude_hides(tmp_path: Path) -> None:
    rig_file = weak_rig(tmp_path)
    program = Program(tmp_path / "log", "run", rig_file)
    port = port_of(rig_file)
    until("the port", lambda: port_open(port) or program.process.poll() is not None)
    rpc = Rpc(port)
    try:
        until("the loop", lambda: rpc.call("status")["health"]["ticks"])
        truth = rpc.call("info")["truth"]["motor"]["zeta"]
        rpc.call("subscribe", topics=["event", "estimate"])
        rpc.call("start")
        hidden = rpc.wait_for("an answer", lambda m: m["params"].get("quality") == "ok")["params"]
        assert abs(hidden["zeta"] / truth - 1.0) > 0.05
        assert hidden["e_a_dependence"] is None
        rpc.call("set", axis="motor", e_a=0.2, hysteresis=0.002)
        assert "0.5 V" in rpc.event(event="warning", code="depends_on_e_a")["why"]
        shown = until("get", lambda: (e := rpc.call("get")["estimate"])["quality"] == "nonlinear" and e)
        assert shown["e_a_dependence"]["other_e_a"] == 0.5
        assert shown["e_a_dependence"]["zeta"] < -0.03
        assert rpc.call("get")["controller"] is None
        told = Program(
            tmp_path / "ramp", "ramp", "motor", "--from", "0.15", "--to", "0.45", "--steps", "3", "--json",
            "--port", str(port),
        )  # fmt: skip
        assert told.wait() == 0, told.said()
        answer = json.loads(told.said().splitlines()[-1])
        assert answer["depends_on_e_a"]["zeta"]
        zetas = [step["zeta"] for step in answer["steps"]]
        assert zetas == sorted(zetas)
        assert all(step["clean"] for step in answer["steps"])
    finally:
        rpc.close()
        program.stop()
        print(program.said())
