"""What every simulated rig at the other end of a line does: commands in, sensors out in their turns."""

from __future__ import annotations

import math
import sys
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from sim.back_door import BackDoor
from sim.cache import is_plant_compiled
from sim.control import ControlServer
from sim.process import RigProcess
from sim.rig import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sim.config import SimulationConfig
    from sim.control import Methods
    from sim.faults import FaultLine, Frame


class RigEnd(ABC):
    """The rig's end of a line; time is handed in.

    Attributes:
        rig: What is simulated.
        counts: What happened at this end.
        faults: What its sensor frames pass.
        message_names: Of the frames that it sends, as faults name them.
        extra_methods: Of the control port, besides the back door's.

    Args:
        simulation: What is simulated.
        counts: Names of the counters; `late_sensors` is added.
        clock: CLOCK_MONOTONIC [s].
    """

    faults: FaultLine
    message_names: Sequence[str] = ()

    def __init__(
        self, simulation: SimulationConfig, counts: Sequence[str], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.rig = SimulatedRig(simulation, clock())
        self.counts = dict.fromkeys((*counts, "late_sensors"), 0)
        self.extra_methods: Methods = {}
        self._clock = clock
        self._period = 1.0 / simulation.sensor_rate_hz
        self._next_turn = math.inf

    @abstractmethod
    def open(self) -> None:
        """Take the line.

        Raises:
            DriverError: It cannot be had.
        """

    @abstractmethod
    def close(self) -> None:
        """Give the line back."""

    @abstractmethod
    def state(self) -> dict[str, object]:
        """What goes on at this end of the line."""

    @abstractmethod
    def _receive(self, now: float, until: float) -> float:
        """Take commands until something is due, `until` [s] at most; returns the time then."""

    @abstractmethod
    def _measure(self, t: float) -> None:
        """A turn of the sensors at `t` [s]: put their frames on the fault line."""

    @abstractmethod
    def _put_on_line(self, frame: Frame) -> None:
        """Send one frame now."""

    def step(self, now: float, longest: float) -> float:
        """Take commands until the sensors' turn, for `longest` [s] at most, then send what is due.

        Args:
            now: The time at which it begins [s].
            longest: How long it may take [s].

        Returns:
            The time at which it ended [s]: looking at the clock is what it does most, so it hands it on.
        """
        now = self._receive(now, now + longest)
        if now >= self._next_turn:
            self._measure(now)
            self._plan(now)
        if self.faults.next_due() <= now:
            for frame in self.faults.take(now):
                self._put_on_line(frame)
            now = self._clock()
        return now

    def _begin_turns(self) -> None:
        if math.isinf(self._next_turn):
            self._next_turn = self._clock() + self._period

    def _plan(self, now: float) -> None:
        """The next turn; those that were missed are left out, not made up."""
        self._next_turn += self._period
        if now >= self._next_turn:
            self.counts["late_sensors"] += 1
            self._next_turn += ((now - self._next_turn) // self._period + 1.0) * self._period

    def _patience(self, now: float, until: float) -> float:
        """How long nothing is due [s]."""
        return max(0.0, min(until, self._next_turn, self.faults.next_due()) - now)


def serve(end: RigEnd, control_port: int, duration: float | None, facts: dict[str, object]) -> None:
    """Be the rig until SIGTERM or SIGINT; one JSON line on stdout tells when it is ready.

    Args:
        end: The rig.
        control_port: 0 for any free one.
        duration: End by itself after this [s].
        facts: Told in that line, besides the control port.

    Raises:
        DriverError: The line cannot be had.
        OSError: The control port is taken.
    """
    door = BackDoor(end.rig, end.faults, end.message_names, end.state, time.monotonic)
    with RigProcess(duration) as process:
        server = ControlServer(control_port, {**door.methods, **end.extra_methods})
        try:
            end.open()
            process.ready({"control_port": server.port, **facts})
            process.repeat(end.step, server.poll)
        finally:
            end.close()
            server.close()


def compile_plant(simulation: SimulationConfig) -> None:
    """Tell whoever waits that the plants are compiled, if they have to be."""
    if not is_plant_compiled(simulation.kinds):
        print("compiling the plant (once)", file=sys.stderr, flush=True)  # noqa: T201 - for whoever waits
