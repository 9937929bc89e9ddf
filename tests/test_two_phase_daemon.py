"""A daemon that knows nothing of its rig's gain finds it by two phases, and records which was on."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from seod.processes.ring import FLAG_EXCITING, FLAG_SECOND_PHASE
from seod.record.read import items
from tests.peers import Program, Rpc, port_of, port_open, until, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.processes


@contextmanager
def running(rig_file: Path, *arguments: str) -> Iterator[Rpc]:
    program = Program(rig_file.with_name("log"), "run", rig_file, *arguments)
    port = port_of(rig_file)
    until("the port", lambda: port_open(port) or program.process.poll() is not None)
    rpc = Rpc(port)
    try:
        until("the loop", lambda: rpc.call("status")["health"]["ticks"])
        rpc.call("subscribe", topics=["event", "estimate"])
        rpc.call("start")
        yield rpc
    finally:
        rpc.close()
        program.stop()
        print(program.said())


def rows_of(recording: Path) -> list[Any]:
    return [item for item in items(recording, ["motor"]) if not isinstance(item, dict)]


def found(message: dict[str, Any]) -> bool:
    params = message["params"]
    return (
        message["method"] == "estimate"
        and params["quality"] == "ok"
        and params["K_L_sd"] < 0.002 * params["K_L"]
    )


def noted(message: dict[str, Any], told: list[dict[str, Any]]) -> None:
    """Keep each phase that is chosen: sharper estimates choose anew."""
    if message["params"].get("event") == "two_phase" and message["params"]["code"] == "chosen":
        told.append(message["params"])


def test_an_unknown_gain_is_found_put_in_force_and_recorded(tmp_path: Path) -> None:
    rig_file, recording = write_rig_file(tmp_path), tmp_path / "run.mcap"
    text = rig_file.read_text()
    rig_file.write_text(text.replace("K_L: 17   ", "K_L: identified #", 1))
    with running(rig_file, "--record", str(recording)) as rpc:
        truth = rpc.call("info")["truth"]["motor"]
        chosen = rpc.event(event="two_phase")
        assert chosen["code"] == "chosen"
        told = [chosen]
        estimate = rpc.wait_for("both phases", lambda message: noted(message, told) or found(message))[
            "params"
        ]
        for name in ("K_L", "zeta", "omega_n"):
            assert estimate[name] == pytest.approx(truth[name], rel=5e-3)
        answer = until("the gain", lambda: (a := rpc.call("get"))["settings"]["K_L"] < 20.0 and a)
        assert answer["settings"]["K_L"] == pytest.approx(truth["K_L"], rel=0.02)
        for message in rpc.heard:
            noted(message, told)
        assert answer["second_phase"]["late"] in [each["phase"]["late"] for each in told]
        rpc.call("set", axis="motor", two_phase=False)
        assert rpc.event(event="two_phase", code="settings")["phase"] is None
        assert rpc.call("get")["second_phase"] is None
    flags = np.concatenate([item["axes"]["flags"] for item in rows_of(recording)])
    second, exciting = flags & FLAG_SECOND_PHASE > 0, flags & FLAG_EXCITING > 0
    assert 0 < np.count_nonzero(second) < np.count_nonzero(exciting)
    assert np.all(exciting[second])


def test_turned_on_by_the_command_line(tmp_path: Path) -> None:
    rig_file = write_rig_file(tmp_path)
    with running(rig_file) as rpc:
        told = Program(tmp_path / "set", "set", "motor", "two_phase=true", "--port", str(port_of(rig_file)))
        assert told.wait() == 0, told.said()
        assert rpc.event(event="two_phase")["code"] == "chosen"
        estimate = rpc.wait_for("both phases", found)["params"]
        assert estimate["K_L"] == pytest.approx(17.0, rel=5e-3)
        assert rpc.call("get")["settings"]["K_L"] == 17.0
        rpc.call("estop")
        until("neutral", lambda: rpc.call("get")["state"] == "fault")
        assert rpc.call("get")["second_phase"] is None
