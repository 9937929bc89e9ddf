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
from sim.parameters import parameters
from sim.runs import follow
from sim.state import new_state
from tests.peers import Program, Rpc, until

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

EFFECTS = {"valve_deadband": {"half_width": 0.03}}
WANTED = 24
"""Estimates, one each half cycle: twelve periods of the limit cycle."""
UNDISTURBED = 0.25
"""Part of the cycles that no pause of the guest has made longer: it makes none shorter."""


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


def cycles(data: Recording) -> list[slice]:
    """Rows of each cycle of the relay, but the first two."""
    up = np.flatnonzero((data.u[1:] > 0.0) & (data.u[:-1] <= 0.0))[2:]
    assert len(up) > 3
    return [slice(a, b) for a, b in pairwise(up)]


def period(data: Recording) -> float:
    """Of the less disturbed cycles [s]."""
    return float(np.quantile([np.ptp(data.t[rows]) for rows in cycles(data)], UNDISTURBED))


def extent(y: npt.NDArray[np.float64]) -> float:
    return float(np.nanmax(y) - np.nanmin(y))


def simulated(data: Recording) -> npt.NDArray[np.float64]:
    """What our plant does under the commands of a recording, as they left."""
    assert data.t_u is not None
    plant = load_rig(CONFIG).simulation.plants["motor"]
    p = parameters(plant.K_L, plant.omega_n, plant.zeta, EFFECTS)
    s, y, none = new_state(p, float(data.t[0]), 0.0), np.empty(len(data.t)), np.empty(0)
    follow(p[0], s[0], data.t_u, data.u, data.t, none, none, none, none, y)
    return y


def width(data: Recording) -> float:
    """How wide it swings, over how wide our plant does under the same commands; the median of the cycles.

    A half cycle is a whole number of the loop's ticks of 10 ms, and a message some 4 ms later makes it one
    more, and a pause of the guest more than that: all cycles differ, but the commands tell how they do.
    """
    ours = simulated(data)
    return float(np.median([extent(data.y[rows]) / extent(ours[rows]) for rows in cycles(data)]))


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
    assert period(again) == pytest.approx(period(measured), rel=0.14)  # two ticks a half cycle
    assert width(again) == pytest.approx(width(measured), rel=0.01)
