"""What a serial line costs at 2 kHz: latency, loss, times of the samples; beside a bare line.

    python bench/line.py [--seconds 5] [--pairs 10] [--long 60]

The board is the reference firmware as a process on a pseudo terminal; it shares CLOCK_MONOTONIC with the
driver, which does not know: so the error of every converted time is known. The bare line is eight bytes each
500 us from a program in C (`bench/stamps.c`), read by select and read alone. A pseudo terminal has no bit
rate and no USB: what those add comes on top. As root, both readers run under SCHED_FIFO.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import os
import select
import struct
import subprocess
import tempfile
import time
import tty
from pathlib import Path
from statistics import median

import numpy as np

from drivers.serial import SerialDriver
from drivers.serial_config import SerialOptions
from drivers.serial_counters import COUNTER_NAMES

ROOT = Path(__file__).parents[1]
FIRMWARE = ROOT / "drivers" / "firmware"
PERIOD_S = 5e-4
LOSSES = ("lost", "repeated", "crc_errors", "bad_frames", "late", "deferred", "board_drops", "board_overruns")


def build(folder: Path) -> None:
    firmware = [FIRMWARE / name for name in ("seod_frame.c", "seod_board.c", "posix/main.c")]
    for name, sources in (("board", firmware), ("stamps", [ROOT / "bench" / "stamps.c"])):
        command = ["gcc", "-std=c99", "-O2", *map(str, sources), "-lm", "-o", str(folder / name)]
        subprocess.run(command, check=True)


@contextlib.contextmanager
def peer(program: Path, link: Path):
    process = subprocess.Popen([program, link], stdout=subprocess.PIPE)
    try:
        yield process.stdout.readline()
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


def bare(folder: Path, seconds: float) -> np.ndarray:
    """Arrival after stamp [s] of each message on the bare line."""
    link = folder / "bare"
    with peer(folder / "stamps", link):
        fd = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(fd)
        end, found = time.monotonic() + seconds, []
        while (left := end - time.monotonic()) > 0.0:
            if select.select([fd], [], [], left)[0]:
                data = os.read(fd, 65536)
                now = time.monotonic_ns()
                found += [now - stamp for (stamp,) in struct.iter_unpack("<Q", data[: len(data) // 8 * 8])]
        os.close(fd)
    return np.array(found[200:]) * 1e-9


class Run:
    """One stretch of the driver with the firmware: a command after each sample."""

    def __init__(self, folder: Path, seconds: float) -> None:
        link = folder / "line"
        with peer(folder / "board", link) as line:
            self.begun = json.loads(line)["begun"]
            inputs = [{"name": "angle", "type": "int32", "scale": 1e-5}, {"name": "run", "type": "uint8"}]
            outputs = [{"name": "valve", "type": "int16", "scale": 1e-3}]
            section = {"kind": "serial", "port": str(link), "usb": True, "inputs": inputs, "outputs": outputs}
            self.driver = SerialDriver(SerialOptions.model_validate(section), time.monotonic)
            self.driver.open(["angle", "run"], ["valve"])
            self.driver.start()
            try:
                self._run(seconds)
            finally:
                self.driver.close()
        self.counts = dict(zip(COUNTER_NAMES, self.driver.counters, strict=True))

    def _run(self, seconds: float) -> None:
        driver, rows, left, cost = self.driver, [], [], []
        watched = self._watch()
        gc.collect()
        gc.disable()
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            driver.wait(now + 0.01)
            arrived = time.monotonic()
            spent = time.thread_time()
            sample = driver.read(arrived)[0]
            driver.write(arrived, [0.1])
            cost.append(time.thread_time() - spent)
            rows.append((arrived, sample.t, watched[-1] if watched else np.nan))
            left.append(driver.left()[0] - arrived)
        gc.enable()
        arrived, taken, stamp = np.array(rows[2000:]).T
        true = self.begun + stamp * 1e-6
        self.latency = arrived - true
        self.error = taken - true
        self.command = np.array(left[2000:])
        self.cost = np.array(cost[2000:])

    def _watch(self) -> list[float]:
        """The board's own stamps, unwrapped [us], as they are taken."""
        watched: list[float] = []
        take = self.driver._inputs.take

        def spy(sample, now):
            watched.append(sample.time_us)
            return take(sample, now)

        self.driver._inputs.take = spy
        return watched


def us(values: np.ndarray, *percents: float) -> str:
    return "  ".join(f"{x * 1e6:7.1f}" for x in np.percentile(values, percents))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--long", type=float, default=60.0)
    options = parser.parse_args()
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(30))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(folder)
        pairs = [(bare(folder, options.seconds), Run(folder, options.seconds)) for _ in range(options.pairs)]
        report(pairs)
        long = Run(folder, options.long)
    lost = {name: long.counts[name] for name in LOSSES if long.counts[name]}
    told = ", ".join(f"{long.counts[name]} {name}" for name in ("samples", "commands"))
    print(f"{options.long:g} s at 2 kHz: {told}; {lost or 'nothing lost'}")


def report(pairs: list[tuple[np.ndarray, Run]]) -> None:
    lines, runs = [b for b, _ in pairs], [r for _, r in pairs]
    print(f"{'[us], medians of ' + str(len(pairs)) + ' pairs':<44}     p50      p99    p99.9")
    for name, parts in (
        ("sampling to the driver's answer", [r.latency for r in runs]),
        ("the bare line, stamp to read", lines),
        ("error of the converted time of a sample", [np.abs(r.error) for r in runs]),
        ("write of a command to its row's time", [r.command for r in runs]),
        ("read and write, processor time", [r.cost for r in runs]),
    ):
        values = np.median([np.percentile(part, [50, 99, 99.9]) for part in parts], axis=0) * 1e6
        print(f"{name:<44} " + " ".join(f"{value:8.1f}" for value in values))
    ratio = [np.percentile(r.latency, 99) / np.percentile(b, 99) for b, r in pairs]
    print(f"p99 of the line with frames over the bare one: {median(ratio):.2f} (median of the pairs)")


if __name__ == "__main__":
    main()
