"""The CAN driver on a bus that fails on command: the unit tests' test bench."""

from __future__ import annotations

import errno
import socket
from pathlib import Path
from typing import TYPE_CHECKING

import can

import drivers.can_link
from drivers.can import CanDriver
from drivers.can_codec import CanCodec
from drivers.can_config import CanOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import pytest

CONFIGS = Path(__file__).parents[2] / "configs"
ENCODER, VALVE = 257, 513


def options(directory: Path = CONFIGS, **changes: object) -> CanOptions:
    section = {"kind": "can", "interface": "virtual", "channel": "can0", "dbc": "motor.dbc", **changes}
    return CanOptions.model_validate(section, context={"directory": directory})


CODEC = CanCodec(options())


class Clock:
    """Time that stands until it is moved."""

    def __init__(self) -> None:
        self.t = 100.0

    def __call__(self) -> float:
        return self.t


class FakeBus:
    """A bus without a kernel: it echoes, and fails as told."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.sent: list[can.Message] = []
        self.incoming: list[can.Message | Exception] = []
        self.send_error: Exception | None = None
        self.echo = True
        self.closed = False

    def send(self, message: can.Message) -> None:
        if self.send_error is not None:
            raise self.send_error
        copy = can.Message(
            arbitration_id=message.arbitration_id,
            is_extended_id=message.is_extended_id,
            data=message.data,
            is_rx=False,
        )
        self.sent.append(copy)
        if self.echo:
            self.incoming.append(copy)

    def recv(self, timeout: float) -> can.Message | None:
        if not self.incoming:
            self.clock.t += timeout
            return None
        item = self.incoming.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def shutdown(self) -> None:
        self.closed = True

    def commands(self) -> list[tuple[float, int]]:
        """Voltage and counter of each command frame that left."""
        frames = [CODEC.decode(VALVE, False, m.data) for m in self.sent if m.arbitration_id == VALVE]
        return [(frame.values["voltage"], frame.counter or 0) for frame in frames]


class Rig:
    """A driver with its fake bus and clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **changes: object) -> None:
        self.clock = Clock()
        self.buses: list[FakeBus] = []
        self.asked: list[dict[str, object]] = []
        self.open_error: Exception | None = None
        self.attempts = 0
        monkeypatch.setattr(drivers.can_link.can, "Bus", self._open)
        monkeypatch.setattr(socket, "if_nametoindex", lambda name: 1)
        self.driver = CanDriver(options(**{"interface": "socketcan", **changes}), self.clock)
        self.driver.open(["Encoder.angle", "Encoder.run_enable"], ["Valve.voltage"])
        self.driver.start()
        self.driver._stamps._realtime = lambda: self.clock.t + 1e9
        self.driver._stamps._offset = self.driver._stamps._offset_before = 1e9

    def _open(self, **asked: object) -> FakeBus:
        self.attempts += 1
        if self.open_error is not None:
            raise self.open_error
        self.asked.append(asked)
        self.buses.append(FakeBus(self.clock))
        return self.buses[-1]

    @property
    def bus(self) -> FakeBus:
        return self.buses[-1]

    def encoder(self, angle: float, counter: int, at: float | None = None) -> None:
        """A sensor frame arrives, stamped now."""
        data = CODEC.encode("Encoder", {"angle": angle, "run_enable": 1}, counter)
        self.arrive(ENCODER, data, at)

    def arrive(self, frame_id: int, data: bytes, at: float | None = None, **flags: bool) -> None:
        stamp = 1e9 + (self.clock.t if at is None else at)
        flags = {"is_extended_id": False, **flags}
        self.bus.incoming.append(can.Message(arbitration_id=frame_id, data=data, timestamp=stamp, **flags))

    def error_frame(self, classes: int, controller: int = 0) -> None:
        self.arrive(classes, bytes([0, controller, 0, 0, 0, 0, 0, 0]), is_error_frame=True)

    def tick(self, volts: float | None = None) -> float:
        """One period passes, then read and write (or neutral)."""
        self.clock.t += 0.001
        self.driver.read(self.clock.t)
        if volts is None:
            return self.driver.neutral(self.clock.t)
        return self.driver.write(self.clock.t, [volts])

    def count(self, name: str) -> int:
        return self.driver.counters[self.driver.counter_names.index(name)]

    def angle(self) -> float:
        return self.driver.read(self.clock.t)[0].value


def rigs(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    """What makes rigs, and closes them in the end."""
    made: list[Rig] = []

    def make(**changes: object) -> Rig:
        made.append(Rig(monkeypatch, **changes))
        return made[-1]

    yield make
    for rig in made:
        rig.driver.close()


def down() -> can.CanOperationError:
    return can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
