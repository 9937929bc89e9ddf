"""The loop on the virtual rig: how late it wakes up, what a tick costs, how fast it can go.

    python bench/loop.py [PART ...] [--pairs 10] [--seconds 1.5] [--quick] [--plots DIR]

Parts (all of them if none is named):
    lateness  the loop at 2 kHz, a bare Python loop and cyclictest, in turns, all SCHED_FIFO 50
    phases    where the time of a tick goes
    axes      the same for 1 to 8 axes, with a straight line through it
    rate      ticks more than a period late at 1 to 10 kHz, beside an empty loop in C

All programs of a part take turns, so that the machine's noise meets all of them alike. Latencies are whole
microseconds, rounded down, as cyclictest counts them. The default takes about two minutes, `--quick` 25 s.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seod.latency.machine import read_machine
from seod.latency.measure import PRIORITY, MeasureError, make_loop, run_bare, run_cyclictest, run_loop
from seod.latency.report import Latencies, count_seconds, parse_cyclictest
from seod.processes.realtime import enter_realtime
from seod.processes.ring import AxisState

if TYPE_CHECKING:
    from seod.loop.tick import Loop

RATE = 2000.0
RATES = (1000.0, 2000.0, 4000.0, 5000.0, 8000.0, 10_000.0)
AXES = range(1, 9)
QUANTILES = (0.5, 0.99, 0.999)
PHASES = ("read", "sense", "obey", "inspect", "command", "write", "log", "meter")


def check_excited(loop: Loop) -> None:
    """Figures of a loop that has stopped would flatter it."""
    for axis in loop.axes:
        if axis.course.state is not AxisState.EXCITING:
            sys.exit(f"{axis.name} is {axis.course.state.name}: {list(loop.shared.events.take())}")


def loop_latencies(loop: Loop, seconds: float) -> Latencies:
    found = count_seconds("seod loop", run_loop(loop, seconds))
    check_excited(loop)
    return found


def run_c(program: str, seconds: float, rate: float) -> Latencies:
    command = [program, str(rate), str(seconds), str(PRIORITY)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return Latencies("empty loop in C", parse_cyclictest(done.stdout).counts)


def compile_c(folder: str) -> str:
    program = f"{folder}/empty_loop"
    source = Path(__file__).with_name("empty_loop.c")
    subprocess.run(["gcc", "-O2", "-Wall", "-o", program, source], check=True)
    return program


def lateness(pairs: int, seconds: float) -> dict[str, Latencies]:
    """Lateness at 2 kHz; returns what all runs of each program add up to."""
    loop = make_loop()
    run_loop(loop, 0.5)
    runs: dict[str, list[Latencies]] = defaultdict(list)
    for _ in range(pairs):
        runs["bare loop"].append(count_seconds("bare Python loop", run_bare(seconds, RATE)))
        runs["seod loop"].append(loop_latencies(loop, seconds))
        try:
            runs["cyclictest"].append(run_cyclictest(seconds, RATE))
        except MeasureError as error:
            sys.exit(str(error))
    print(
        f"lateness at {RATE:.0f} Hz [us], medians of {pairs} runs of {seconds:g} s      p50     p99   p99.9"
    )
    quantiles = {
        name: np.array([[r.quantile(q) for q in QUANTILES] for r in all_]) for name, all_ in runs.items()
    }
    for name, values in quantiles.items():
        print(f"  {name:<53}" + "".join(f"{value:>8.1f}" for value in np.median(values, axis=0)))
    ratios = np.maximum(quantiles["seod loop"], 1) / np.maximum(quantiles["cyclictest"], 1)
    for name, values in (
        ("median", np.median(ratios, 0)),
        ("lowest", ratios.min(0)),
        ("highest", ratios.max(0)),
    ):
        print(
            f"  {f'seod / cyclictest, {name} of the pairs':<53}"
            + "".join(f"{value:>8.2f}" for value in values)
        )
    print("  goals (median): p99 1.2, p99.9 1.5")
    sums = {name: sum(all_[1:], all_[0]) for name, all_ in runs.items()}
    for name, total in sums.items():
        print(f"  {name}: all {total.total} wake-ups: p99.9 {total.quantile(0.999)}, worst {total.worst} us")
    return sums


class Stopwatch:
    """Adds up the time [us] that named calls take, tick by tick."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PHASES, 0)
        self.calls = dict.fromkeys(PHASES, 0)

    def watch(self, phase: str, owner: object, method: str) -> None:
        call, spent, calls, clock = getattr(owner, method), self.spent, self.calls, time.perf_counter_ns

        def timed(*arguments):
            start = clock()
            result = call(*arguments)
            spent[phase] += clock() - start
            calls[phase] += 1
            return result

        setattr(owner, method, timed)

    def lap(self, overhead_ns: float) -> list[float]:
        """Time of each phase since the last lap [us], without that of the clock itself."""
        found = [(self.spent[p] - overhead_ns * self.calls[p]) / 1e3 for p in PHASES]
        self.spent.update(dict.fromkeys(PHASES, 0))
        self.calls.update(dict.fromkeys(PHASES, 0))
        return found


