"""What fifty TCP clients and the recorder cost the running daemon: lost samples, lateness of its ticks.

    python bench/clients.py [--pairs 10] [--seconds 3]

The daemon runs the virtual rig at 2 kHz, excited; in turns with 50 clients (half of which never read) and the
recorder on, and without both. `--pairs 1 --seconds 600` is the long form. The default takes two minutes.
Percentiles come from the daemon's own histogram, interpolated within its bins (a quarter octave).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import stream

from seod.client import Client, ClientError
from seod.files.shipped import configs_dir
from seod.latency.machine import read_machine
from seod.processes.ring import bin_edges_us
from seod.record.read import items

if TYPE_CHECKING:
    from collections.abc import Iterator

QUANTILES = (0.5, 0.99, 0.999)
PATIENCE_S = 20.0


def quantile_us(bins: np.ndarray, fraction: float) -> float:
    """Percentile of a histogram of `seod.processes.ring`, linear within the bin [us]."""
    edges = np.array([0.0, *bin_edges_us(), 1e5])
    return float(np.interp(fraction, np.cumsum([0, *bins]) / bins.sum(), edges))


@contextlib.contextmanager
def daemon(folder: Path, record: Path | None) -> Iterator[int]:
    """The daemon, excited; yields its port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    text = (configs_dir() / "virtual.yaml").read_text()
    config = folder / "rig.yaml"
    config.write_text(
        text.replace("7600", str(port)).replace("rig: virtual-motor", f"rig: bench{os.getpid()}")
    )
    command = [sys.executable, "-m", "seod.cli", "run", str(config)]
    with subprocess.Popen(command + (["--record", str(record)] if record else [])) as process:
        try:
            start(port)
            yield port
        finally:
            process.terminate()


def start(port: int) -> None:
    """Excite the rig as soon as it is there."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        with contextlib.suppress(ClientError), Client(port=port) as client:
            client.start()
            return
        if time.monotonic() > deadline:
            sys.exit("the daemon does not come up")
        time.sleep(0.1)


def health(port: int) -> dict:
    with Client(port=port) as client:
        return client.status()["health"]


def wait_for_clients(port: int, count: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while health(port)["clients"]["connected"] < count:
        if time.monotonic() > deadline:
            sys.exit(f"fewer than {count} clients came")
        time.sleep(0.2)


def watch(port: int, seconds: float) -> tuple[np.ndarray, int, int]:
    """Histogram of the lateness, ticks and overruns while nothing else is asked."""
    before = health(port)
    time.sleep(seconds)
    after = health(port)
    bins = np.subtract(after["lateness"]["bins"], before["lateness"]["bins"])
    return bins, after["ticks"] - before["ticks"], after["overruns"] - before["overruns"]


def gaps(record: Path) -> int:
    """Ticks that are missing in a recording."""
    ticks = np.concatenate([rows["tick"] for rows in items(record, ["motor"]) if not isinstance(rows, dict)])
    return int(ticks[-1] - ticks[0]) + 1 - len(ticks)


def run(seconds: float, crowded: bool) -> dict[str, float]:
    """One run of the daemon, with the crowd and the recorder or without."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record = folder / "rows.mcap" if crowded else None
        with daemon(folder, record) as port, contextlib.ExitStack() as stack:
            if crowded:
                crowd = subprocess.Popen(
                    [sys.executable, stream.__file__, str(port)], stdout=subprocess.DEVNULL
                )
                stack.callback(crowd.wait)
                stack.callback(crowd.terminate)
                wait_for_clients(port, stream.READING + stream.MUTE)
            bins, ticks, overruns = watch(port, seconds)
            lost = health(port)["rows_lost"]
        found = {f"p{100 * q:g}": quantile_us(bins, q) for q in QUANTILES}
        missing = gaps(record) if record else 0
    return {**found, "ticks": ticks, "overruns": overruns, "lost": lost, "missing": missing}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=3.0, help="length of one run")
    given = parser.parse_args()
    print(read_machine().describe() + f"; load average {os.getloadavg()[0]:.1f}")
    runs: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    for _ in range(given.pairs):
        for crowded in (False, True):
            runs[crowded].append(run(given.seconds, crowded))
    names = [f"p{100 * q:g}" for q in QUANTILES]
    print(f"lateness at 2 kHz [us], medians of {given.pairs} runs of {given.seconds:g} s: {', '.join(names)}")
    for crowded, label in ((False, "alone"), (True, "50 clients, recorder")):
        medians = [statistics.median(each[name] for each in runs[crowded]) for name in names]
        ticks, overruns = (sum(int(each[what]) for each in runs[crowded]) for what in ("ticks", "overruns"))
        print(
            f"  {label:<21}" + "".join(f"{m:>8.1f}" for m in medians) + f"   {overruns} of {ticks} ticks late"
        )
    ratios = [[a[n] / b[n] for a, b in zip(runs[True], runs[False], strict=True)] for n in names]
    print(
        "  ratio, median of pairs"
        + "".join(f"{statistics.median(r):>7.2f} " for r in ratios)
        + "  goal: p99 1.1"
    )
    lost, missing = (sum(int(each[what]) for each in runs[True]) for what in ("lost", "missing"))
    print(f"samples lost: {lost} by the gateway, {missing} missing in the recordings (goal 0)")
    if lost or missing:
        sys.exit(1)


if __name__ == "__main__":
    main()
