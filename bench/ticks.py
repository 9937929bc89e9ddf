"""Ten million ticks as fast as they go: no row lost, no time skipped, counters across 2^32, flat memory.

    python bench/ticks.py [--ticks 10_000_000]

The loop of a virtual rig on simulated time, excited all along, and the reader of its rows, in one process.
Tick numbers and places of rows pass 2^32 halfway, the time passes 2^32 us.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np

from seod.config.model import RigConfig
from seod.latency.measure import virtual_rig
from seod.loop.pacer import SimulatedPacer
from seod.loop.process import make_driver
from seod.loop.tick import Loop
from seod.observe.rows import RowReader
from seod.processes.ring import AxisState, Shared, Word

RATE_HZ = 2000.0
WRAP = 1 << 32
BATCH = 128
"""Ticks between two looks of the reader."""


def resident_mb() -> float:
    """Of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def make(ticks: int) -> tuple[Loop, RowReader, SimulatedPacer]:
    """The loop, with half of the ticks before 2^32."""
    document = virtual_rig(rate_hz=RATE_HZ).model_dump()
    document["driver"]["realtime"] = False
    config, shared = RigConfig.model_validate(document), Shared(1, 4096)
    first = WRAP - ticks // 2
    shared.words[Word.TICKS] = shared.words[Word.CONSUMED] = shared.row_ring.head[0] = first
    pacer = SimulatedPacer(1.0 / RATE_HZ, shared)
    pacer.start = WRAP * 1e-6 - (ticks // 2) / RATE_HZ
    loop = Loop(config, make_driver(config, pacer.now), shared, pacer, 1)
    shared.commands.put({"id": 1, "op": "start", "axis": None, "values": {}})
    return loop, RowReader(shared), pacer


class Watch:
    """What is wrong with the rows."""

    def __init__(self, first: int, start: float) -> None:
        self.next, self.start, self.first = first, start, first
        self.rows = self.gaps = self.wrong_times = self.at_rest = 0

    def take(self, rows: np.ndarray) -> None:
        """More rows, in their order."""
        if not len(rows):
            return
        expected = np.arange(self.next, self.next + len(rows))
        times = self.start + (expected - self.first + 1) / RATE_HZ
        self.gaps += int(np.count_nonzero(rows["tick"] != expected))
        self.wrong_times += int(np.count_nonzero(np.abs(rows["tick_t"] - times) > 1e-9))
        self.at_rest += int(np.count_nonzero(rows["axes"]["state"][:, 0] != AxisState.EXCITING))
        self.rows += len(rows)
        self.next = int(rows["tick"][-1]) + 1


def main() -> int:
    """Print the figures; 1 if something is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ticks", type=int, default=10_000_000)
    ticks = parser.parse_args().ticks
    loop, reader, pacer = make(ticks)
    watch, began, before = Watch(WRAP - ticks // 2, pacer.start), time.monotonic(), 0.0
    for k in range(ticks):
        t = pacer.next()
        loop.tick(t)
        loop.meter.note(t, pacer, loop.samples)
        if k % BATCH == 0:
            watch.take(reader.take())
            for _ in loop.shared.events.take():
                pass
        if k == ticks // 5:
            before = resident_mb()
    grown, took = resident_mb() - before, time.monotonic() - began
    loop.log.flush([])
    while len(rows := reader.take()):
        watch.take(rows)
    shared = loop.shared
    sums = [sum(shared.lateness.tolist()), sum(shared.execution.tolist())]
    print(f"{ticks} ticks in {took:.0f} s ({ticks / took:.0f} a second, {ticks / RATE_HZ / 3600:.2f} h)")
    print(
        f"rows {watch.rows}, lost {reader.lost}, out of order {watch.gaps}, wrong times {watch.wrong_times}"
    )
    print(
        f"last tick {watch.next - 1} = 2^32 {watch.next - 1 - WRAP:+d}; not excited in {watch.at_rest} rows"
    )
    print(f"histograms count {sums[0]} and {sums[1]} ticks; memory {grown:+.2f} MB after the first fifth")
    wrong = reader.lost + watch.gaps + watch.wrong_times + abs(watch.rows - ticks) + abs(sums[0] - ticks)
    return int(bool(wrong or grown > 1.0))


if __name__ == "__main__":
    sys.exit(main())
