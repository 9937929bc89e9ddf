"""Measure latencies: cyclictest or a bare timer on one side, the real loop on a virtual rig on the other.

The loop runs in a process of its own (`python -m seod.latency.measure ARGS`), for real-time set-up cannot be
undone. Both sides take turns, so that what disturbs the machine meanwhile meets both.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections import Counter
from typing import Any

from seod.config.model import RigConfig
from seod.latency.machine import read_machine
from seod.latency.report import Latencies, Report, count_seconds, parse_cyclictest
from seod.loop.pacer import TimerPacer
from seod.loop.process import make_driver
from seod.loop.tick import Loop
from seod.processes.realtime import enter_realtime
from seod.processes.ring import AxisState, Shared

PRIORITY = 50
TURNS = 2
RANGE_US = 20_000
"""Latencies that cyclictest tells apart; longer ones count as its worst."""

WARM_UP_S = 0.3
"""First ticks of a process fault pages in; a daemon has them behind it when its rig is started."""


class MeasureError(Exception):
    """Latencies could not be measured; the message says why."""


def virtual_rig(axes: int = 1, rate_hz: float = 2000.0) -> RigConfig:
    """A simulated rig of equal axes, excited for as long as anyone wants."""
    names = [f"axis{k}" for k in range(axes)]
    plants = {
        name: {
            "input": f"{name}.valve",
            "output": f"{name}.angle",
            "K_L": 17.0,
            "omega_n": 117.0,
            "zeta": 0.21,
            "noise": 1e-3,
            "effects": {"sensor_quantization": {"step": 1e-6}},
        }
        for name in names
    }
    simulation = {"plants": plants, "watchdog_s": 1.0}
    limits = {"output": 2.0, "travel": (-1e3, 1e3), "speed": 1e3, "amplitude": 1e3, "excitation": 1e6}
    axis = {"K_L": 17.0, "relay": {"e_a": 0.5, "hysteresis": 4e-3}, "limits": limits}
    axis["polarity"] = {"enabled": False, "movement": 0.03}
    document = {
        "version": 1,
        "rig": "latency",
        "driver": {"kind": "virtual", "realtime": True, "simulation": simulation},
        "loop": {"rate_hz": rate_hz, "hang_timeout": 3600.0},
        "sensors": {name: {"channel": f"{name}.angle", "unit": "rad"} for name in names},
        "outputs": {name: {"channel": f"{name}.valve"} for name in names},
        "axes": {name: {"sensor": name, "output": name, **axis} for name in names},
        "guard": {"rig_watchdog": 1.0, "overruns": {"count": 1_000_000}, "stale": 3600.0},
        "simulation": simulation,
    }
    return RigConfig.model_validate_json(json.dumps(document))


def make_loop(axes: int = 1, rate_hz: float = 2000.0) -> Loop:
    """The loop on that rig, its axes excited from the next tick on; nobody reads its rows."""
    config = virtual_rig(axes, rate_hz)
    pacer = TimerPacer(1.0 / rate_hz)
    loop = Loop(config, make_driver(config, pacer.now), Shared(axes, 4096), pacer, 1)
    loop.shared.commands.put({"id": 1, "op": "start", "axis": None, "values": {}})
    return loop


def run_loop(loop: Loop, seconds: float) -> list[float]:
    """Tick for so long; how late each tick began [s]."""
    late, pacer = [], loop.pacer
    assert isinstance(pacer, TimerPacer)  # noqa: S101 - `make_loop` made it
    pacer.deadline = time.monotonic()
    end = pacer.deadline + seconds
    while pacer.deadline < end:
        t = pacer.next()
        loop.tick(t)
        loop.meter.note(t, pacer, loop.samples)
        late.append(pacer.lateness)
    return late


def run_bare(seconds: float, rate_hz: float) -> list[float]:
    """Only wait, at the loop's rate; how late each waking was [s]."""
    pacer = TimerPacer(1.0 / rate_hz)
    late = []
    for _ in range(round(seconds * rate_hz)):
        pacer.next()
        late.append(pacer.lateness)
    return late


def run_cyclictest(seconds: float, rate_hz: float, priority: int = PRIORITY) -> Latencies:
    """Latencies by cyclictest at this priority.

    Raises:
        MeasureError: It is not there, or not permitted.
    """
    program = shutil.which("cyclictest")
    if program is None:
        raise MeasureError("cyclictest is not installed (Debian, Ubuntu: sudo apt-get install rt-tests)")
    loops = max(1, round(seconds * rate_hz))
    options = f"-q -m -p {priority} -i {round(1e6 / rate_hz)} -l {loops} -h {RANGE_US}".split()
    done = subprocess.run([program, *options], capture_output=True, text=True, check=False)  # noqa: S603 - as found
    try:
        return parse_cyclictest(done.stdout)
    except ValueError as error:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise MeasureError(f"cyclictest failed: {said[0] if said else error}") from error


def measure(seconds: float, rate_hz: float = 2000.0) -> Report:
    """Machine and loop for about `seconds` in all, in turns.

    Raises:
        MeasureError: The loop's process failed.
    """
    slice_s = seconds / (2 * TURNS)
    note = ""
    try:
        machine = run_cyclictest(slice_s, rate_hz)
    except MeasureError as error:
        note = f"{error}: the machine's latency is that of seod's own bare loop."
        machine, _ = _in_child("bare", slice_s, rate_hz)
    loop, refusals = _in_child("loop", slice_s, rate_hz)
    for _ in range(TURNS - 1):
        machine += _in_child("bare", slice_s, rate_hz)[0] if note else run_cyclictest(slice_s, rate_hz)
        loop += _in_child("loop", slice_s, rate_hz)[0]
    return Report(machine, loop, rate_hz, refusals, read_machine(), note)


def _in_child(what: str, seconds: float, rate_hz: float) -> tuple[Latencies, list[str]]:
    command = [sys.executable, "-m", "seod.latency.measure", what, repr(seconds), repr(rate_hz)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    if done.returncode != 0:
        raise MeasureError(f"the {what} process failed: {done.stderr.strip() or done.returncode}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return Latencies(answer["source"], Counter(dict(answer["counts"]))), answer["refusals"]


def main() -> None:
    """The measuring process: prints its latencies and what the machine refused it as JSON."""
    what, seconds, rate_hz = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    loop = make_loop(rate_hz=rate_hz)
    refusals = enter_realtime(PRIORITY, None)
    if what == "loop":
        run_loop(loop, WARM_UP_S)
        found = count_seconds("the loop", run_loop(loop, seconds))
        if loop.axes[0].course.state is not AxisState.EXCITING:
            sys.exit(f"the loop did not stay excited: {list(loop.shared.events.take())}")
    else:
        found = count_seconds("bare loop", run_bare(seconds, rate_hz))
    loop.driver.close()
    loop.shared.close()
    sys.stdout.write(json.dumps({**found.as_json(), "refusals": refusals}))


if __name__ == "__main__":
    main()
