"""A driver from another package: the simulated rig, with a door through which its constants can be moved.

Its simulated time passes a few times as fast as real time, so that a client can follow.
"""

from __future__ import annotations

import json
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

from drivers.virtual import VirtualDriver, VirtualOptions

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.base import Sample

ENTRY_POINTS = "[seod.drivers]\nvirtual-with-a-door = tests.door:DoorDriver\n"
TICK_S = 1e-4
"""What each tick takes at least, and really."""


class DoorOptions(VirtualOptions):
    kind: Literal["virtual-with-a-door"]  # type: ignore[assignment] # instead of the parent's
    door: int
    """UDP port on loopback: [channel, value] as JSON moves a constant, from the next tick on."""


class DoorDriver(VirtualDriver):
    """Reads its door before it reads the plant."""

    Options = DoorOptions
    door: socket.socket | None = None

    def start(self) -> None:
        super().start()
        self.door = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.door.bind(("127.0.0.1", self.options.door))
        self.door.setblocking(False)

    def read(self, t: float) -> list[Sample]:
        assert self.door is not None
        assert self.rig is not None
        with suppress(BlockingIOError):  # nearly always nobody knocks
            self.rig.set_constant(t, *json.loads(self.door.recv(200)))
        time.sleep(TICK_S)
        return super().read(t)

    def close(self) -> None:
        if self.door is not None:
            self.door.close()
        super().close()


def install(folder: Path) -> None:
    """Be found where `folder` is on the path, as an installed package is."""
    package = folder / "seod_door-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: seod-door\nVersion: 1\n")
    (package / "entry_points.txt").write_text(ENTRY_POINTS)


def move(port: int, channel: str, value: float) -> None:
    """Have a constant at `value`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as knock:
        knock.sendto(json.dumps([channel, value]).encode(), ("127.0.0.1", port))
