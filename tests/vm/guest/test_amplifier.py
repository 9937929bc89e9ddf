"""A rig by somebody else's DBC, in a process of its own: measured right, its faults told as what they are."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import pytest

from tests.peers import Program, Rpc, port_open, until

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).parent
PORT = 7600
WANTED = 15
"""Estimates of which the median is taken."""


class Rig:
    """The amplifier and the daemon."""

    def __init__(self, amplifier: subprocess.Popen[str], daemon: Rpc) -> None:
        self.amplifier = amplifier
        self.daemon = daemon

    def say(self, fault: str) -> None:
        """What the amplifier does wrong from now on; "" for nothing."""
        assert self.amplifier.stdin is not None
        self.amplifier.stdin.write(fault + "\n")
        self.amplifier.stdin.flush()

    def counters(self) -> dict[str, int]:
        counters: dict[str, int] = self.daemon.call("status")["health"]["counters"]
        return counters

    def excite(self) -> None:
        self.daemon.call("start")
        until("the relay", lambda: self.daemon.call("get", axis="motor")["state"] in ("exciting", "fault"))
        axis = self.daemon.call("get", axis="motor")
        assert axis["state"] == "exciting", axis["fault"]

    def recover(self) -> None:
        """No fault, no excitation, in the middle."""
        self.say("")
        until("idle", self._idle)
        self.say("centre")
        self.daemon.wait_for_centre("motor")
        self.daemon.heard.clear()

    def _idle(self) -> bool:
        state = self.daemon.call("get", axis="motor")["state"]
        if state != "idle":
            self.daemon.call("reset" if state == "fault" else "stop")
        return bool(state == "idle")


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    command = [sys.executable, str(HERE / "amplifier.py"), "vcan0"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, text=True) as amplifier:
        program = Program(tmp_path_factory.mktemp("daemon") / "log", "run", HERE / "amplifier.yaml")
        try:
            until("the port", lambda: port_open(PORT) or program.process.poll() is not None)
            daemon = Rpc(PORT)
            until("the loop", lambda: daemon.call("status")["health"]["ticks"])
            daemon.call("subscribe", topics=["event"])
            yield Rig(amplifier, daemon)
            daemon.close()
        finally:
            program.stop()
            amplifier.kill()
            print(program.said())


@pytest.fixture
def rig(running: Rig) -> Iterator[Rig]:
    running.recover()
    yield running
    running.recover()


def test_it_is_measured_right(rig: Rig) -> None:
    rig.excite()
    number = rig.daemon.call("subscribe", topics=["estimate"])["subscription"]
    found = [
        rig.daemon.wait_for("an ok estimate", lambda m: m["params"].get("quality") == "ok")["params"]
        for _ in range(WANTED)
    ]
    rig.daemon.call("unsubscribe", subscription=number)
    assert median(each["omega_n"] for each in found) == pytest.approx(20.0, rel=0.03)
    assert median(each["zeta"] for each in found) == pytest.approx(0.3, rel=0.06)
    counters = rig.counters()
    names = (
        "lost",
        "repeated",
        "reordered",
        "garbage",
        "counter_restarts",
        "foreign_commands",
        "wrong_length",
    )
    assert {name: counters[name] for name in names if counters[name]} == {}


def test_a_counter_that_stands_still_is_told_as_one(rig: Rig) -> None:
    rig.excite()
    rig.say("still")
    warning = rig.daemon.event(event="warning", code="repeated_frames")
    assert "PosFb" in warning["why"]
    assert "same Alive as one before" in warning["why"]
    fault = rig.daemon.event(event="fault")
    assert fault["code"] in ("stale_sample", "estop", "silent")
    assert "the counter Alive stands still at" in fault["why"]


def test_a_sign_that_flips_is_told_as_one(rig: Rig) -> None:
    rig.daemon.call("set", axis="motor", e_a=0.4)
    rig.excite()
    rig.say("flip")
    fault = rig.daemon.event(event="fault")
    rig.daemon.call("set", axis="motor", e_a=0.1)
    assert fault["code"] in ("speed", "amplitude", "amplitude_growth", "travel")
    if fault["code"] == "speed":  # it depends on where the load was just then
        assert "its sign may have flipped" in fault["why"]


def test_frames_in_the_wrong_order_are_reordered_and_not_lost(rig: Rig) -> None:
    before = rig.counters()
    rig.say("swap")
    until("some of them", lambda: rig.counters()["reordered"] > before["reordered"] + 40)
    after = rig.counters()
    assert (after["lost"], after["garbage"]) == (before["lost"], before["garbage"])


def test_garbage_is_garbage_and_moves_nothing(rig: Rig) -> None:
    before = rig.counters()
    rig.excite()
    rig.say("garbage")
    until("some of it", lambda: rig.counters()["garbage"] > before["garbage"] + 40)
    axis = rig.daemon.call("get", axis="motor")
    assert axis["state"] == "exciting", axis["fault"]  # 3 rad would be outside the travel
    assert rig.counters()["lost"] == before["lost"]
    assert rig.daemon.event(event="warning", code="garbage_frames")
