"""What estimation costs the gateway: share of a core, answers in a half cycle, their age; 1 and 4 axes.

    python bench/gateway_load.py [--seconds 10] [--methods wave exact peaks] [--live]

The real daemon runs a virtual rig at 2 kHz whose axes, all excited, are the design's three plants and one
more. A client listens to all estimates. The share of a core is the gateway's processor time, by the kernel's
account, over the time of the rig's clock. That is simulated, so that a busy machine does not matter and no
row is lost; `--live` has it run in real time. Goal: with 4 axes below a core, an answer in each half cycle.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import yaml

from seod.client import Client, ClientError
from seod.files.shipped import configs_dir
from seod.latency.machine import read_machine

if TYPE_CHECKING:
    from collections.abc import Iterator

PLANTS = ((0.21, 117.0), (0.45, 145.0), (0.8, 60.0), (0.3, 200.0))
PATIENCE_S = 120.0
SETTLE_S = 2.0
TICKS_S = os.sysconf("SC_CLK_TCK")


class Load(NamedTuple):
    """One measurement.

    Attributes:
        core: Share of a core that the gateway took.
        per_half_cycle: Answers in a half cycle, the least of all axes.
        ok: Share of answers that are `ok`.
        age_ms: Median and 99th percentile of `age_s` as published [ms].
    """

    core: float
    per_half_cycle: float
    ok: float
    age_ms: tuple[float, float]


def rig(axes: int, port: int, method: str, live: bool) -> str:
    """The shipped virtual rig with so many axes."""
    raw = yaml.safe_load((configs_dir() / "virtual.yaml").read_text())
    axis, plant = raw["axes"].pop("motor"), raw["simulation"]["plants"].pop("motor")
    sensor, output = raw["sensors"].pop("angle"), raw["outputs"].pop("valve")
    for k, (zeta, omega_n) in enumerate(PLANTS[:axes]):
        scale = 0.21 * 117.0 / (zeta * omega_n)  # of the limit cycle's amplitude
        raw["sensors"][f"s{k}"] = sensor | {"channel": f"y{k}"}
        raw["outputs"][f"o{k}"] = output | {"channel": f"u{k}"}
        raw["axes"][f"a{k}"] = one = copy.deepcopy(axis) | {"sensor": f"s{k}", "output": f"o{k}"}
        one["relay"]["hysteresis"] = 0.004 * scale
        one["estimator"]["method"] = method
        values = {"input": f"u{k}", "output": f"y{k}", "zeta": zeta, "omega_n": omega_n}
        raw["simulation"]["plants"][f"a{k}"] = plant | values | {"noise": 1e-3 * scale}
    raw["driver"]["realtime"] = live
    raw["rig"] = f"load{os.getpid()}"
    raw["server"] |= {"port": port, "panel": False}
    return json.dumps(raw)  # it is YAML as well


@contextlib.contextmanager
def daemon(folder: Path, axes: int, method: str, live: bool) -> Iterator[tuple[int, int]]:
    """The daemon; yields its port and the gateway's process."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    config = folder / "rig.yaml"
    config.write_text(rig(axes, port, method, live))
    with subprocess.Popen([sys.executable, "-m", "seod.cli", "run", str(config)]) as process:
        try:
            wait_for(port)
            yield port, gateway_of(process.pid)
        finally:
            process.terminate()


def wait_for(port: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        with contextlib.suppress(ClientError), Client(port=port) as client:
            if client.status()["health"]["ticks"]:
                return
        if time.monotonic() > deadline:
            sys.exit("the daemon does not come up")
        time.sleep(0.1)


def gateway_of(supervisor: int) -> int:
    """The process of the supervisor's children that is the gateway."""
    for child in Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split():
        if b"seod.gateway" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    sys.exit("the supervisor has no gateway")


def processor_s(process: int) -> float:
    """User and system time of a process so far [s]."""
    after_name = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) / TICKS_S


def measure(axes: int, method: str, seconds: float, live: bool) -> Load:
    """The load while all axes are excited."""
    with (
        tempfile.TemporaryDirectory() as name,
        daemon(Path(name), axes, method, live) as (port, gateway),
        Client(port=port) as client,
    ):
        client.start()
        client.subscribe(["estimate"])
        return listen(client, gateway, axes, seconds)


def listen(client: Client, gateway: int, axes: int, seconds: float) -> Load:
    """For so many seconds of the rig's clock, from when all have settled."""
    got: list[dict] = []
    before = begun = 0.0
    for message in client.notifications(PATIENCE_S):
        estimate = message["params"]
        begun = begun or estimate["t"]
        if estimate["t"] < begun + SETTLE_S:
            before = processor_s(gateway)
            continue
        got.append(estimate)
        if estimate["t"] > begun + SETTLE_S + seconds:
            break
    ages = sorted(1e3 * e["age_s"] for e in got)
    return Load(
        core=(processor_s(gateway) - before) / (got[-1]["t"] - got[0]["t"]),
        per_half_cycle=min(answers_per_half_cycle(got, f"a{k}") for k in range(axes)),
        ok=sum(e["quality"] == "ok" for e in got) / len(got),
        age_ms=(ages[len(ages) // 2], ages[int(0.99 * len(ages))]),
    )


def answers_per_half_cycle(got: list[dict], axis: str) -> float:
    """By the times of the windows' ends, and the frequency that the answers tell."""
    mine = [e for e in got if e["axis"] == axis and e["frequency"]]
    frequency = statistics.median(e["frequency"] for e in mine)
    return (len(mine) - 1) / ((mine[-1]["t"] - mine[0]["t"]) * frequency / 3.14159265)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="length of one measurement")
    parser.add_argument("--methods", nargs="+", default=["wave", "exact", "peaks"])
    parser.add_argument(
        "--live", action="store_true", help="in real time; tells the age of the answers as well"
    )
    given = parser.parse_args()
    print(read_machine().describe() + f"; load average {os.getloadavg()[0]:.1f}")
    print("method axes    core  answers/half cycle     ok" + ("   age median    p99" if given.live else ""))
    for method in given.methods:
        for axes in (1, 4):
            load = measure(axes, method, given.seconds, given.live)
            age = f"{load.age_ms[0]:9.1f} ms {load.age_ms[1]:6.1f} ms" if given.live else ""
            answers = f"{load.per_half_cycle:19.2f} {100 * load.ok:5.1f}%"
            print(f"{method:>6} {axes:4d} {100 * load.core:6.1f}% {answers} {age}", flush=True)
    print("goal: wave, 4 axes: below 100 % of a core, at least 1 answer in a half cycle")


if __name__ == "__main__":
    main()
