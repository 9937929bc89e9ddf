"""A board that speaks the ASCII form of docs/serial.md and moves a motor, as a process.

    python tests/text_board.py LINK [--jitter 1.5e-3] [--back-at 3 --back-by 2] ...

Standard library only, and no line shared with the daemon; the motor (Eq. 1 and its integral) is exact
between commands.
"""

from __future__ import annotations

import argparse
import cmath
import contextlib
import os
import random
import select
import signal
import time
import tty
from pathlib import Path

WATCHDOG_S = 0.5


class Motor:
    """Angle under a voltage that is held, by the sum of its modes."""

    def __init__(self, K_L: float, omega_n: float, zeta: float) -> None:
        self.gain, self.volts, self.steady = K_L, 0.0, 0.0
        pole = omega_n * complex(-zeta, (1.0 - zeta * zeta) ** 0.5)
        self.pole, self.mode = pole, 0j  # speed less steady speed: the real part of `mode`
        self.held = 0.0
        self.share = -1.0 - 1j * pole.real / pole.imag  # of a step in the steady speed
        self.t = time.monotonic()

    def angle(self, t: float) -> float:
        h, self.t = t - self.t, t
        grown = self.mode * cmath.exp(self.pole * h)
        self.held += self.steady * h + ((grown - self.mode) / self.pole).real
        self.mode = grown
        return self.held

    def command(self, volts: float, t: float) -> None:
        self.angle(t)
        step = self.gain * (volts - self.volts)
        self.mode += step * self.share  # the speed and its rate do not jump
        self.volts, self.steady = volts, self.steady + step


class Board:
    """The line and the clock."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.motor = Motor(17.0, options.omega_n, options.zeta)
        self.chance = random.Random(options.seed)
        self.line, self.other = os.openpty()
        tty.setraw(self.other)
        os.set_blocking(self.line, False)
        self.begun, self.started = time.monotonic(), float("inf")
        self.sampling, self.sequence, self.rest = False, 0, b""
        self.ack, self.commanded = 0, None

    def clock_s(self, t: float) -> float:
        back = self.options.back_by if t - self.started > self.options.back_at else 0.0
        return t - self.begun + 5.0 - back

    def listen(self, data: bytes, t: float) -> None:
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            word, *values = line.split(b"*")[0].split() or [b""]
            if word == b"start" and not self.options.silent:
                self.sampling, self.started = True, min(self.started, t)
            elif word == b"ask":
                self.sampling = False
            elif word == b"u" and self.sampling:
                self.ack, self.commanded = int(values[0]), t
                self.motor.command(float(values[1]), t)

    def sample(self, t: float) -> bytes:
        if self.commanded is not None and t - self.commanded > WATCHDOG_S:
            self.motor.command(0.0, t)
            self.commanded = None
        age = 65535 if self.commanded is None else min(round((t - self.commanded) * 1e6), 65535)
        told = self.clock_s(t) + self.chance.gauss(0.0, self.options.jitter)
        fields = (round(told * 1e6) % (1 << 32), self.sequence, self.ack, age)
        self.sequence = (self.sequence + 1) % 256
        angle = self.motor.angle(t) + self.chance.gauss(0.0, self.options.noise)
        return b"%d,%d,%d,%d," % fields + f"{angle:.6f},1\n".encode()

    def run(self, period: float) -> None:
        due = time.monotonic()
        while True:
            ready = select.select([self.line], [], [], max(due - time.monotonic(), 0.0))[0]
            t = time.monotonic()
            if ready:
                with contextlib.suppress(OSError):
                    self.listen(os.read(self.line, 4096), t)
            if t >= due:
                due = max(due + period, t - 10.0 * period)
                if self.sampling:
                    with contextlib.suppress(OSError):
                        os.write(self.line, self.sample(t))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("link", type=Path)
    parser.add_argument("--omega-n", type=float, default=117.0)
    parser.add_argument("--zeta", type=float, default=0.21)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--noise", type=float, default=1e-3, help="standard deviation of its readings [rad]")
    parser.add_argument("--jitter", type=float, default=0.0, help="standard deviation of its stamps [s]")
    parser.add_argument("--back-at", type=float, default=float("inf"), help="after START [s] its clock steps")
    parser.add_argument("--back-by", type=float, default=0.0, help="back by so much [s]")
    parser.add_argument("--silent", action="store_true", help="it never samples")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    board = Board(options)
    options.link.symlink_to(os.ttyname(board.other))
    print("ready", flush=True)
    board.run(1.0 / options.rate)


if __name__ == "__main__":
    main()