def clock_overhead_ns() -> float:
    watch = Stopwatch()

    class Nothing:
        def read(self) -> None: ...

    nothing = Nothing()
    watch.watch("read", nothing, "read")
    laps = []
    for _ in range(2000):
        nothing.read()
        laps.append(1e3 * watch.lap(0.0)[0])
    return statistics.median(laps)


def phases(seconds: float) -> dict[str, float]:
    """Median time of each phase of a tick, one axis [us]."""
    loop = make_loop()
    run_loop(loop, 0.5)
    watch = Stopwatch()
    for phase, owner, method in (
        ("read", loop.driver, "read"),
        ("obey", loop, "obey"),
        ("inspect", loop, "inspect"),
        ("inspect", loop, "inspect_commands"),
        ("write", loop, "write"),
        ("log", loop.log, "flush"),
        ("log", loop.log, "keep"),
        ("meter", loop.meter, "note"),
        *(("sense", axis, "sense") for axis in loop.axes),
        *(("command", axis, "command") for axis in loop.axes),
    ):
        watch.watch(phase, owner, method)
    overhead, laps = clock_overhead_ns(), []
    loop.pacer.deadline = time.monotonic()
    for _ in range(int(seconds * RATE)):
        t = loop.pacer.next()
        loop.tick(t)
        loop.meter.note(t, loop.pacer, loop.samples)
        laps.append(watch.lap(overhead))
    check_excited(loop)
    medians = dict(zip(PHASES, np.median(laps, axis=0), strict=True))
    print(f"phases of a tick, one axis [us], medians of {len(laps)} ticks")
    print(
        "  "
        + ", ".join(f"{name} {us:.1f}" for name, us in medians.items())
        + f"; sum {sum(medians.values()):.1f}"
    )
    return medians


def tick_costs(loop: Loop, seconds: float) -> list[float]:
    """What each tick takes, all but waiting [us]."""
    costs = []
    loop.pacer.deadline = time.monotonic()
    for _ in range(int(seconds * RATE)):
        t = loop.pacer.next()
        loop.tick(t)
        loop.meter.note(t, loop.pacer, loop.samples)
        costs.append(1e6 * (time.monotonic() - t))
    check_excited(loop)
    return costs


