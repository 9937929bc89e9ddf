"""How long an e-stop of a client takes to neutral on the line, while other clients do their worst.

    python bench/estop.py [--count 1000] [--quick] [--attacks NAME...]

The daemon drives a simulated rig at 2 kHz over a serial line (a pseudo terminal); the rig is a process of its
own, and stamps the first neutral command that it gets. Time is from before the client's `send` to that stamp.
Client and rig run under SCHED_FIFO where the system allows it, for they are what measures. `reply99` is when
99 % of the answers were read. Rows lost are those that the daemon itself counts. On a virtual machine the
host may take the processors away, for 100 ms at a time; Linux counts that. Stops during which it did are
`stolen`, and the goal is judged by the others; `all99.9` and `max` are of all.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import queue
import random
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import estop_attacks
import estop_rig
import numpy as np
import yaml

from seod.client import Client, ClientError
from seod.files.shipped import configs_dir
from seod.latency.machine import read_machine
from seod.processes.realtime import set_fifo

if TYPE_CHECKING:
    from collections.abc import Iterator

GOAL_MS = 20.0
PATIENCE_S = 60.0
START_S = 20.0
LONGEST_S = 240.0
"""Most time for one attack."""
TOKEN = "0123456789abcdef"
PRIORITY = 55
SETTLE_S = 1.5
MOVES_S = 1.0
"""A rig that was started moves within this time, or has been stopped by a fault of its own."""


class Found(NamedTuple):
    """Of one attack: latencies [ms], replies [ms], whether time was stolen, rows that the daemon lost."""

    neutral: np.ndarray
    reply: np.ndarray
    stolen: np.ndarray
    lost: int


def write_config(folder: Path, port: int, token: bool) -> Path:
    """The shipped serial rig, with limits that a crowded computer does not reach."""
    raw = yaml.safe_load((configs_dir() / "serial.yaml").read_text())
    raw["rig"] = f"estop{os.getpid()}"
    raw["driver"]["port"] = str(folder / "board")
    raw["driver"]["watchdog_s"] = raw["simulation"]["watchdog_s"] = 1.0
    raw["loop"]["hang_timeout"] = "1 s"
    raw["axes"]["motor"]["polarity"]["enabled"] = False
    far = {"travel": [-1e4, 1e4], "amplitude": 1e3, "speed": 1e4, "growth": 1e6}
    raw["axes"]["motor"]["limits"] |= far  # it coasts on from each e-stop
    del raw["simulation"]["plants"]["motor"]["stops"]
    raw["guard"] |= {"stale": "500 ms", "rig_watchdog": "1 s", "overruns": {"count": 2000, "window": "1 s"}}
    raw["server"] = {"host": "127.0.0.1", "port": port, "panel": False} | (
        {"command_token": TOKEN} if token else {}
    )
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(raw))
    return path


@contextlib.contextmanager
def process(*command: str, **options: object) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, *command], text=True, **options) as child:
        try:
            yield child
        finally:
            child.terminate()
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()


class Line:
    """What the rig says of the commands it gets, as it comes."""

    def __init__(self, rig: subprocess.Popen[str]) -> None:
        self.changes: queue.Queue[tuple[str, float]] = queue.Queue()
        threading.Thread(target=self._read, args=(rig.stdout,), daemon=True).start()

    def _read(self, stream: object) -> None:
        for text in stream:  # type: ignore[attr-defined]
            what, t = text.split()
            self.changes.put((what, float(t)))

    def forget(self) -> None:
        """What came before does not count."""
        while not self.changes.empty():
            self.changes.get()

    def wait_for(self, what: str, patience_s: float = PATIENCE_S) -> float:
        while True:
            change, t = self.changes.get(timeout=patience_s)
            if change == what:
                return t


def patient(port: int, token: str | None) -> Client:
    """A client, as soon as the daemon takes one."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return Client(port=port, token=token, timeout=PATIENCE_S)
        except ClientError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def start(client: Client, line: Line) -> None:
    """Out of the fault and moving, whatever it takes.

    Raises:
        ClientError: It does not move.
    """
    deadline = time.monotonic() + START_S
    while True:
        line.forget()
        try:
            client.reset()
            client.start()
            line.wait_for("moving", MOVES_S)
        except (ClientError, queue.Empty) as error:
            if time.monotonic() > deadline:
                fault = client.get()["fault"]
                raise ClientError(f"it does not move: {error!r}; {fault}") from error
            time.sleep(0.02)
        else:
            return


