"""A board on a pseudo terminal, in a thread, that samples only when the test says so."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
import threading
import time
import tty
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from drivers import driver_class
from drivers.serial_config import SerialOptions
from drivers.serial_counters import COMMANDS, COUNTER_NAMES
from sim.serial_board import COUNTS, Board

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers.base import Driver

PATIENCE_S = 20.0

SECTION: dict[str, Any] = {
    "kind": "serial",
    "usb": True,
    "inputs": [
        {"name": "angle", "type": "int32", "scale": 1e-5, "unit": "rad"},
        {"name": "enable", "type": "uint8"},
    ],
    "outputs": [{"name": "valve", "type": "int16", "scale": 1e-3, "unit": "V"}],
}


def make_options(port: object = "/dev/null", **changes: object) -> SerialOptions:
    return SerialOptions.model_validate({**SECTION, "port": str(port), **changes})


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "never came"
        time.sleep(0.001)


class BoardPeer:
    """The board's end of a pseudo terminal behind a link.

    Attributes:
        values: Outputs of each command that came, in units.
        raw: All bytes that came.
        board: What answers; None: a dead board.
        deaf: It hears nothing, and acknowledges nothing.
    """

    def __init__(self, link: Path, options: SerialOptions | None = None) -> None:
        self.link = link
        self.options = options or make_options(link)
        self.values: list[list[float]] = []
        self.raw = b""
        self.counts = dict.fromkeys(COUNTS, 0)
        self.board = self.new_board()
        self.deaf = False
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self.plug_in()

    def new_board(self, **changes: Any) -> Board:
        start = {"drift": 0.0, "clock_start": (1 << 32) - 1000, "t": time.monotonic(), **changes}
        return Board(self.options, 2000.0, self._take, counts=self.counts, **start)

    def _take(self, t: float, numbers: Sequence[float]) -> None:
        outputs = self.options.outputs
        self.values.append(
            [x * field.scale + field.offset for x, field in zip(numbers, outputs, strict=True)]
        )

    def plug_in(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self.slave))
        self._ended.clear()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def unplug(self) -> None:
        if self._ended.is_set():
            return
        self._ended.set()
        self._thread.join()
        self.link.unlink()
        os.close(self.master)
        os.close(self.slave)

    close = unplug

    def _serve(self) -> None:
        while not self._ended.is_set():
            if select.select([self.master], [], [], 0.002)[0]:
                data = os.read(self.master, 4096)
                with self._lock:
                    self.raw += data
                    if not self.deaf:
                        os.write(self.master, self.board.receive(data, time.monotonic()))

    def frame(self, angle: float, t: float | None = None) -> bytes:
        """The next sample of this reading, taken at `t` [s], now if left out."""
        with self._lock:
            self.board.sampling = True
            return self.board.sample([round(angle / 1e-5), 1.0], time.monotonic() if t is None else t)

    def send(self, data: bytes) -> None:
        """Bytes on their way; they can be read when this returns (the kernel takes its time)."""
        waiting = self._readable()
        os.write(self.master, data)
        until(lambda: self._readable() == waiting + len(data))

    def _readable(self) -> int:
        return int(struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, bytes(4)))[0])

    def sample(self, angle: float) -> None:
        self.send(self.frame(angle))


class SerialBench:
    """The `serial` driver on a pseudo terminal, for the contract."""

    inputs = ("angle", "enable")
    outputs = ("valve",)
    simulated = False
    silent = True

    def __init__(self, clock: Callable[[], float], **changes: object) -> None:
        self.folder = TemporaryDirectory()
        link = Path(self.folder.name) / "board"
        self.options = make_options(link, **changes)
        self.peer = BoardPeer(link, self.options)
        self.driver: Driver = driver_class("serial")(self.options, clock)
        self._given = 0

    def sample(self, value: float) -> None:
        self.peer.sample(value)

    def commands(self) -> list[list[float]]:
        until(lambda: self.peer.counts["commands"] >= self.driver.counters[COMMANDS])
        new = self.peer.values[self._given :]
        self._given += len(new)
        return new

    def cut(self) -> bool:
        self.peer.unplug()
        return True

    def close(self) -> None:
        self.peer.close()
        self.folder.cleanup()

    def count(self, name: str) -> int:
        return self.driver.counters[COUNTER_NAMES.index(name)]

    def run(self) -> None:
        self.driver.open(self.inputs, self.outputs)
        self.driver.start()

    def read(self) -> tuple[float, float]:
        """Value and time of the first input after reading what has come."""
        sample = self.driver.read(time.monotonic())[0]
        return sample.value, sample.t