def axes(rounds: int, seconds: float) -> dict[int, list[float]]:
    """Median cost of a tick [us], for 1 to 8 axes, one for each round."""
    loops = {count: make_loop(count) for count in AXES}
    for loop in loops.values():
        run_loop(loop, 0.2)
    found: dict[int, list[float]] = defaultdict(list)
    tails: dict[int, list[np.ndarray]] = defaultdict(list)
    for _ in range(rounds):
        for count, loop in loops.items():
            costs = tick_costs(loop, seconds)
            found[count].append(float(np.median(costs)))
            tails[count].append(np.quantile(costs, (0.1, 0.99)))
    medians = [statistics.median(found[count]) for count in AXES]
    slope, offset = np.polyfit(list(AXES), medians, 1)
    off = np.max(np.abs(np.polyval([slope, offset], list(AXES)) / medians - 1.0))
    print(
        f"tick, all but waiting [us], medians of {rounds} rounds of {seconds:g} s (goal: one axis 20, linear)"
    )
    print("  axes   " + "".join(f"{count:>8}" for count in AXES))
    print("  median " + "".join(f"{value:>8.1f}" for value in medians))
    for name, column in (("p10", 0), ("p99", 1)):
        values = [statistics.median(tail[column] for tail in tails[count]) for count in AXES]
        print(f"  {name:<7}" + "".join(f"{value:>8.1f}" for value in values))
    print(f"  line: {offset:.1f} + {slope:.1f} * axes, off by {100 * off:.0f} % at most")
    return found


def rate(rounds: int, seconds: float) -> dict[float, tuple[int, int, int]]:
    """Late ticks of the loop and of the C loop, and how many ticks each was due, by rate."""
    loops = {hz: make_loop(rate_hz=hz) for hz in RATES}
    late = {hz: [0, 0, 0] for hz in RATES}
    with tempfile.TemporaryDirectory() as folder:
        program = compile_c(folder)
        for _ in range(rounds):
            for hz, loop in loops.items():
                run_loop(loop, 0.05)
                late[hz][0] += loop_latencies(loop, seconds).late(1e6 / hz)
                late[hz][1] += run_c(program, seconds, hz).late(1e6 / hz)
                late[hz][2] += int(seconds * hz)
    print(
        f"ticks over a period late, {rounds} runs of {seconds:g} s each, in turns (goal: 10 kHz within 2 x)"
    )
    print("   rate [Hz]       seod     C loop   of ticks  within 2 x")
    for hz, (ours, theirs, ticks) in late.items():
        print(
            f"  {hz:>10.0f} {ours:>10} {theirs:>10} {ticks:>10}  {'yes' if ours <= 2 * theirs else 'no':>10}"
        )
    good = [hz for hz, (ours, theirs, _) in late.items() if ours <= 2 * theirs]
    print(f"  highest rate within 2 x: {max(good, default=0):.0f} Hz")
    return {hz: (ours, theirs, ticks) for hz, (ours, theirs, ticks) in late.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("lateness", "phases", "axes", "rate")
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"any of {', '.join(parts)}; all if left out"
    )
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=1.5, help="length of one run of `lateness`")
    parser.add_argument("--quick", action="store_true", help="shorter runs: for a look, not for figures")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="write PNG plots there")
    given = parser.parse_args()
    if unknown := set(given.parts) - set(parts):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(parts)}")
    pairs, seconds, rounds = (4, 0.6, 1) if given.quick else (given.pairs, given.seconds, 3)
    refused = enter_realtime(PRIORITY, None)
    print(read_machine().describe())
    print(f"SCHED_FIFO {PRIORITY}: {'; '.join(refused) or 'yes'}; load average {os.getloadavg()[0]:.1f}")
    work = {
        "lateness": lambda: lateness(pairs, seconds),
        "phases": lambda: phases(1.0 if given.quick else 3.0),
        "axes": lambda: axes(rounds, 0.4 if given.quick else 1.0),
        "rate": lambda: rate(2 if given.quick else 5, 0.4 if given.quick else 1.0),
    }
    found = {name: run() for name, run in work.items() if not given.parts or name in given.parts}
    if given.plots:
        import plots

        for path in plots.draw(found, given.plots, read_machine().describe()):
            print(f"wrote {path}")


if __name__ == "__main__":
    main()
