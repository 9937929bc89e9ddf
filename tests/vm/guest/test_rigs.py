"""The other rigs on the kernel's bus: estimates of all axes, faults, pressure, emergency stop."""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

import pytest

from tests.peers import PATIENCE_S, Program, Rpc, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

PORT = 7600
TOLERANCE = 0.03
WANTED = 15
"""Estimates of each axis of which the median is taken."""


class Facts(NamedTuple):
    """What the tests have to know of a rig."""

    axes: tuple[str, ...]
    enable: str
    """Channel of the emergency stop chain."""


RIGS = {
    "seat": Facts(("pitch", "roll"), "Pitch.run_enable"),
    "servo": Facts(("motor",), "Speed.run_enable"),
    "tail": Facts(("rudder", "stabilator"), "Rudder.run_enable"),
}


class Bench:
    """Both ends of the bus."""

    def __init__(self, facts: Facts, rig: Rpc, daemon: Rpc) -> None:
        self.axes, self.enable = facts
        self.rig = rig
        self.daemon = daemon

    def states(self) -> tuple[str, ...]:
        axes = self.daemon.call("status")["axes"]
        return tuple(axes[name]["state"] for name in self.axes)

    def voltages(self) -> list[float]:
        plants = self.rig.call("state")["plants"]
        return [plants[name]["voltage"] for name in self.axes]

    def faults(self) -> list[dict[str, object]]:
        return [self.daemon.call("get", axis=name)["fault"] for name in self.axes]

    def wait_states(self, *wanted: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while (seen := self.states()) != wanted:
            assert time.monotonic() < deadline, f"wanted {wanted}, is {seen}: {self.faults()}"
            time.sleep(0.05)

    def throw(self, axis: str) -> None:
        """Put an axis beyond its travel until its fault is told (the relay drives it back)."""
        beyond = 0.55 if axis == "rudder" else 1.4

        def stopped() -> object:
            self.rig.call("set", plant=axis, position=beyond)
            return self.daemon.call("get", axis=axis)["fault"]

        until("the fault", stopped)
        until("neutral", lambda: self.voltages()[self.axes.index(axis)] == 0.0)
        fault = self.daemon.call("get", axis=axis)["fault"]
        assert fault["code"] in ("travel", "speed", "amplitude")
        self.put_back(axis)

    def put_back(self, axis: str) -> None:
        """Into the middle, and wait until it stands: a load that still swings hides the polarity."""
        self.rig.call("set", plant=axis, position=0.0)
        until("rest", lambda: abs(self.rig.call("state")["plants"][axis]["velocity"]) < 0.02)
        self.rig.call("set", plant=axis, position=0.0)
        self.daemon.wait_for_centre(axis)

    def good(self) -> dict[str, list[dict[str, float]]]:
        """The next good estimates of each axis."""
        number = self.daemon.call("subscribe", topics=["estimate", "event"])["subscription"]
        found: dict[str, list[dict[str, float]]] = {name: [] for name in self.axes}
        while any(len(each) < WANTED for each in found.values()):
            message = self.daemon.wait_for("an estimate", lambda m: m.get("method") == "estimate")["params"]
            if message["quality"] == "ok":
                found[message["axis"]].append(message)
        self.daemon.call("unsubscribe", subscription=number)
        self.daemon.heard.clear()
        return found

    def check_estimates(self) -> dict[str, list[dict[str, float]]]:
        """The next good estimates agree with the rig's true values."""
        found, truth = self.good(), self.rig.call("truth")
        for axis, name in ((axis, name) for axis in self.axes for name in ("omega_n", "zeta")):
            value = median(message[name] for message in found[axis])
            print(f"{axis} {name}: {value:.5g}, {100 * (value / truth[axis][name] - 1):+.2f} %")
            assert abs(value / truth[axis][name] - 1.0) < TOLERANCE
        return found


@pytest.fixture(scope="module")
def bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """One rig after the other, its daemon idle at first."""
    config, logs = Path(__file__).with_name(f"{request.param}.yaml"), tmp_path_factory.mktemp(request.param)
    rig = Program(logs / "rig", "rig", config)
    daemon = Program(logs / "daemon", "run", config)
    try:
        door = Rpc(rig.ready()["control_port"])
        until("the daemon's port", lambda: port_open(PORT) or daemon.process.poll() is not None)
        client = Rpc(PORT)
        until("the sensors", lambda: client.call("status")["health"]["ticks"] > 20)
        yield Bench(RIGS[request.param], door, client)
        door.close()
        client.close()
    finally:
        daemon.stop()
        rig.stop()
        print(daemon.said())


def on(*names: str) -> pytest.MarkDecorator:
    """On these rigs."""
    return pytest.mark.parametrize("bench", names, indirect=True)


@on(*RIGS)
def test_all_axes_are_estimated_at_once(bench: Bench) -> None:
    bench.daemon.call("start")
    bench.check_estimates()


@on("seat")
def test_a_fault_of_one_axis_leaves_the_other_going(bench: Bench) -> None:
    assert bench.states() == ("exciting", "exciting")
    bench.throw("roll")
    bench.wait_states("exciting", "fault")
    bench.daemon.call("reset", axis="roll")
    bench.wait_states("exciting", "idle")
    bench.daemon.call("start", axis="roll")
    bench.wait_states("exciting", "exciting")


@on("tail")
def test_a_fault_of_one_axis_stops_both(bench: Bench) -> None:
    assert bench.states() == ("exciting", "exciting")
    bench.throw("rudder")
    bench.wait_states("fault", "fault")
    until("neutral", lambda: bench.voltages() == [0.0, 0.0])
    bench.put_back("stabilator")
    bench.daemon.call("reset")
    bench.wait_states("idle", "idle")
    bench.daemon.call("start")
    bench.wait_states("exciting", "exciting")


@on("servo")
def test_gain_and_speed_follow_pressure_and_reference(bench: Bench) -> None:
    bench.rig.call("constant", channel="Supply.pressure", value=5.0e6)
    until("the pressure", lambda: bench.daemon.call("get")["estimate"]["ps"] == 5.0e6)
    bench.daemon.call("set", reference=16.0)
    until("the speed", lambda: abs(bench.good()["motor"][-1]["mean_speed"] - 16.0) < 0.5)
    newest = bench.check_estimates()["motor"][-1]
    assert newest["K_L"] == pytest.approx(bench.rig.call("truth")["motor"]["K_L"], rel=1e-3)


@on(*RIGS)
def test_the_emergency_stop_stops_all(bench: Bench) -> None:
    bench.rig.call("constant", channel=bench.enable, value=0.0)
    bench.wait_states(*["fault"] * len(bench.axes))
    until("neutral", lambda: not any(bench.voltages()))
