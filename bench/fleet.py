"""A fleet at one broker: `python bench/fleet.py [--rigs 1000] [--for 600] [--rate 0.2]`.

Publishers of the real code, all in one process; a real Mosquitto that is killed and started again twice;
the real `seod fleet --archive`. Printed: messages lost (goal 0) and twice in the archive (goal 0),
processor time and memory for each rig.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

REPO = Path(__file__).parents[1]
sys.path.insert(0, str(REPO))

from seod.fleet.broker import Broker  # noqa: E402
from seod.fleet.outbox import Outbox  # noqa: E402
from seod.fleet.publisher import Publisher  # noqa: E402
from seod.fleet.store import Store  # noqa: E402
from tests.mosquitto import Mosquitto, mosquitto  # noqa: E402

ARCHIVE = "bench"
STORE_BYTES = 4e6
DOWN_S = 5.0
"""So long the broker is away each time."""
SETTLE_S = 120.0
"""Most that the archive may need for what is left at the end."""


def estimate(rig: int, t: float, chance: random.Random) -> dict[str, Any]:
    """What a rig tells of its axis."""
    zeta, omega_n = 0.3 + 1e-4 * rig, 100.0 + 5.0 * math.sin(0.01 * t + rig)
    return {
        "at": time.time(),
        "axis": "motor",
        "t": t,
        "age_s": 0.4,
        "method": "wave",
        "quality": "ok",
        "zeta": chance.gauss(zeta, 1e-3),
        "zeta_sd": 1e-3,
        "omega_n": chance.gauss(omega_n, 0.2),
        "omega_n_sd": 0.2,
        "K_L": 17.0,
        "K_L_sd": 0.1,
        "frequency": 16.0,
        "amplitude": 0.02,
        "e_a": 1.0,
        "reference": 0.0,
        "left_model": False,
    }


class Rig:
    """One of the fleet: its publisher, and how much it has told."""

    def __init__(self, number: int, folder: Path, broker: Broker) -> None:
        self.number, self.name = number, f"rig{number:04}"
        self._chance = random.Random(number)
        self.store = Store(folder / self.name, STORE_BYTES, time.time())
        self.outbox = Outbox(self.name, self.store, ARCHIVE)
        self.publisher = Publisher(broker, self.outbox, self._birth)

    def _birth(self) -> dict[str, Any]:
        axes = {"motor": {"mode": "position", "unit": "rad", "gain_unit": "rad/s/V"}}
        return {"version": "bench", "simulated": True, "axes": axes, "now": {"state": "exciting"}}

    async def tell(self, period: float, until: float) -> None:
        """Estimates, one a period, begun anywhere within the first."""
        await asyncio.sleep(period * self._chance.random())
        while time.monotonic() < until:
            self.publisher.put("estimate/motor", estimate(self.number, time.monotonic(), self._chance))
            await asyncio.sleep(period)


async def publish(given: argparse.Namespace) -> None:
    """All rigs; when the time is up and the archive has all, one line of JSON tells what they told."""
    rigs = [Rig(k, given.folder, Broker("127.0.0.1", given.port)) for k in range(given.rigs)]
    running = [asyncio.create_task(rig.publisher.run()) for rig in rigs]
    began, before = time.monotonic(), time.process_time()
    await asyncio.gather(*(rig.tell(1.0 / given.rate, began + given.seconds) for rig in rigs))
    used = time.process_time() - before
    end = time.monotonic() + SETTLE_S
    while time.monotonic() < end and any(rig.store.released < rig.store.newest for rig in rigs):  # noqa: ASYNC110
        await asyncio.sleep(0.5)
    told = {rig.name: list(rig.store.newest) for rig in rigs}
    print(
        json.dumps(
            {
                "newest": told,
                "thinned": sum(sum(rig.store.thinned.values()) for rig in rigs),
                "waiting": sum(rig.store.released < rig.store.newest for rig in rigs),
                "seconds": time.monotonic() - began - (time.monotonic() - end + SETTLE_S),
                "settled": time.monotonic() - end + SETTLE_S,
                "processor": used,
                "memory": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
            }
        ),
        flush=True,
    )
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)


def archived(folder: Path) -> dict[str, list[tuple[int, int]]]:
    """Keys in the archive, of each rig, as they stand there."""
    found: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for path in sorted((folder / "fleet").glob("*.jsonl")):
        with path.open() as file:
            for line in file:
                row = json.loads(line)
                found[row["rig"]].append((row["session"], row["seq"]))
    return found


def usage(pid: int) -> tuple[float, int]:
    """Processor time [s] and largest memory [bytes] of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    peak = next(x for x in Path(f"/proc/{pid}/status").read_text().splitlines() if x.startswith("VmHWM"))
    ticks = os.sysconf("SC_CLK_TCK")
    return (int(fields[11]) + int(fields[12])) / ticks, 1024 * int(peak.split()[1])


