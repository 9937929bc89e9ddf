"""The simulated plant's kernel: beside the same in C, scipy and python-control; threads, start, memory.

    python bench/kernel.py [PART ...] [--quick]

Parts (all of them if none is named):
    c        relays and given input, each effect and all pairs, beside bench/kernel.c at -O2; results compared
    python   the same tasks at the same accuracy by solve_ivp and python-control
    threads  two runs at once, beside two of C
    start    a fresh process, with the cache and without; memory

What is compared takes turns; ratios are medians over the pairs of runs. At the end stands the table of
docs/performance.md. The whole takes two minutes, `--quick` half a minute. Ends with 1 where results differ.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from bench_pairs import Pairs, alternate, spent
from kernel_in_c import KernelInC
from kernel_runs import Kernel, everything_once, follow_once, relay_once
from kernel_start import starts
from kernel_tasks import NAMES, RATE, pairs, plant

from seod.latency.machine import read_machine
from sim.parameters import PARAMETERS
from sim.state import STATE

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

DIFFERENCE = 1e-9
"""Largest part of the movement's range by which the two programs' results may differ."""


@dataclass(frozen=True)
class Row:
    """A line of the table: what, against what, the figure, the goal."""

    what: str
    against: str
    figure: str
    goal: str = ""

    def markdown(self) -> str:
        return f"| {self.what} | {self.against} | {self.figure} | {self.goal} |"


@dataclass(frozen=True)
class Beside:
    """The kernel beside C in one task."""

    name: str
    timed: Pairs
    rows: int
    difference: float


class BesideC:
    """Runs tasks on both sides and compares times and results."""

    def __init__(self) -> None:
        self.ours, self.theirs = Kernel(), KernelInC()

    def run(self, name: str, task: Callable[[Kernel], NDArray], rounds: int) -> Beside:
        y, same = task(self.ours), task(self.theirs)
        timed = alternate(lambda: task(self.ours), lambda: task(self.theirs), rounds)
        return Beside(name, timed, len(y), float(np.max(np.abs(y - same)) / np.ptp(same)))

    def effects(self, names: tuple[str, ...], seconds: float, rounds: int) -> Beside:
        p = plant(*names)
        name = " + ".join(names) or "given input"
        return self.run(name, lambda kernel: follow_once(kernel, p, seconds), rounds)

    def all_pairs(self, seconds: float, rounds: int) -> list[Beside]:
        """All pairs of effects, in a few rounds each; in all of them the tenth that is farthest from C."""
        found = {names: self.effects(names, seconds, max(3, rounds // 4)) for names in pairs()}
        for names in sorted(found, key=lambda names: -found[names].timed.ratio)[: len(found) // 10]:
            found[names] = self.effects(names, seconds, rounds)
        return list(found.values())


def show(found: Beside) -> None:
    ours, theirs = (1e9 * median(times) / found.rows for times in (found.timed.first, found.timed.second))
    print(
        f"  {found.name:<44} {ours:>8.0f} {theirs:>8.0f} {found.timed.ratio:>7.2f} {found.difference:>9.0e}"
    )


def worst(found: list[Beside]) -> str:
    most = max(found, key=lambda each: each.timed.ratio)
    return f"{median(each.timed.ratio for each in found):.2f}, at most {most.timed.ratio:.2f} ({most.name})"


def beside_c(quick: bool) -> list[Row]:
    """The kernel against bench/kernel.c."""
    both, base, rounds = BesideC(), plant(), 11 if quick else 31
    print(f"a step of {1e3 / RATE:g} ms [ns], medians of {rounds} pairs of 4 s of plant time")
    print(f"  {'':<44} {'kernel':>8} {'C -O2':>8} {'ratio':>7} {'differ by':>9}")
    plain = [
        both.effects((), 4.0, rounds),
        both.run("sampled relay", lambda kernel: relay_once(kernel, base, 4.0, ideal=False), rounds),
        both.run("ideal relay", lambda kernel: relay_once(kernel, base, 4.0, ideal=True), rounds),
    ]
    single = [both.effects((name,), 4.0, rounds) for name in NAMES]
    for each in (*plain, *single):
        show(each)
    double = both.all_pairs(1.0, rounds)
    print(f"  {len(double)} pairs of effects: {worst(double)}; the five farthest from C:")
    for each in sorted(double, key=lambda each: -each.timed.ratio)[:5]:
        show(each)
    everything = [*plain, *single, *double]
    if off := [each for each in everything if not each.difference <= DIFFERENCE]:
        names = ", ".join(each.name for each in off)
        sys.exit(f"results differ from those of C, does bench/kernel.c still follow sim/? {names}")
    step = 1e9 * median(plain[0].timed.first) / plain[0].rows
    return [
        Row(
            "no effect, given input", "C at -O2", f"{plain[0].timed.ratio:.2f} ({step:.0f} ns a tick)", "1.5"
        ),
        *(Row(f"no effect, {each.name}", "C at -O2", f"{each.timed.ratio:.2f}", "1.5") for each in plain[1:]),
        Row(f"each of {len(single)} effects", "C at -O2", worst(single), "1.5"),
        Row(f"all {len(double)} pairs of them", "C at -O2", worst(double), "1.5"),
        Row(
            "results",
            "those of C",
            f"differ by {max(each.difference for each in everything):.0e} of the range",
        ),
    ]


def beside_python(quick: bool) -> list[Row]:
    """The kernel against solve_ivp and python-control."""
    import kernel_duels

    rows, rounds, seconds = [], 3 if quick else 10, 0.5 if quick else 1.0
    print(f"the same in Python, {seconds:g} s of plant time, medians of {rounds} pairs; error over the range")
    for task in kernel_duels.tasks(seconds):
        error, duels = kernel_duels.duels(task, rounds, quick)
        print(f"  {task.name}: kernel {1e3 * median(duels[0].timed.second):.3f} ms, error {error:.0e}")
        for duel in duels:
            took, times = 1e3 * median(duel.timed.first), f"{duel.timed.ratio:.0f} times as long"
            print(f"    {duel.rival:<16} {duel.setting:<13} {took:8.1f} ms, error {duel.error:.0e}: {times}")
            rows.append(
                Row(task.name, f"{duel.rival} ({duel.setting})", f"1 / {duel.timed.ratio:.0f}", "1 / 50")
            )
    return rows


def beside_itself(quick: bool) -> list[Row]:
    """Two runs at once in two threads against one alone, here and in C."""
    p, rounds, seconds = plant(), 5 if quick else 21, 200.0
    gains = {}
    with ThreadPoolExecutor(2) as pool:
        for name, kernel in (("kernel", Kernel()), ("C", KernelInC())):

            def work(kernel: Kernel = kernel) -> None:
                follow_once(kernel, p, seconds)

            def twice(work: Callable[[], None] = work) -> None:
                for running in [pool.submit(work) for _ in range(2)]:
                    running.result()

            gains[name] = 2.0 / alternate(twice, work, rounds).ratio
    print(f"two threads do {gains['kernel']:.2f} times the work of one; those of C {gains['C']:.2f}")
    return [Row("work of two threads", "one (in C)", f"{gains['kernel']:.2f} ({gains['C']:.2f})", "2, as C")]


def beside_nothing(quick: bool) -> list[Row]:
    """Start and memory."""
    found = starts(2 if quick else 5, 1 if quick else 2)
    print(f"a fresh process{'':<27}  wall [s]  processor [s]  resident [MiB]")
    for name, each in found.items():
        print(f"  {name:<40} {each.wall:>9.2f} {each.processor:>14.2f} {each.memory:>15.0f}")
    build = spent(KernelInC)
    print(f"  cc -O2 of the same: {build:.2f} s")
    print(f"  a plant: {PARAMETERS.itemsize} bytes of parameters, {STATE.itemsize} of state")
    warm, cold = (found[f"import and first runs, {how}"] for how in ("from the cache", "compiled anew"))
    return [
        Row("fresh process, cache warm, until the first runs have ended", "", f"{warm.wall:.2f} s", "1 s"),
        Row("the same, everything compiled", f"cc: {build:.2f} s", f"{cold.wall:.0f} s"),
        Row("memory of that process, warm", f"with numpy alone: {found['import numpy'].memory:.0f} MiB",
            f"{warm.memory:.0f} MiB"),
    ]  # fmt: skip


PARTS = {"c": beside_c, "python": beside_python, "threads": beside_itself, "start": beside_nothing}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}; all if left out"
    )
    parser.add_argument("--quick", action="store_true", help="shorter runs: for a look, not for figures")
    given = parser.parse_args()
    if unknown := set(given.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    print(read_machine().describe())
    print(f"load average {os.getloadavg()[0]:.1f}")
    everything_once()
    rows = [row for name, run in PARTS.items() if name in (given.parts or PARTS) for row in run(given.quick)]
    print("\n| the kernel | against | figure | goal |\n| --- | --- | --- | --- |")
    print("\n".join(row.markdown() for row in rows))


if __name__ == "__main__":
    main()
