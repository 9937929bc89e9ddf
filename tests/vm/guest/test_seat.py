"""Two axes on CAN FD: both estimates at once, and a fault of one that leaves the other going."""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import pytest

from tests.peers import PATIENCE_S, Program, Rpc, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

CONFIG = Path(__file__).with_name("seat.yaml")
PORT = 7600
AXES = ("pitch", "roll")
TOLERANCE = 0.03
WANTED = 15
"""Estimates of each axis of which the median is taken."""


class Seat:
    """Both ends of the bus."""

    def __init__(self, rig: Rpc, daemon: Rpc) -> None:
        self.rig = rig
        self.daemon = daemon

    def states(self) -> dict[str, str]:
        axes = self.daemon.call("status")["axes"]
        return {name: axes[name]["state"] for name in AXES}

    def faults(self) -> list[dict[str, object]]:
        return [self.daemon.call("get", axis=name)["fault"] for name in AXES]

    def wait_states(self, *wanted: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while (seen := tuple(self.states().values())) != wanted:
            assert time.monotonic() < deadline, f"wanted {wanted}, is {seen}: {self.faults()}"
            time.sleep(0.05)


@pytest.fixture(scope="module")
def seat(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seat]:
    logs = tmp_path_factory.mktemp("seat")
    rig = Program(logs / "rig", "rig", CONFIG)
    daemon = Program(logs / "daemon", "run", CONFIG)
    try:
        door = Rpc(rig.ready()["control_port"])
        until("the daemon's port", lambda: port_open(PORT) or daemon.process.poll() is not None)
        client = Rpc(PORT)
        until("both sensors", lambda: client.call("status")["health"]["ticks"] > 20)
        yield Seat(door, client)
        door.close()
        client.close()
    finally:
        daemon.stop()
        rig.stop()
        print(daemon.said())


def test_both_axes_are_estimated_at_once(seat: Seat) -> None:
    seat.daemon.call("subscribe", topics=["estimate", "event"])  # a fault ends the waiting
    seat.daemon.call("start")
    good: dict[str, list[dict[str, float]]] = {name: [] for name in AXES}
    while any(len(each) < WANTED for each in good.values()):
        message = seat.daemon.wait_for("an estimate", lambda m: m.get("method") == "estimate")["params"]
        if message["quality"] == "ok":
            good[message["axis"]].append(message)
    truth = seat.rig.call("truth")
    for axis in AXES:
        for name in ("omega_n", "zeta"):
            value = median(message[name] for message in good[axis])
            print(f"{axis} {name}: {value:.5g}, {100 * (value / truth[axis][name] - 1):+.2f} %")
            assert abs(value / truth[axis][name] - 1.0) < TOLERANCE


def test_a_fault_of_one_axis_leaves_the_other_going(seat: Seat) -> None:
    assert seat.states() == {"pitch": "exciting", "roll": "exciting"}
    seat.rig.call("set", plant="roll", position=1.4)  # beyond its travel
    seat.wait_states("exciting", "fault")
    until("roll is neutral", lambda: seat.rig.call("state")["plants"]["roll"]["voltage"] == 0.0)
    fault = seat.daemon.call("get", axis="roll")["fault"]
    assert fault["code"] in ("travel", "speed", "amplitude")
    seat.rig.call("set", plant="roll", position=0.0)
    seat.daemon.wait_for_centre("roll")
    seat.daemon.call("reset", axis="roll")
    seat.wait_states("exciting", "idle")
    seat.daemon.call("start", axis="roll")
    seat.wait_states("exciting", "exciting")


def test_the_emergency_stop_stops_both(seat: Seat) -> None:
    seat.rig.call("constant", channel="Pitch.run_enable", value=0.0)
    seat.wait_states("fault", "fault")
    plants = seat.rig.call("state")["plants"]
    assert [plants[axis]["voltage"] for axis in AXES] == [0.0, 0.0]
