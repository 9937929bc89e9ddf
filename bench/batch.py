"""What a batch costs beside its answers, and how it grows.

    python bench/batch.py [--part efficiency overhead growth]

efficiency: identify on 1 and 2 workers, the rounds of both interleaved, of short and of longer recordings.
On a machine that others use the clock tells little, so that the tasks' share of the processor time of all
processes is printed as well.
overhead: tasks that only wait, on 64 workers (4 processes of 16 threads); tasks that do nothing: the ceiling.
growth: processor time of a batch in this process over the number of recordings, of what reads a recording
and of identify.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

import argparse
import math
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
import psutil
from batch_tasks import write_recordings

import seod
from seod.batch import kinds
from seod.batch.cluster import OnDask
from seod.batch.executor import Here, completed
from seod.batch.run import Batch

PARTS = ("efficiency", "overhead", "growth")
ROUNDS = ((3000, 40), (60_000, 16))
"""Rows of a recording at 1 kHz, and recordings of a round: identify takes 0.1 s of 3 s, 1.2 s of a minute."""
SLOTS = 64
WAIT_S = 1.0
GROWTH = (10, 100, 1000, 10_000)
SHORT_ROWS = 300


def asked(path: str) -> float:
    """One identification; gives its processor time [s]."""
    from seod.api.identification import identify  # found by name: this script goes to workers by value

    before = time.process_time()
    identify(path)
    return time.process_time() - before


def pause(seconds: float) -> None:
    """What waits instead of computing."""
    time.sleep(seconds)


def used_s() -> float:
    """Processor time of this process and its children [s]."""
    this = psutil.Process()
    every = [each.cpu_times() for each in (this, *this.children(recursive=True))]
    return sum(times.user + times.system for times in every)


def efficiency(folder: Path, rounds: int, rows: int, count: int) -> None:
    write_recordings(folder, count, rows)
    paths = [str(path) for path in sorted(folder.iterdir())]
    with OnDask(workers=1, dashboard=None) as one, OnDask(workers=2, dashboard=None) as two:
        for executor in (one, two):
            list(completed(executor, asked, paths[:8]))  # libraries are loaded
        pairs, shares = [], []
        for _ in range(rounds):
            told = []
            for executor in (one, two):
                began, before = time.perf_counter(), used_s()
                tasks_s = sum(seconds for _, seconds in completed(executor, asked, paths))
                told.append(time.perf_counter() - began)
                shares.append(tasks_s / (used_s() - before))
            pairs.append(told)
            print(
                f"  {count} x identify of {rows} rows: 1 worker {told[0]:.2f} s, 2 workers {told[1]:.2f} s",
                flush=True,
            )
    middle = statistics.median(one_s / two_s / 2.0 for one_s, two_s in pairs)
    fastest = min(one_s for one_s, _ in pairs) / min(two_s for _, two_s in pairs) / 2.0
    print(
        f"efficiency of 2 workers by the clock: median pair {middle:.2f}, "
        f"fastest of each {fastest:.2f} (goal 0.9)"
    )
    print(f"tasks' share of all processor time: 1 worker {shares[-2]:.3f}, 2 workers {shares[-1]:.3f}")
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def overhead() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    dask = Path(sys.executable).with_name("dask")
    address = f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    here = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    commands = [
        [dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
        [dask, "worker", address, "--nworkers", "4", "--nthreads", str(SLOTS // 4), "--no-dashboard"],
    ]
    processes = [subprocess.Popen(command, env=here, **quiet) for command in commands]
    try:
        with OnDask(address, dashboard=None) as executor:
            while executor.slots < SLOTS:
                list(completed(executor, pause, [0.6]))
            list(completed(executor, pause, [0.0] * 500))
            for seconds, count in ((WAIT_S, 20 * SLOTS), (0.1, 100 * SLOTS), (0.0, 4000)):
                began, before = time.perf_counter(), time.process_time()
                list(completed(executor, pause, [seconds] * count))
                took, ours = time.perf_counter() - began, time.process_time() - before
                extra = took / count - seconds / SLOTS
                print(
                    f"  {count} tasks that wait {seconds:g} s on {executor.slots} slots: {took:.2f} s, "
                    f"{1e3 * extra:.2f} ms more per task (goal 5 ms); command {1e3 * ours / count:.2f} ms "
                    f"of processor time; {count / took:.0f} tasks/s",
                    flush=True,
                )
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def growth(folder: Path) -> None:
    read = kinds.Kind(lambda path, _: (seod.read(path).to_dict(), b""), {"rows": ("rows",)}, seod.identify)
    kinds.KINDS["read"] = read
    for kind, counts in (("read", GROWTH), ("identify", GROWTH[:3])):
        _grown(folder / "before", kind, GROWTH[0])  # libraries are loaded and files opened for the first time
        seconds = [_grown(folder, kind, count) for count in counts]
        slope = np.polyfit(np.log(counts), np.log(seconds), 1)[0]
        for count, each in zip(counts, seconds, strict=True):
            print(f"  {kind} {count:6d} recordings: {each:8.3f} s, {1e3 * each / count:.2f} ms each")
        print(f"cost of {kind} grows with the exponent {slope:.3f} (goal 1.00 +- 0.05)", flush=True)


def _grown(folder: Path, kind: str, count: int) -> float:
    """Processor time of a batch of so many, the best of some for few."""
    source, best = folder / f"{kind}-{count}", math.inf
    write_recordings(folder / "patterns", 17, SHORT_ROWS)
    patterns = [path.read_bytes() for path in sorted((folder / "patterns").iterdir())]
    source.mkdir()
    for k in range(count):
        (source / f"run-{k:05d}.csv").write_bytes(patterns[k % len(patterns)])
    for k in range(1 if count > 100 else 3):
        before = time.process_time()
        with Batch(kind, [source], folder / f"out-{kind}-{count}-{k}", {}) as batch:
            batch.run(Here())
        best = min(best, time.process_time() - before)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", nargs="*", choices=PARTS, default=PARTS)
    parser.add_argument("--rounds", type=int, default=4)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if "overhead" in args.part:
            overhead()
        if "growth" in args.part:
            growth(Path(folder))
        if "efficiency" in args.part:
            for rows, count in ROUNDS:
                efficiency(Path(folder) / f"of-{rows}", args.rounds, rows, count)


if __name__ == "__main__":
    main()
