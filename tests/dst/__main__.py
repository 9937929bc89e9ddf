"""`python -m tests.dst`: runs seeds, by several processes if wanted, and shrinks those that fail."""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.dst.run import Outcome, run
from tests.dst.shrink import shrunk

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    Job = tuple[int, float, str]


@dataclass
class Tally:
    """What has been run."""

    seeds: int = 0
    simulated_s: float = 0.0
    processor_s: float = 0.0
    faults: int = 0
    failed: int = 0

    def add(self, outcome: Outcome, processor_s: float) -> None:
        """One more seed."""
        self.seeds += 1
        self.simulated_s += outcome.simulated_s
        self.processor_s += processor_s
        self.faults += len(outcome.faults)
        self.failed += bool(outcome.failures)

    def told(self, took: float) -> str:
        """In a line."""
        return (
            f"{self.seeds} seeds, {self.simulated_s / 3600.0:.2f} simulated hours, {self.faults} faults, "
            f"{self.failed} failed, {took:.1f} s ({self.simulated_s / took:.0f} times real time, "
            f"{self.simulated_s / self.processor_s:.0f} times a processor's)"
        )


def arguments() -> argparse.Namespace:
    """Of the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.dst", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="so many seeds")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--seconds", type=float, default=20.0, help="with faults, of each run")
    parser.add_argument("--for", type=float, default=float("inf"), dest="budget", help="stop after this [s]")
    parser.add_argument("--wire", choices=("can", "serial"), default="can", help="that the rig hangs on")
    parser.add_argument("--jobs", type=int, default=1, help="so many processes; a seed is the same in each")
    parser.add_argument("--every", type=float, default=600.0, help="tell how far it is after this [s]")
    parser.add_argument("--trace", action="store_true", help="print the trace of failing seeds")
    parser.add_argument("--no-shrink", action="store_true", help="do not look for the fewest faults")
    return parser.parse_args()


def one(job: Job) -> tuple[Outcome, float]:
    """A seed, and the processor time that it took [s]."""
    seed, seconds, wire = job
    began = time.process_time()
    return run(seed, seconds, wire=wire), time.process_time() - began


def outcomes(jobs: Iterable[Job], processes: int) -> Iterator[tuple[Outcome, float]]:
    """All of them, as they come."""
    if processes == 1:
        yield from map(one, jobs)
        return
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        yield from pool.imap_unordered(one, jobs)


def tell_failed(outcome: Outcome, given: argparse.Namespace) -> None:
    """A seed that failed, with the fewest faults."""
    where = f"--seconds {given.seconds:g} --wire {given.wire}"
    print(f"seed {outcome.seed} ({where}): {outcome.failures[0]}", flush=True)
    if given.no_shrink:
        return
    least = shrunk(outcome, given.seconds)
    print(f"  {len(outcome.faults)} faults shrunk to {len(least.faults)}: {least.failures[0]}")
    for fault in least.faults:
        print(f"    {fault}", flush=True)
    if given.trace:
        again = run(outcome.seed, given.seconds, least.faults, keep=True, wire=given.wire)
        print("\n".join(again.trace[-200:]), flush=True)


def main() -> int:
    """Entry point."""
    given, tally = arguments(), Tally()
    gc.freeze()  # what is loaded by now need not be looked through after each run
    began = told = time.monotonic()
    seeds = range(given.first, given.first + given.seeds)
    for outcome, processor_s in outcomes(((s, given.seconds, given.wire) for s in seeds), given.jobs):
        tally.add(outcome, processor_s)
        if outcome.failures:
            tell_failed(outcome, given)
        now = time.monotonic()
        if now - told > given.every:
            told = now
            print(tally.told(now - began), flush=True)
        if now - began > given.budget:
            break
    print(tally.told(time.monotonic() - began))
    return int(tally.failed > 0)


if __name__ == "__main__":
    sys.exit(main())