def run(given: argparse.Namespace, broker: Mosquitto, folder: Path) -> int:
    """The fleet for its time, the broker killed twice; prints the figures."""
    listen = [sys.executable, "-m", "seod.cli", "fleet", "--broker", f"127.0.0.1:{broker.port}"]
    listen += ["--archive", str(folder / "archive"), "--name", ARCHIVE]
    each = [sys.executable, __file__, "--port", str(broker.port), "--folder", str(folder / "stores")]
    each += ["--rigs", str(given.rigs), "--for", str(given.seconds), "--rate", str(given.rate)]
    with (
        subprocess.Popen(listen, stdout=subprocess.DEVNULL) as listener,
        subprocess.Popen(each, stdout=subprocess.PIPE, text=True) as rigs,
    ):
        try:
            for _ in range(2):
                time.sleep(given.seconds / 3.0)
                broker.kill(signal.SIGKILL)
                time.sleep(DOWN_S)
                broker.start()
            assert rigs.stdout is not None
            told = json.loads(rigs.stdout.readline())
            heard_s, heard_bytes = usage(listener.pid)
        finally:
            rigs.send_signal(signal.SIGTERM)
            listener.send_signal(signal.SIGTERM)
    return tell(given, told, archived(folder / "archive"), heard_s, heard_bytes)


def tell(
    given: argparse.Namespace,
    told: dict[str, Any],
    found: dict[str, list[tuple[int, int]]],
    heard_s: float,
    heard_bytes: int,
) -> int:
    """Print the figures; 1 where something was lost or came twice."""
    wanted = {
        name: [(session, k) for k in range(1, seq + 1)] for name, (session, seq) in told["newest"].items()
    }
    total = sum(map(len, wanted.values()))
    lost = sum(len(set(keys) - set(found.get(name, []))) for name, keys in wanted.items())
    twice = sum(len(keys) - len(set(keys)) for keys in found.values())
    per = 1e3 / given.rigs
    print(f"{given.rigs} rigs, {given.seconds:g} s, {given.rate:g} estimates a second each: {total} messages")
    print(f"broker killed and started again 2 times, {DOWN_S:g} s away; load {os.getloadavg()[0]:.1f}")
    print(f"lost: {lost} (goal 0); twice in the archive: {twice} (goal 0); thinned: {told['thinned']}")
    print(f"the archive had all {told['settled']:.1f} s after the last; {told['waiting']} rigs wait still")
    print(
        f"publishers: {per * told['processor'] / given.seconds:.3f} ms of processor time a second and "
        f"{told['memory'] / given.rigs / 1e3:.0f} kB of memory for each rig"
    )
    print(
        f"seod fleet: {per * heard_s / given.seconds:.3f} ms a second and "
        f"{heard_bytes / given.rigs / 1e3:.0f} kB for each rig"
    )
    return int(lost > 0 or twice > 0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=1000)
    parser.add_argument("--for", dest="seconds", type=float, default=600.0, help="[s]")
    parser.add_argument("--rate", type=float, default=0.2, help="estimates of a rig a second [Hz]")
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    if given.port:
        asyncio.run(publish(given))
        return 0
    with (
        tempfile.TemporaryDirectory(prefix="seod-fleet-") as name,
        mosquitto(Path(name) / "broker") as broker,
    ):
        return run(given, broker, Path(name))


if __name__ == "__main__":
    sys.exit(main())
