"""An amplifier with its position sensor, by its maker's DBC: 29-bit identifiers, Motorola signals.

It shares no line with the daemon or its simulated rig. A line on its input makes it misbehave.
"""

from __future__ import annotations

import math
import os
import select
import socket
import struct
import sys
import time

FEEDBACK, COMMAND = 0x18FF0101, 0x18FF0201
EFF = 0x80000000
PERIOD = 0.01
K_L, OMEGA_N, ZETA = 17.0, 20.0, 0.3
"""The truth: rad/s per volt, rad/s, 1."""
WATCHDOG = 0.25
STEP = 5e-4
"""Of the integration [s]."""


class Amplifier:
    """Both directions and the plant.

    Attributes:
        fault: What it does wrong: `still` (the counter stands), `flip` (the sign), `swap` (frames in pairs
            come in the wrong order), `garbage` (before each fifth frame comes a wild one).
    """

    def __init__(self, channel: str) -> None:
        self.bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        only = struct.pack("=II", COMMAND | EFF, EFF | 0x1FFFFFFF)
        self.bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, only)
        self.bus.bind((channel,))
        self.fault = ""
        self.volts = self.position = self.speed = 0.0
        self.acceleration = 0.0
        self.t = time.monotonic()
        self.alive = 0
        self.heard = 0.0
        self.held: bytes | None = None

    def hear(self) -> None:
        """Take the commands that came: 16 bits, most significant first, 0.5 mV each."""
        while select.select([self.bus], [], [], 0)[0]:
            frame = self.bus.recv(16)
            (raw,) = struct.unpack_from(">h", frame, 8)
            self.volts, self.heard = raw * 0.0005, time.monotonic()
        if time.monotonic() - self.heard > WATCHDOG:
            self.volts = 0.0

    def move(self, until: float) -> None:
        """G_L(s)/s up to a time [s], under the command so far."""
        steps = max(1, math.ceil((until - self.t) / STEP))
        step, self.t = (until - self.t) / steps, until
        for _ in range(steps):
            pull = OMEGA_N**2 * (K_L * self.volts - self.speed) - 2.0 * ZETA * OMEGA_N * self.acceleration
            self.acceleration += pull * step
            self.speed += self.acceleration * step
            self.position += self.speed * step

    def obey(self, line: str) -> None:
        """A fault, or `centre`: the load stands in the middle."""
        self.fault = "" if line == "centre" else line
        if line == "centre":
            self.position = self.speed = self.acceleration = 0.0

    def tell(self) -> None:
        """Send the position: 24 bits in steps of 1e-6 rad, a counter, and the run bit."""
        if self.fault != "still":
            self.alive = (self.alive + 1) % 256
        sign = -1.0 if self.fault == "flip" else 1.0
        frame = self.frame(sign * self.position, self.alive)
        if self.fault == "garbage" and self.alive % 5 == 0:
            self.bus.send(self.frame(3.0, (self.alive + 77) % 256))
        if self.fault == "swap" and self.held is None:
            self.held = frame
            return
        self.bus.send(frame)
        if self.held is not None:
            self.bus.send(self.held)
            self.held = None

    def frame(self, position: float, counter: int) -> bytes:
        """As the kernel takes it."""
        raw = max(-(1 << 23), min((1 << 23) - 1, round(position * 1e6)))
        data = struct.pack(">i", raw << 8)[:3] + bytes([counter, 0x80, 0, 0, 0])
        return struct.pack("=IB3x8s", FEEDBACK | EFF, 8, data)


def main() -> None:
    amplifier = Amplifier(sys.argv[1])
    due = time.monotonic()
    while True:
        wake = [sys.stdin, amplifier.bus]
        ready = select.select(wake, [], [], max(0.0, due - time.monotonic()))[0]
        amplifier.move(time.monotonic())
        amplifier.hear()
        if sys.stdin in ready:
            lines = os.read(sys.stdin.fileno(), 4096).decode()
            if not lines:
                return
            for line in lines.split("\n")[:-1]:
                amplifier.obey(line)
        if time.monotonic() >= due:
            due = max(due + PERIOD, time.monotonic())
            amplifier.tell()


if __name__ == "__main__":
    main()
