"""The extended rig on the bus: `seod rig` is its other end, the daemon swings it as the recording did."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bus import CONFIG
from conftest import PORT, run_daemon

from seod.config.load import load_rig, load_text
from seod.data import Recording, read
from seod.diagnose.extend.can_rig import DBC, checked, dbc, on_can
from seod.diagnose.extend.model import Model
from seod.diagnose.extend.rig_file import new_rig_file
from seod.diagnose.extend.seen import seen
from tests.peers import Program, Rpc, until

if TYPE_CHECKING:
    from pathlib import Path

EFFECTS = {"valve_deadband": {"half_width": 0.03}}
WANTED = 24
"""Estimates, one each half cycle: twelve periods of the limit cycle."""
UNDISTURBED = 0.25
"""Part of the cycles that no pause of the guest has made longer and larger: it makes none smaller."""


def recorded(config: Path, folder: Path, axis: str, effects: dict[str, dict[str, float]]) -> Recording:
    """What the daemon records of a rig on the bus, effects put into that while it runs."""
    folder.mkdir()
    rig = Program(folder / "rig.log", "rig", config)
    try:
        door = Rpc(rig.ready()["control_port"])
        if effects:
            door.call("set", plant="motor", effects=effects)
        with run_daemon(door, config, folder, "--record", str(folder / "run.mcap")) as bench:
            bench.daemon.call("subscribe", topics=["estimate"])
            bench.daemon.wait_for_centre(axis)
            bench.daemon.call("start")
            until("the relay", lambda: bench.daemon.call("get", axis=axis)["state"] == "exciting")
            for _ in range(WANTED):
                bench.daemon.wait_for("an estimate", lambda m: m.get("method") == "estimate")
            assert bench.daemon.call("get", axis=axis)["state"] == "exciting"
        door.close()
    finally:
        rig.stop()
    return read(folder / "run.mcap")


def limit_cycle(data: Recording) -> tuple[float, float]:
    """Period [s], and amplitude over its square [rad/s^2], of the less disturbed cycles but the first two.

    A half cycle is a whole number of the loop's ticks of 10 ms, and a message some 4 ms later makes it one
    more: the same plant, simulated, then swings 6 % slower and 10 % wider. Its acceleration stays within 3 %.
    """
    up = np.flatnonzero((data.u[1:] > 0.0) & (data.u[:-1] <= 0.0))[2:]
    assert len(up) > 3
    swings = [float(np.nanmax(data.y[a:b]) - np.nanmin(data.y[a:b])) for a, b in pairwise(up)]
    period, swing = (float(np.quantile(each, UNDISTURBED)) for each in (np.diff(data.t[up]), swings))
    return period, 0.5 * swing / period**2


def test_it_swings_as_the_recording_did(tmp_path: Path) -> None:
    measured = recorded(CONFIG, tmp_path / "measured", "motor", EFFECTS)
    found = seen(measured, speed=False)
    assert found.relay
    plant = load_rig(CONFIG).simulation.plants["motor"]
    model = Model(plant.K_L, plant.omega_n, plant.zeta, EFFECTS, plant.noise)
    text = new_rig_file(model, found, False, "run.mcap")
    config = load_text(text, "extended", tmp_path)
    (tmp_path / DBC).write_text(dbc(config))
    path = tmp_path / "extended-can.yaml"
    bus_text = checked(on_can(text, config.loop.rate_hz), tmp_path)
    path.write_text(bus_text.replace("port: 7610", f"port: {PORT}"))
    again = recorded(path, tmp_path / "again", "axis", {})
    (period, acceleration), (wanted, pushed) = limit_cycle(again), limit_cycle(measured)
    assert period == pytest.approx(wanted, rel=0.07)  # a tick a half cycle
    assert acceleration == pytest.approx(pushed, rel=0.05)
