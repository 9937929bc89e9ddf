"""The daemon takes an extended rig file as it is, and its model runs beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from seod.client import Client
from seod.diagnose.extend.model import Model
from seod.diagnose.extend.rig_file import new_rig_file
from seod.diagnose.extend.seen import Seen
from tests.peers import Program, free_port, port_open, until

if TYPE_CHECKING:
    from pathlib import Path

MODEL = Model(17.0, 117.0, 0.21, {"valve_deadband": {"half_width": 0.05}}, 1e-3)
SEEN = Seen(1000.0, "rad", True, 0.5, 0.0, 0.004, 0.0, -0.2, 0.2, 0.5, None)


@pytest.mark.processes
def test_seod_run_takes_it_and_the_model_holds(tmp_path: Path) -> None:
    config = tmp_path / "extended.yaml"
    number = free_port()
    text = new_rig_file(MODEL, SEEN, False, "run.csv")
    for old, new in (("  port: 7610 ", f"  port: {number} "), ("count: 45", "count: 450")):
        assert old in text
        text = text.replace(old, new)
    config.write_text(text)
    program = Program(tmp_path / "log", "run", config, "--start")
    try:
        until("the port", lambda: port_open(number) or program.process.poll() is not None)
        with Client(port=number) as rig:
            rig.subscribe(["model_error"])
            errors = [each["params"] for each, _ in zip(rig.notifications(60.0), range(3), strict=False)]
    finally:
        program.stop()
    assert len(errors) == 3
    assert {(each["axis"], each["model"], each["left"]) for each in errors} == {("axis", "kernel", False)}