def estops(
    port: int, token: str | None, line: Line, count: int, newcomers: bool
) -> Iterator[tuple[float, float, bool]]:
    """One after the other: to neutral and to the reply [s], and whether time was stolen."""
    ends, rng = time.monotonic() + LONGEST_S, random.Random(1)
    with patient(port, token) as client, contextlib.ExitStack() as stack:
        stopper = stack.enter_context(patient(port, token))
        for _ in range(count):
            if time.monotonic() > ends:
                return
            start(client, line)
            if newcomers:
                stopper = stack.enter_context(patient(port, token))
            time.sleep(rng.uniform(0.005, 0.05))
            taken, begun = stolen_ticks(), time.monotonic()
            stopper.estop()
            replied = time.monotonic()
            stopped = line.wait_for("neutral")
            yield stopped - begun, replied - begun, stolen_ticks() > taken
            if newcomers:
                stopper.close()


def measure(attack: str | None, count: int) -> Found:
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        port = estop_port()
        strange = attack == "strangers"
        config = str(write_config(Path(name), port, strange))
        rig = stack.enter_context(process(estop_rig.__file__, config, stdout=subprocess.PIPE))
        line = Line(rig)
        line.wait_for("ready")
        stack.enter_context(process("-m", "seod.cli", "run", config, stderr=subprocess.DEVNULL))
        token = TOKEN if strange else None
        with patient(port, token) as client:
            start(client, line)
            if attack is not None:
                attacker = stack.enter_context(process(estop_attacks.__file__, attack, str(port)))
                time.sleep(SETTLE_S)
                if attacker.poll() is not None:
                    sys.exit(f"the attack {attack!r} ended")
            client.estop()
            line.wait_for("neutral")
            before = client.status()["health"]["rows_lost"]  # while the daemon came up
            found = list(estops(port, token, line, count, strange))
            if attack is not None:
                attacker.kill()
            lost = client.status()["health"]["rows_lost"] - before
    neutral, reply, stolen = np.array(found).T
    return Found(1e3 * neutral, 1e3 * reply, stolen > 0.0, lost)


def stolen_ticks() -> int:
    """Time that the host has taken from this machine's processors [clock ticks]."""
    return int(Path("/proc/stat").read_text().split("\n", 1)[0].split()[8])


def estop_port() -> int:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as free:
        number: int = free.getsockname()[1]
    return number


def row(name: str, found: Found) -> str:
    p50, p99, p999 = np.percentile(found.neutral[~found.stolen], (50.0, 99.0, 99.9))
    every = np.percentile(found.neutral, 99.9)
    verdict = "" if p999 <= GOAL_MS else "  missed"
    stolen, longest = np.count_nonzero(found.stolen), found.neutral.max()
    return (
        f"| {name:<22} | {len(found.neutral)} | {p50:.2f} | {p99:.2f} | {p999:.2f} | {stolen} | "
        f"{every:.2f} | {longest:.2f} | {np.percentile(found.reply, 99.0):.2f} | {found.lost} |{verdict}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="e-stops under each attack")
    parser.add_argument("--quick", action="store_true", help="100 of each")
    parser.add_argument("--attacks", nargs="+", choices=["none", *estop_attacks.ATTACKS])
    given = parser.parse_args()
    print(read_machine().describe() + f"; load average {os.getloadavg()[0]:.1f}")
    refused = set_fifo(PRIORITY)
    if refused:
        print(f"measured at ordinary priority: {refused}")
    print("e-stop of a client to neutral on the line [ms]; goal: p99.9 <= 20 ms")
    names = ("attack".ljust(22), "n", "p50", "p99", "p99.9", "stolen", "all99.9", "max", "reply99", "lost")
    print("| " + " | ".join(names) + " |")
    print("| --- " * len(names) + "|")
    for name in given.attacks or ["none", *estop_attacks.ATTACKS]:
        print(
            row(name, measure(None if name == "none" else name, 100 if given.quick else given.count)),
            flush=True,
        )


if __name__ == "__main__":
    main()
