"""The guest's bus: listen to it, speak on it, break it. Standard library only."""

from __future__ import annotations

import select
import socket
import struct
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

CONFIG = Path(__file__).with_name("rig.yaml")

COMMAND_ID = 0x201
"""The message `Valve` of configs/motor.dbc: command voltage in its first two bytes, 0.5 mV a bit."""

CAN_ERR_FLAG = 0x20000000
CAN_ERR_CRTL, CAN_ERR_BUSOFF, CAN_ERR_RESTARTED = 0x004, 0x040, 0x100
"""Error messages of linux/can/error.h; `vcan` never makes any, so that the tests send them."""


class Seen(NamedTuple):
    """A command frame on the bus."""

    t: float
    """Kernel timestamp, converted to CLOCK_MONOTONIC [s]."""
    volts: float


class Listener:
    """A third party on the bus that sees every command frame with its kernel timestamp."""

    SO_RCVBUFFORCE, SO_TIMESTAMPNS = 33, 35  # asm-generic/socket.h; not in Python's module

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        only = struct.pack("=II", COMMAND_ID, socket.CAN_SFF_MASK | socket.CAN_EFF_FLAG)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only)
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_TIMESTAMPNS, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_RCVBUFFORCE, 16 << 20)
        self.socket.bind(("vcan0",))
        self.frames: list[Seen] = []

    def read(self) -> list[Seen]:
        """Everything seen so far."""
        offset = time.monotonic() - time.time()
        while select.select([self.socket], [], [], 0)[0]:
            try:
                frame, extra, _, _ = self.socket.recvmsg(72, 64)
            except OSError:  # the interface went down: told once, then it goes on
                continue
            seconds, nanoseconds = struct.unpack("qq", extra[0][2][:16])
            (raw,) = struct.unpack_from("<h", frame, 8)
            self.frames.append(Seen(seconds + nanoseconds * 1e-9 + offset, raw * 0.0005))
        return self.frames

    def close(self) -> None:
        """Stop listening."""
        self.socket.close()


def send_raw(can_id: int, data: bytes) -> None:
    """Put one frame on the bus; with CAN_ERR_FLAG it is an error message as a controller reports it."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind(("vcan0",))
        bus.send(struct.pack("=IB3x8s", can_id, len(data), data))


COMMANDER = f"""
import socket, struct, sys, time
volts, count, pause = float(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
bus.bind(("vcan0",))
for number in range(count):
    data = struct.pack("<hBB", round(volts / 0.0005), number % 16, 0)
    data = data[:3] + bytes([data[0] ^ data[1] ^ data[2]])
    bus.send(struct.pack("=IB3x8s", {COMMAND_ID}, 4, data))
    time.sleep(pause)
"""
"""Another program on this computer, such as `cangen`: the amplifier takes its frames for ours."""


def command(volts: float, count: int = 1, pause_s: float = 0.0) -> None:
    """Have that program send so many commands."""
    subprocess.run([sys.executable, "-c", COMMANDER, str(volts), str(count), str(pause_s)], check=True)


def ip(*arguments: str) -> None:
    """`ip ...`."""
    subprocess.run(["ip", *arguments], check=True)


def tc(*arguments: str) -> None:
    """`tc qdisc ...`."""
    subprocess.run(["tc", "qdisc", *arguments], check=True)


@contextmanager
def slow_bus() -> Iterator[None]:
    """vcan0 carries some 200 frames a second, behind a queue of 10 s; what is in it at the end is lost."""
    tc("add", "dev", "vcan0", "root", "tbf", "rate", "30kbit", "burst", "1kb", "latency", "10s")
    try:
        yield
    finally:
        tc("del", "dev", "vcan0", "root")
