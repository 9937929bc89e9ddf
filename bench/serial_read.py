"""How long a real-time reader of a serial line is held up by the kernel's worker that carries the bytes.

    python bench/serial_read.py [--seconds 20] [--load 13]

A program in C (`bench/stamps.c`) writes eight bytes each 500 us into a pseudo terminal; both it and the
reader run under SCHED_FIFO where they may, the kernel's worker between them does not, and `--load` processes
compute beside it. In turns of half a second the line is read in each of the ways, at a tick each 500 us
(timer) and as the data come (sensor). A pseudo terminal has the same buffers and the same worker as a UART or
a USB adapter. What holds up those who do not read at all is the machine's own.
"""

from __future__ import annotations

import argparse
import array
import contextlib
import fcntl
import gc
import os
import select
import signal
import struct
import subprocess
import tempfile
import termios
import time
import tty
from collections import defaultdict
from pathlib import Path

import numpy as np

from drivers.serial_arrivals import Arrivals

PERIOD_S, TURN_S = 5e-4, 0.5
CHUNK = 65536


class Plain:
    """Read at once; wait by select: as most programs do."""

    def __init__(self, fd: int) -> None:
        self.fd = fd

    def take(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self.fd, CHUNK)
        return b""

    def wait(self, timeout: float) -> None:
        select.select([self.fd], [], [], timeout)

    def close(self) -> None:
        pass


class Asked(Plain):
    """Ask by FIONREAD how much there is, and read only then."""

    def __init__(self, fd: int) -> None:
        super().__init__(fd)
        self.count = array.array("i", [0])

    def take(self) -> bytes:
        fcntl.ioctl(self.fd, termios.FIONREAD, self.count, True)
        return super().take() if self.count[0] else b""


class Told(Plain):
    """Read only when the worker has told that something came: as the driver does."""

    def __init__(self, fd: int) -> None:
        super().__init__(fd)
        self.arrivals = Arrivals(fd)

    def take(self) -> bytes:
        return super().take() if self.arrivals.taken() else b""

    def wait(self, timeout: float) -> None:
        self.arrivals.wait(timeout)

    def close(self) -> None:
        self.arrivals.close()


class Nothing(Plain):
    """Only sleep: what the machine itself holds up."""

    def take(self) -> bytes:
        return b""

    def wait(self, timeout: float) -> None:
        time.sleep(timeout)


WAYS = {"no read at all": Nothing, "read": Plain, "FIONREAD, read": Asked, "epoll, read": Told}


def turn_by_timer(way: Plain) -> tuple[list[float], list[float]]:
    """How long each look took, and how old the data were [s]."""
    held, old = [], []
    due = time.monotonic()
    end = due + TURN_S
    while due < end:
        due += PERIOD_S
        time.sleep(max(due - time.monotonic(), 0.0))
        begun = time.monotonic()
        data = way.take()
        now = time.monotonic()
        held.append(now - begun)
        old += [now - stamp * 1e-9 for (stamp,) in struct.iter_unpack("<Q", data[: len(data) // 8 * 8])]
    return held, old


def turn_by_sensor(way: Plain) -> tuple[list[float], list[float]]:
    """By how much each wait was longer than it should be at most, and how old the data were [s]."""
    held, old = [], []
    now = time.monotonic()
    end = now + TURN_S
    while now < end:
        deadline = now + 2.0 * PERIOD_S
        way.wait(max(deadline - time.monotonic(), 0.0))
        data = way.take()
        now = time.monotonic()
        held.append(max(now - deadline, 0.0))
        old += [now - stamp * 1e-9 for (stamp,) in struct.iter_unpack("<Q", data[: len(data) // 8 * 8])]
    return held, old


TURNS = {"timer": turn_by_timer, "sensor": turn_by_sensor}


@contextlib.contextmanager
def load(count: int):
    """So many processes that do nothing but compute."""
    children = []
    for _ in range(count):
        child = os.fork()
        if not child:
            signal.alarm(600)  # they end by themselves if nobody ends them
            while True:
                sum(range(1000))
        children.append(child)
    try:
        yield
    finally:
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


@contextlib.contextmanager
def line():
    """The descriptor of a pseudo terminal into which stamps are written."""
    with tempfile.TemporaryDirectory() as name:
        program, link = Path(name) / "stamps", Path(name) / "line"
        source = Path(__file__).with_name("stamps.c")
        subprocess.run(["gcc", "-std=c99", "-O2", str(source), "-o", str(program)], check=True)
        peer = subprocess.Popen([program, link], stdout=subprocess.PIPE)
        peer.stdout.readline()
        with contextlib.suppress(OSError):
            os.sched_setscheduler(peer.pid, os.SCHED_FIFO, os.sched_param(40))
        fd = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(fd)
        try:
            yield fd
        finally:
            os.close(fd)
            peer.terminate()
            peer.wait()
            peer.stdout.close()


def measure(fd: int, seconds: float) -> dict[tuple[str, str], list[np.ndarray]]:
    """Of each pace and way: what held it up, and ages of the data [s]."""
    found = defaultdict(lambda: ([], []))
    for _ in range(max(round(seconds / TURN_S / len(WAYS) / len(TURNS)), 1)):
        for pace, turn in TURNS.items():
            for name, kind in WAYS.items():
                way = kind(fd)
                Plain(fd).take()
                held, old = turn(way)
                way.close()
                found[pace, name][0].extend(held)
                found[pace, name][1].extend(old)
    return {key: [np.array(values) for values in both] for key, both in found.items()}


def us(values: np.ndarray) -> str:
    return " ".join(f"{x * 1e6:9.1f}" for x in (*np.percentile(values, [50, 99, 99.9]), values.max()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--load", type=int, default=13)
    options = parser.parse_args()
    with load(options.load), line() as fd:
        policy = "ordinary priority"
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(30))
            policy = "SCHED_FIFO"
        gc.disable()
        found = measure(fd, options.seconds)
    head = " ".join(f"{each:>9}" for each in ("p50", "p99", "p99.9", "max"))
    print(f"[us], {policy}, {options.load} computing processes\n{'held up':<28} {head}")
    for (pace, name), (held, _) in found.items():
        print(f"{pace + ': ' + name:<28} {us(held)}")
    print(f"{'age of the data':<28} {head}")
    for (pace, name), (_, old) in found.items():
        if len(old):
            print(f"{pace + ': ' + name:<28} {us(old)}")


if __name__ == "__main__":
    main()
