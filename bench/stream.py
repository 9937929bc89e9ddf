"""What 50 clients cost: a gateway fed at 2 kHz, half of its clients never reading, recorder on.

Prints the rows lost (should be 0), what the reading clients got, the gateway's share of a processor, and how
far it ran behind the loop. Takes about 15 s.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from seod.config.load import load_rig
from seod.files.shipped import configs_dir
from seod.processes.handover import ChildArguments, write_memfd
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH, AxisState, Shared, Word

RATE_HZ = 2000
SECONDS = 10.0
READING = MUTE = 25
TOPICS = b'{"topics":["estimate","sample","event","health"]}'
SUBSCRIBE = b'{"jsonrpc":"2.0","id":1,"method":"subscribe","params":%s}\n' % TOPICS


async def read_all(port: int) -> int:
    """Lines that one client gets until the daemon ends."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(SUBSCRIBE)
    lines = 0
    while data := await reader.read(1 << 18):
        lines += data.count(b"\n")
    writer.close()
    return lines


async def clients(port: int) -> None:
    """All clients, in a process of their own."""
    mute = [await asyncio.open_connection("127.0.0.1", port, limit=1) for _ in range(MUTE)]
    for _, writer in mute:
        writer.write(SUBSCRIBE)
    counts = await asyncio.gather(*(read_all(port) for _ in range(READING)), return_exceptions=True)
    print(json.dumps([count for count in counts if isinstance(count, int)]))


def write_row(shared: Shared, tick: int, t: float) -> None:
    y = 0.2 * math.sin(115.0 * t)
    u = -math.copysign(0.5, y)
    axis = (t, y, 0.0, u, t, 0.5, 0.0, -y, int(AxisState.EXCITING), FLAG_EXCITING | FLAG_FRESH)
    ring = shared.row_ring
    shared.row_struct.pack_into(ring.data, ring.next_offset(), tick, t, *axis)
    ring.commit()
    shared.words[Word.TICKS] = tick + 1


def feed(shared: Shared) -> list[int]:
    """Be the loop for a while; returns the gateway's lag [rows] at each tick."""
    lags = []
    began = time.monotonic()
    for tick in range(int(SECONDS * RATE_HZ)):
        due = began + tick / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))
        write_row(shared, tick, time.monotonic())
        lags.append(shared.row_ring.head[0] - shared.words[Word.CONSUMED])
    return sorted(lags)


def cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def start_gateway(shared: Shared, record: str) -> tuple[subprocess.Popen[bytes], socket.socket, int]:
    rig = load_rig(configs_dir() / "virtual.yaml")
    rig = rig.model_copy(update={"server": rig.server.model_copy(update={"port": 0})})
    config_fd = write_memfd("config", rig.model_dump_json().encode())
    link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        fds = (config_fd, shared.fd, theirs.fileno())
        arguments = ChildArguments(*fds, os.getpid(), 1, shared.rows, 1, record, "virtual.yaml")
        process = subprocess.Popen(arguments.command("seod.gateway"), pass_fds=fds)
    return process, link, json.loads(link.recv(1000))["port"]


def main() -> None:
    shared = Shared(1, 2 * RATE_HZ)
    started = {"realtime": {"ok": False, "why": ["bench"]}, "counters": []}
    shared.events.put({"event": "started", "t": time.monotonic(), "generation": 1, **started})
    with tempfile.TemporaryDirectory() as folder:
        gateway, link, port = start_gateway(shared, f"{folder}/rows.csv")
        command = [sys.executable, __file__, str(port)]
        crowd = subprocess.Popen(command, stdout=subprocess.PIPE)
        time.sleep(3.0)  # until all have subscribed
        used = cpu_seconds(gateway.pid)
        lags = feed(shared)
        used = cpu_seconds(gateway.pid) - used
        with socket.create_connection(("127.0.0.1", port)) as asker:
            asker.sendall(b'{"jsonrpc":"2.0","id":1,"method":"status"}\n')
            health = json.loads(asker.makefile().readline())["result"]["health"]
        link.close()
        gateway.wait()
        counts = json.loads(crowd.communicate()[0])
        recorded = len(Path(f"{folder}/rows.csv").read_text().splitlines()) - 1
    shared.close()
    rows = len(lags)
    print(f"rows written {rows}, lost {health['rows_lost']}, recorded {recorded}")
    print(f"reading clients: {len(counts)}, fewest messages {min(counts)}, sum {sum(counts) / SECONDS:.0f}/s")
    print(f"clients that lost messages: {len(health['clients']['dropped'])} (mute: {MUTE})")
    print(f"gateway: {100 * used / SECONDS:.0f} % of one processor")
    print(f"lag: median {lags[rows // 2]} rows, p99 {lags[rows * 99 // 100]}, max {lags[-1]}")
    if health["rows_lost"] or recorded != rows:
        sys.exit("rows were lost")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        asyncio.run(clients(int(sys.argv[1])))
    else:
        main()
