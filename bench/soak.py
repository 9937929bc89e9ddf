"""Ten minutes at 2 kHz with recorder, 50 clients, load on processor and disk: what is lost, does memory grow.

    python bench/soak.py [--for 600] [--clients 50] [--busy 1]

The daemon runs as real processes on the virtual rig in real time. Each second the resident memory of its
processes is read; after the first fifth a line is fitted through it. Goal: no row lost, and an interval of
the slope that holds 0 or less.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np

REPO = Path(__file__).parents[1]
SEOD = Path(sys.executable).with_name("seod")
PORT = 7655


def rig_file(folder: Path) -> Path:
    """The virtual rig at 2 kHz on a port of its own; each minute a new file, for its index is memory."""
    text = (REPO / "configs/virtual.yaml").read_text()
    text = text.replace("port: 7600", f"port: {PORT}").replace("\nrig: ", "\nrig: soak-")
    text = text.replace("\n# record: ", "\nrecord: {max_time: 60 s}\n# ")
    path = folder / "soak.yaml"
    path.write_text(text)
    return path


def tree(pid: int) -> list[int]:
    """A process and all below it."""
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += tree(int(child))
    return found


def resident_mb(pid: int) -> Counter[str]:
    """Of each process of the daemon, by the module it runs."""
    found = Counter[str]()
    for each in tree(pid):
        try:
            pages = int(Path(f"/proc/{each}/statm").read_text().split()[1])
            words = Path(f"/proc/{each}/cmdline").read_text().split("\0")
        except OSError:  # it has just ended
            continue
        name = words[words.index("-m") + 1] if "-m" in words else Path(words[-2]).name
        found[name] += pages * os.sysconf("SC_PAGE_SIZE") / 1e6  # type: ignore[assignment]
    return found


class Listener(threading.Thread):
    """Reads estimates, events, and samples at 20 a second."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.lost, self.lines = 0, 0
        self.socket = socket.create_connection(("127.0.0.1", PORT), timeout=30)
        params = {"topics": ["estimate", "event", "sample"], "rate_hz": 20}
        ask = {"jsonrpc": "2.0", "id": 1, "method": "subscribe", "params": params}
        self.socket.sendall(json.dumps(ask).encode() + b"\n")

    def run(self) -> None:
        for line in self.socket.makefile("rb"):
            self.lines += 1
            if b'"lost"' in line[:60]:
                self.lost += json.loads(line)["params"]["lost"]


def ask(method: str, **params: object) -> dict[str, object]:
    """One call on a connection of its own."""
    with socket.create_connection(("127.0.0.1", PORT), timeout=30) as peer:
        peer.sendall(
            json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n"
        )
        answer: dict[str, dict[str, object]] = json.loads(peer.makefile("rb").readline())
    if "result" not in answer:
        raise SystemExit(f"{method}: {answer['error']['message']}")
    return answer["result"]


def burden(folder: Path, processors: int) -> list[subprocess.Popen[bytes]]:
    """Ordinary programs that take processor and disk."""
    spin = [sys.executable, "-c", "while True: sum(range(1000))"]
    write = "while True: f.seek(0); f.write(bytes(1 << 20)); os.fsync(f.fileno())"
    disk = f"import os\nf = open({str(folder / 'junk')!r}, 'wb')\n{write}"
    return [subprocess.Popen(spin) for _ in range(processors)] + [
        subprocess.Popen([sys.executable, "-c", disk])
    ]


def slope(t: list[float], mb: list[float]) -> tuple[float, float]:
    """MB per minute and half the 95 % interval, the neighbours' likeness counted in."""
    x, y = np.array(t) / 60.0, np.array(mb)
    fit = np.polyfit(x, y, 1)
    rest = y - np.polyval(fit, x)
    alike = float(np.corrcoef(rest[:-1], rest[1:])[0, 1]) if rest.std() > 0 else 0.0
    fewer = max(3.0, len(x) * (1 - alike) / (1 + alike))
    sd = rest.std() / (x.std() * math.sqrt(fewer))
    return float(fit[0]), 1.96 * float(sd)


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--for", type=float, default=600.0, dest="seconds")
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--busy", type=int, default=1, help="programs that take a processor each")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        daemon = subprocess.Popen([SEOD, "run", rig_file(folder), "--record", folder / "soak.mcap"])
        load: list[subprocess.Popen[bytes]] = []
        try:
            wait_for_port()
            wait_for_ticks()
            clients = [Listener() for _ in range(given.clients)]
            for client in clients:
                client.start()
            load = burden(folder, given.busy)
            ask("start")
            return soak(daemon.pid, clients, given.seconds)
        finally:
            for each in load:
                each.kill()
                each.wait()
            daemon.send_signal(signal.SIGTERM)
            daemon.wait(30)


def wait_for_ticks() -> None:
    """Until the loop behind the gateway runs: a start before is refused."""
    for _ in range(600):
        health = ask("status")["health"]
        if isinstance(health, dict) and health["ticks"]:
            return
        time.sleep(0.1)
    raise SystemExit("the loop does not tick")


def wait_for_port() -> None:
    """Until the daemon listens."""
    for _ in range(600):
        try:
            socket.create_connection(("127.0.0.1", PORT), timeout=1).close()
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise SystemExit("the daemon does not listen")


def soak(pid: int, clients: list[Listener], seconds: float) -> int:
    """Watch for so long; 1 if rows are lost or memory grows."""
    began, t = time.monotonic(), []
    each: list[Counter[str]] = []
    while (now := time.monotonic() - began) < seconds:
        if now > seconds / 5:
            t.append(now)
            each.append(resident_mb(pid))
        time.sleep(1.0)
    health = ask("status")["health"]
    assert isinstance(health, dict)
    mb = [float(now.total()) for now in each]
    per_minute, half = slope(t, mb)
    ring, recorder = health["rows_lost"], health["recorder"]["lost"]
    load = os.getloadavg()[0]
    print(f"{seconds:.0f} s, {health['ticks']} ticks, {len(clients)} clients, load average {load:.1f}")
    print(f"rows lost: {ring} in the ring, {recorder} by the recorder; goal 0")
    messages = f"{sum(one.lost for one in clients)} of {sum(one.lines for one in clients)}"
    print(f"messages lost by clients: {messages}")
    print(f"memory {mb[-1]:.0f} MB, slope {per_minute:+.3f} +- {half:.3f} MB a minute; goal: not above 0")
    for name in each[-1]:
        grows, give = slope(t, [now[name] for now in each])
        print(f"  {name:<20} {each[-1][name]:>4.0f} MB, {grows:+.3f} +- {give:.3f} MB a minute")
    return int(bool(ring or recorder) or per_minute - half > 0.0)


if __name__ == "__main__":
    sys.exit(main())
