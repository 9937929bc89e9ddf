"""The loop at 2 kHz on the virtual rig beside a bare loop and cyclictest: wake-up lateness, cost of a tick.

Each figure comes from alternating runs in this process (cyclictest: its own): the machine's noise meets
all of them alike. Usage: python bench/loop.py [pairs] [seconds]
"""

from __future__ import annotations

import re
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

from drivers.virtual import VirtualDriver, VirtualOptions
from seod.config.load import load_rig
from seod.loop.pacer import TimerPacer
from seod.loop.tick import Loop, input_channels
from seod.paths import configs_dir
from seod.realtime import enter_realtime
from seod.ring import Shared

PRIORITY = 50
RATE = 2000.0


def quantile(sorted_values: list[float], q: float) -> float:
    return sorted_values[min(len(sorted_values) - 1, int(q * len(sorted_values)))]


def figures(lateness_s: list[float]) -> tuple[float, float, float]:
    ordered = sorted(x * 1e6 for x in lateness_s)
    return quantile(ordered, 0.5), quantile(ordered, 0.99), quantile(ordered, 0.999)


def bare(seconds: float) -> list[float]:
    pacer = TimerPacer(1 / RATE)
    late = []
    for _ in range(int(seconds * RATE)):
        pacer.next()
        late.append(pacer.lateness)
    return late


def seod_loop(loop: Loop, seconds: float) -> tuple[list[float], list[float]]:
    late, cost = [], []
    loop.pacer.deadline = time.monotonic()  # type: ignore[attr-defined] # a TimerPacer
    for _ in range(int(seconds * RATE)):
        t = loop.pacer.next()
        loop.tick(t)
        loop.meter.note(t, loop.pacer, loop.samples)
        cost.append(time.monotonic() - t)
        late.append(loop.pacer.lateness)
    return late, cost


def cyclictest(seconds: float) -> tuple[float, float, float] | None:
    if shutil.which("cyclictest") is None:
        return None
    command = f"cyclictest -q -m -p {PRIORITY} -i {int(1e6 / RATE)} -l {int(seconds * RATE)} -h 20000"
    out = subprocess.run(command.split(), capture_output=True, text=True, check=True).stdout
    counts = [(int(a), int(b)) for a, b in re.findall(r"^(\d{6}) (\d{6,})", out, re.MULTILINE)]
    values = sorted(us for us, count in counts for _ in range(count))
    return quantile(values, 0.5), quantile(values, 0.99), quantile(values, 0.999)  # type: ignore[arg-type] # ints


def make_loop() -> Loop:
    config = load_rig(configs_dir() / "virtual.yaml")
    driver = VirtualDriver(VirtualOptions.model_validate(config.driver), time.monotonic)
    driver.open(input_channels(config), [o.channel for o in config.outputs.values()])
    driver.start()
    return Loop(config, driver, Shared(len(config.axes), 4096), TimerPacer(1 / RATE), 1)


def line(name: str, values: list[tuple[float, float, float]]) -> tuple[float, ...]:
    medians = tuple(statistics.median(column) for column in zip(*values, strict=True))
    print(f"  {name:<22}" + "".join(f"{value:>10.1f}" for value in medians))
    return medians


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 2.0
    loop = make_loop()
    refused = enter_realtime(PRIORITY, None)
    print(f"kernel {Path('/proc/version').read_text().split()[2]}, real-time: {refused or 'yes'}")
    seod_loop(loop, 0.2)
    loop.shared.commands.put({"id": 1, "op": "start", "axis": None, "values": {}})
    seod_loop(loop, 1.0)
    runs: dict[str, list[tuple[float, float, float]]] = {"bare loop": [], "seod loop": [], "cyclictest": []}
    costs: list[float] = []
    for _ in range(pairs):
        runs["bare loop"].append(figures(bare(seconds)))
        late, cost = seod_loop(loop, seconds)
        runs["seod loop"].append(figures(late))
        costs += cost
        reference = cyclictest(seconds)
        if reference is not None:
            runs["cyclictest"].append(reference)
    print(
        f"lateness at {RATE:.0f} Hz [us], medians of {pairs} runs of {seconds:g} s    p50       p99     p99.9"
    )
    medians = {name: line(name, values) for name, values in runs.items() if values}
    reference_name = "cyclictest" if "cyclictest" in medians else "bare loop"
    ratios = [a / b for a, b in zip(medians["seod loop"], medians[reference_name], strict=True)]
    print(f"  seod / {reference_name}: " + ", ".join(f"{ratio:.2f}" for ratio in ratios))
    costs.sort()
    print(
        f"tick, all but waiting: median {quantile(costs, 0.5) * 1e6:.1f} us (goal 20), "
        f"p99 {quantile(costs, 0.99) * 1e6:.1f} us; state {loop.axes[0].state.name}"
    )


if __name__ == "__main__":
    main()
