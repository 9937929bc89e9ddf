"""The course of an axis whose mode and time are in the hands of a test."""

from __future__ import annotations

import math
from typing import Any

from seod.config.axis import AxisConfig
from seod.loop.course import Course
from seod.loop.excite import Coast
from seod.loop.two_phase import SecondPhase
from seod.processes.ring import AxisState

ARMED, EXCITING, HOLDING, IDLE, FAULT = (
    AxisState.ARMED,
    AxisState.EXCITING,
    AxisState.HOLDING,
    AxisState.IDLE,
    AxisState.FAULT,
)
SECOND = SecondPhase(0.25, 0.5, 1.0, 3.0, 0.01)


class Hold(Coast):
    """What the mode holds with."""


class FakeMode:
    """Is where it should be when a test says so, and notes what it is asked."""

    quantity = "position"

    def __init__(self, approaches: bool = False) -> None:
        self.approaches = approaches
        self.t_sample = 0.5
        self.there = False
        self.asked = math.nan
        self.holds: list[tuple[float, bool]] = []
        self.relays_on: list[float] = []
        self.starts: list[float] = []

    def hold(self, t: float, rest: bool) -> Hold:
        self.holds.append((t, rest))
        return Hold()

    def arrived(self, t: float) -> bool:
        self.asked = t
        return self.there

    def relay_on(self, t: float) -> None:
        self.relays_on.append(t)

    def start(self, y: float) -> None:
        self.starts.append(y)


AXIS: dict[str, Any] = {
    "sensor": "angle",
    "output": "valve",
    "K_L": 17.0,
    "relay": {"e_a": 0.5},
    "limits": {"output": 2.0, "travel": (-2.0, 2.0), "amplitude": 0.6, "excitation": 8.0},
    "excitation": {"kind": "burst", "entry": 0.25, "duration": 0.5, "pause": 2.0},
}


class Bench:
    """A course with nothing but itself."""

    def __init__(
        self, approaches: bool = False, polarity: dict[str, Any] | None = None, **changes: Any
    ) -> None:
        shown = {"movement": 0.01, "enabled": False, **(polarity or {})}
        self.config = AxisConfig.model_validate({**AXIS, "polarity": shown, **changes})
        self.settings = {"e_a": 0.5, "hysteresis": 0.125, "two_phase": 1.0}
        self.mode = FakeMode(approaches)
        self.told: list[dict[str, Any]] = []
        self.course = Course("motor", self.config, self.settings, self.mode, self.told.append)

    def states(self) -> list[tuple[float, str, str, str]]:
        """What was told of states since the last call: time, from, to, why."""
        changes = [e for e in self.told if e["event"] == "state"]
        assert {e["axis"] for e in changes} <= {"motor"}
        self.told.clear()
        return [(e["t"], e["previous"], e["state"], e["why"]) for e in changes]

    def excited(self) -> Bench:
        """The relay has been on since t = 1."""
        self.course.begin(1.0, None, waiting=False)
        assert self.course.state is EXCITING
        self.told.clear()
        return self

    def holding(self, since: float = 2.0) -> Bench:
        """The axis has held between two bursts since then."""
        self.excited()
        self.course._return(since, "burst over")
        self.told.clear()
        return self


def flags(course: Course) -> tuple[bool, bool, bool]:
    return course.active, course.exciting, course.relay is course.controller
