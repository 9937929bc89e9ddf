"""The simulated rig on the other end of a serial line, as a process of its own: `seod rig CONFIG`.

Without a real port of its own it makes a pseudo terminal and puts a link to it where the rig file's port is.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
import tty
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import serial

from drivers.base import DriverError
from drivers.serial_arrivals import Arrivals
from drivers.serial_codec import ascii_numbers, numbers_of
from sim.faults import FaultLine, Frame
from sim.rig_end import RigEnd, compile_plant, serve
from sim.serial_board import COUNTS, Board

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers.serial_config import SerialOptions
    from sim.config import SimulationConfig

CHUNK = 4096
SAMPLE = "sample"
"""Name of the frames that the board sends, for faults."""


class Port:
    """The rig's end of the line: a pseudo terminal behind a link, or a real port.

    Attributes:
        fd: To read and write; -1 while it is unplugged.

    Args:
        options: Of the daemon's driver.
        own: The rig's own real port; none: a pseudo terminal.
    """

    def __init__(self, options: SerialOptions, own: str | None) -> None:
        self.fd = -1
        self._link = Path(options.port)
        self._baud = options.baud
        self._own = own
        self._slave = -1
        self._arrivals: Arrivals | None = None
        self._real: serial.Serial | None = None

    def open(self) -> None:
        """Take it.

        Raises:
            DriverError: It cannot be had.
        """
        try:
            if self._own is None:
                self._make()
            else:
                self._real = serial.Serial(self._own, self._baud, timeout=0, write_timeout=0, exclusive=True)
                self.fd = self._real.fileno()
        except OSError as error:
            raise DriverError(f"cannot open {self._own or self._link}: {error}") from error
        self._arrivals = Arrivals(self.fd)

    def _make(self) -> None:
        if self._link.exists() and not self._link.is_symlink():
            raise DriverError(f"{self._link} is a real port: give the rig its own by --port")
        self.fd, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.fd, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(self._slave))

    def close(self) -> None:
        """Give it back; may be called twice."""
        if self._arrivals is not None:
            self._arrivals.close()
            self._arrivals = None
        if self._real is not None:
            self._real.close()
            self._real = None
        elif self.fd >= 0:
            self._link.unlink(missing_ok=True)
            os.close(self.fd)
            os.close(self._slave)
        self.fd = -1

    def wait(self, timeout: float) -> bool:
        """Whether something comes within `timeout` [s]; a port that is unplugged only waits."""
        if self._arrivals is None:
            time.sleep(timeout)
            return False
        return self._arrivals.wait(timeout)

    def read(self) -> bytes:
        """All that came."""
        if self._arrivals is None or not self._arrivals.taken():
            return b""
        try:
            return os.read(self.fd, CHUNK)
        except OSError:  # nothing there, or nobody has the other end
            return b""

    def write(self, data: bytes) -> bool:
        """Send all of it; False if there was no room."""
        with contextlib.suppress(BlockingIOError):
            return os.write(self.fd, data) == len(data)
        return False


class SerialRig(RigEnd):
    """The rig's end of the line.

    Args:
        options: Of the daemon's driver; the rig takes the other side.
        simulation: What is simulated.
        own: The rig's own real port; none: a pseudo terminal.
        clock: CLOCK_MONOTONIC [s].

    Raises:
        DriverError: A channel of the simulation is not in the rig file's blocks, or goes the wrong way.
    """

    message_names = (SAMPLE,)

    def __init__(
        self,
        options: SerialOptions,
        simulation: SimulationConfig,
        own: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(simulation, COUNTS, clock)
        self._options = options
        self._check()
        self._sensors = [self.rig.sensor(field.name) for field in options.inputs]
        self._lossy = [field.name for field in options.inputs]
        self._numbers = numbers_of if options.format == "binary" else ascii_numbers
        board = simulation.board
        self.board = Board(
            options,
            simulation.sensor_rate_hz,
            self._take,
            board.drift,
            board.clock_start,
            clock(),
            self.counts,
        )
        self.faults = FaultLine(Random(simulation.seed), ())  # noqa: S311
        self.extra_methods = {"unplug": self._unplug}
        self._port = Port(options, own)
        self._plug_at = math.inf
        self._readings: list[float] = []

    def _check(self) -> None:
        o = self._options
        for block, names in (("inputs", self.rig.sensor_channels()), ("outputs", self.rig.inputs())):
            there = [field.name for field in getattr(o, block)]
            for name in names:
                if name not in there:
                    raise DriverError(f"driver.{block} has no {name!r}; there are {', '.join(there)}")
        unfed = [field.name for field in o.inputs if field.name not in self.rig.sensor_channels()]
        if unfed:
            raise DriverError(f"nothing in `simulation:` feeds {', '.join(unfed)}")

    def _take(self, t: float, numbers: Sequence[float]) -> None:
        values = {
            field.name: number * field.scale + field.offset
            for field, number in zip(self._options.outputs, numbers, strict=True)
        }
        self.rig.apply(t, values)

    def open(self) -> None:
        """Take the port, or make it.

        Raises:
            DriverError: It cannot be had.
        """
        self._port.open()
        self._begin_turns()

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

    def _receive(self, now: float, until: float) -> float:
        if now >= self._plug_at:
            self._plug_at = math.inf
            self._port.open()
        if self._port.wait(self._patience(now, until)):
            data = self._port.read()
            self._answer(self.board.receive(data, self._clock()))
        return self._clock()

    def _answer(self, data: bytes) -> None:
        if data:
            self._port.write(data)

    def _measure(self, t: float) -> None:
        if not self.board.sampling:
            return
        if not (self.faults.hits("freeze", SAMPLE) and self._readings):
            self._readings = self._numbers(self._options.inputs, [read(t) for read in self._sensors])
        data = self.board.sample(self._readings, t)
        if not any(self.rig.missing(name) for name in self._lossy):
            self.faults.put(t, Frame(SAMPLE, 0, False, data))

    def _put_on_line(self, frame: Frame) -> None:
        if self._port.fd >= 0 and not self._port.write(frame.data):
            self.board.dropped()

    def _unplug(self, params: dict[str, Any]) -> object:
        """`seconds`: the port vanishes; it comes back with a board that had no power."""
        seconds = params.get("seconds", 1.0)
        if not isinstance(seconds, int | float) or not 0.0 < seconds <= 60.0:
            raise ValueError("unplug needs seconds, above 0 and at most 60")
        self._port.close()
        self.board.sampling = False
        self.rig.apply(self._clock(), dict.fromkeys(self.rig.inputs(), 0.0))
        self._plug_at = self._clock() + seconds
        return {"seconds": seconds}

    def state(self) -> dict[str, object]:
        """What goes on at this end of the line."""
        return {"started": self.board.sampling, "trouble": "", "counts": self.counts, "link": {}}


def run(
    options: SerialOptions,
    simulation: SimulationConfig,
    control_port: int | None = None,
    duration: float | None = None,
    own: str | None = None,
) -> None:
    """Be the rig until SIGTERM or SIGINT; one JSON line on stdout tells when it is ready.

    Args:
        options: The rig file's driver section.
        simulation: Its simulation section.
        control_port: Instead of the section's; 0 for any free one.
        duration: End by itself after this [s].
        own: The rig's own real port; none: a pseudo terminal at the rig file's port.

    Raises:
        DriverError: The port cannot be had, or the simulation does not fit the blocks.
        OSError: The control port is taken.
    """
    compile_plant(simulation)
    port = simulation.control_port if control_port is None else control_port
    serve(SerialRig(options, simulation, own), port, duration, {"port": own or options.port})
