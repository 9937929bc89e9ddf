"""The fault matrix: what the rig sees of each fault, how soon it is at neutral, what the user is told.

Simulated whole (`tests/dst`): the daemon's own processes on simulated time, so that times are exact and each
row can be run again. `python bench/faults.py` prints the table; `--write` puts it into docs/faults.md.
"""

from __future__ import annotations

import argparse
import errno
import math
import signal
import statistics
import sys
import tempfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

REPO = Path(__file__).parents[1]
sys.path.insert(0, str(REPO))

from seod.record.mcap_file import McapFile  # noqa: E402
from tests.dst import exchange, faults, run, world  # noqa: E402

PAGE = REPO / "docs" / "faults.md"
BEGIN, END = "<!-- printed by bench/faults.py -->", "<!-- end -->"
EXCITED_S, WATCHED_S = 4.0, 3.5
"""The fault comes so long after the start, and is watched for so long [s]."""
PERIOD, WATCHDOG, HANG, SUPERVISOR = 0.01, 0.4, 0.1, 0.02
"""Tick, the rig's own watchdog, loop.hang_timeout (tests/dst/rig.yaml); the supervisor's promise [s]."""
STALE, FROZEN, GATEWAY, CONFIRM = 0.05, 0.5, 1.0, 0.05
UNSEEN = 0.75
"""guard.no_switch of a known limit cycle: four times its longest half, with a jitter of a tick [s]."""
WIRE, LINE = 0.004, 0.005
TITLES = "fault | promised [ms] | p50 [ms] | max [ms] | unguarded runs | rows lost | what clients are told"
HEAD = f"| {TITLES} |\n| --- | --- | --- | --- | --- | --- | --- |"
TWO_TICKS = 2 * PERIOD + WIRE


class Row(NamedTuple):
    """One fault. `promised` is the longest time to neutral [s]; inf where the rig may go on."""

    name: str
    kind: str
    numbers: dict[str, Any]
    promised: float
    record: bool = False
    wire: str = "can"


def _wrong_sign(this: run.Run, numbers: dict[str, Any]) -> None:
    plant = this.rig.plant
    plant.K_L = -plant.K_L
    this.world.at(this.world.now + numbers["for"], lambda: setattr(plant, "K_L", abs(plant.K_L)))


def _exception(this: run.Run, _: dict[str, Any]) -> None:
    process = this.processes["loop"]

    def grip(_: str) -> None:
        raise RuntimeError(world.INJECTED)

    process.grip = grip


def _estop(this: run.Run, _: dict[str, Any]) -> None:
    this.operator.client.call("estop")


def _recorder_without_memory(this: run.Run, numbers: dict[str, Any]) -> None:
    rows = McapFile.rows

    def refused(*_: object) -> None:
        raise MemoryError

    def again() -> None:
        McapFile.rows = rows  # type: ignore[method-assign]

    McapFile.rows = refused  # type: ignore[assignment,method-assign]
    this.world.at(this.world.now + numbers["for"], again)


def _gateway_without_memory(this: run.Run, _: dict[str, Any]) -> None:
    def grip(_: str) -> None:
        raise MemoryError(world.INJECTED)

    this.processes["gateway"].grip = grip


def _pump(this: run.Run, numbers: dict[str, Any]) -> None:
    for k in range(round(numbers["for"] / 0.01)):
        this.world.at(this.world.now + 0.01 * k, lambda: faults.KINDS["flood"].do(this, numbers))


OWN = {
    "board_loss": faults.Kind(0, lambda _: {}, faults.sensor("loss", 0, 0.0)),
    "wrong_sign": faults.Kind(0, lambda _: {}, _wrong_sign),
    "exception": faults.Kind(0, lambda _: {}, _exception),
    "estop": faults.Kind(0, lambda _: {}, _estop),
    "no_memory": faults.Kind(0, lambda _: {}, _recorder_without_memory),
    "no_memory_gateway": faults.Kind(0, lambda _: {}, _gateway_without_memory),
    "pump": faults.Kind(0, lambda _: {}, _pump),
}
LONG = {"for": 3.0}
FLOOD = {"method": "status", "count": 400}
DISK = {"for": 2.0, "slow": 0.0, "code": 0}
FOREIGN = {"volts": 0.3, "counter": 5}

ROWS = [
    Row("loop killed", "kill", {"who": "loop", "points": 0}, SUPERVISOR),
    Row("loop killed within a tick", "kill", {"who": "loop", "points": 3}, SUPERVISOR + PERIOD),
    Row("loop hung", "stop", {"who": "loop", "points": 0, **LONG}, HANG + 0.025 + SUPERVISOR),
    Row("exception in the tick", "exception", {}, TWO_TICKS),
    Row("gateway killed", "kill", {"who": "gateway", "points": 0}, TWO_TICKS),
    Row("gateway hung", "stop", {"who": "gateway", "points": 0, **LONG}, GATEWAY + 0.05 + TWO_TICKS),
    Row("estimating process killed", "kill", {"who": "observe", "points": 0}, 0.1 + TWO_TICKS),
    Row("estimating process hung 3 s", "stop", {"who": "observe", "points": 0, **LONG}, math.inf),
    Row("supervisor killed", "kill", {"who": "supervisor", "points": 0}, TWO_TICKS),
    Row("supervisor hung", "stop", {"who": "supervisor", "points": 0, **LONG}, 0.18 + PERIOD + TWO_TICKS),
    Row("all processes killed", "kill_all", {}, WATCHDOG + 0.02),
    Row("interface down 1 s", "down", {"for": 1.0}, WATCHDOG + 0.02),
    Row("interface gone 1 s", "gone", {"for": 1.0}, WATCHDOG + 0.02),
    Row("bus-off 1 s", "bus_off", {"for": 1.0}, WATCHDOG + 0.02),
    Row("nobody acknowledges, queue full, 1 s", "cut", {"for": 1.0}, WATCHDOG + 0.02),
    Row("error passive", "passive", {}, math.inf),
    Row("sensor silent", "silent", LONG, STALE + TWO_TICKS),
    Row("sensor frozen", "frozen", LONG, FROZEN + TWO_TICKS),
    Row("sensor of another, still axis", "other_axis", LONG, UNSEEN + TWO_TICKS),
    Row("sensor frames damaged", "corrupt", LONG, STALE + TWO_TICKS),
    Row("sensor out of range", "jump", {"value": 3.0, **LONG}, PERIOD + TWO_TICKS),
    Row("plant of the wrong sign", "wrong_sign", LONG, 1.5),
    Row("frames lost, 1 %", "lost", {"value": 0.01, **LONG}, math.inf),
    Row("frames lost, 50 %", "lost", {"value": 0.5, **LONG}, math.inf),
    Row("frames in wrong order", "swapped", {"value": 0.5, **LONG}, math.inf),
    Row("frames twice", "twice", {"value": 1.0, **LONG}, math.inf),
    Row("frames delayed, 20 ms", "delayed", {"value": 0.02, **LONG}, math.inf),
    Row("another node commands", "foreign", {**FOREIGN, "local": False}, TWO_TICKS),
    Row("another program commands", "foreign", {**FOREIGN, "local": True}, TWO_TICKS),
    Row("95 % bus load, 2 s", "load", {"for": 2.0}, math.inf),
    Row("clock stepped by -1 h", "clock", {"by": -3600.0}, math.inf),
    Row("clock stepped by +1 day", "clock", {"by": 86400.0}, math.inf),
    Row("disk full", "disk", {**DISK, "code": errno.ENOSPC}, math.inf, record=True),
    Row("disk slow, 1.5 s an access", "disk", {**DISK, "slow": 1.5}, math.inf, record=True),
    Row("disk pulled", "disk", {**DISK, "code": errno.EIO}, math.inf, record=True),
    Row(
        "processor taken, loop up to 8 ms late", "busy", {"who": "loop", "late": 0.008, "for": 3.0}, math.inf
    ),
    Row(
        "processor taken, loop up to 60 ms late", "busy", {"who": "loop", "late": 0.06, "for": 3.0}, math.inf
    ),
    Row("client floods 400 requests", "flood", FLOOD, math.inf),
    Row("120 clients with half a line", "loris", {"count": 120, **LONG}, math.inf),
    Row("e-stop line opened", "estop_line", LONG, PERIOD + TWO_TICKS),
    Row("e-stop by a client", "estop", {}, 0.02 + TWO_TICKS),
    Row("clients ask 2000 times a second, 1 s", "pump", {"method": "get", "count": 20, "for": 1.0}, math.inf),
    Row("recorder gets no memory", "no_memory", LONG, math.inf, record=True),
    Row("gateway gets no memory for a request", "no_memory_gateway", {}, math.inf),
]

SERIAL_ROWS = [
    Row("loop killed", "kill", {"who": "loop", "points": 0}, SUPERVISOR + LINE),
    Row("loop hung", "stop", {"who": "loop", "points": 0, **LONG}, HANG + 0.025 + SUPERVISOR + LINE),
    Row("supervisor killed", "kill", {"who": "supervisor", "points": 0}, TWO_TICKS),
    Row("all processes killed", "kill_all", {}, WATCHDOG + 0.02),
    Row("port gone 1 s (adapter unplugged)", "unplugged", {"for": 1.0}, WATCHDOG + 0.02),
    Row("cable cut 1 s, port stays", "cable", {"for": 1.0}, WATCHDOG + 0.02),
    Row("board of another bit rate 1 s", "other_baud", {"for": 1.0}, WATCHDOG + 0.02),
    Row("board restarts", "restart", {}, TWO_TICKS),
    Row("samples stop", "silent", LONG, STALE + TWO_TICKS),
    Row("samples damaged", "corrupt", LONG, STALE + TWO_TICKS),
    Row("samples lost, 5 %", "board_loss", {"value": 0.05, **LONG}, math.inf),
    Row("samples delayed, 20 ms", "delayed", {"value": 0.02, **LONG}, math.inf),
    Row("bytes lost, 0.1 % (overrun)", "bytes_lost", {"value": 0.001, **LONG}, math.inf),
    Row("bytes lost, 5 % (overrun)", "bytes_lost", {"value": 0.05, **LONG}, math.inf),
    Row("garbage before each fifth write", "noise", {"value": 0.2, **LONG}, math.inf),
    Row("sensor NaN", "nan", LONG, PERIOD + TWO_TICKS),
    Row("sensor frozen", "frozen", LONG, FROZEN + TWO_TICKS),
    Row("sensor out of range", "jump", {"value": 3.0, **LONG}, PERIOD + TWO_TICKS),
    Row(
        "channels swapped: pressure for angle", "exchanged", {"value": "pressure", **LONG}, PERIOD + TWO_TICKS
    ),
    Row(
        "channels swapped: angle of a still axis",
        "exchanged",
        {"value": "still", **LONG},
        UNSEEN + TWO_TICKS,
    ),
    Row("e-stop line opened", "estop_line", LONG, PERIOD + TWO_TICKS),
]
ROWS += [each._replace(name=f"serial line: {each.name}", wire="serial") for each in SERIAL_ROWS]


class Seen(NamedTuple):
    """One run. `neutral` is the time to neutral [s]; inf where the rig went on."""

    neutral: float
    failures: list[str]
    lost: int
    told: str


def observe(row: Row, seed: int) -> Seen:
    """One run of a row."""
    this_world = world.World(seed)
    system = exchange.System(this_world, row.wire)
    with tempfile.TemporaryDirectory(prefix="seod-faults-") as folder, exchange.exchanged(system):
        this = run.Run(this_world, system, Path(folder), record=row.record)
        try:
            return _observed(this, row, seed)
        finally:
            this.ending = True
            this_world.after_step = lambda: None
            for process in list(this_world.processes.values())[::-1]:
                this_world.bury(process, -int(signal.SIGKILL))


def _observed(this: run.Run, row: Row, seed: int) -> Seen:
    w, changes, told, health = this.world, [], Counter[str](), {}
    put_out, operator = this.rig._set, this.operator

    def note(volts: float) -> None:
        if volts != this.rig.volts:
            changes.append((w.now, volts))
        put_out(volts)

    def hear(topic: str, params: dict[str, Any]) -> None:
        this.checks.heard(topic, params)
        if topic == "event" and params["event"] in ("fault", "warning") and w.now >= fault_t:
            told[f"{params['event']} {params['code']}"] += 1
        elif topic == "health":
            health.update(params)

    this.rig._set = note  # type: ignore[method-assign]
    this.watcher.client.heard = hear
    operator.plain = True
    fault_t = world.START_S + EXCITED_S + Random(f"{seed} {row.name}").uniform(0.0, 0.3)
    this.launch()
    w.run(fault_t)
    assert operator.state == "exciting", operator.state
    operator.calm = True
    w.note(f"fault {row.name}")
    (OWN.get(row.kind) or faults.KINDS[row.kind]).do(this, row.numbers)
    w.run(fault_t + WATCHED_S)
    if not told and operator.fault:
        told[f"`get`: {operator.fault['code']}"] += 1
    if this.starts > 1:
        told["the unit starts it again"] += 1
    return Seen(_neutral_after(changes, fault_t), w.failures, lost_rows(health), words(told))


def _neutral_after(changes: list[tuple[float, float]], t: float) -> float:
    """From `t` until it is 0 V for at least half a second."""
    if not changes or [volts for at, volts in changes if at < t][-1:] == [0.0]:
        return 0.0
    later = [each for each in changes if each[0] >= t]
    for (at, volts), following in pairwise([*later, (math.inf, 0.0)]):
        if volts == 0.0 and following[0] - at > 0.5:
            return at - t
    return math.inf


def lost_rows(health: dict[str, Any]) -> int:
    """Rows lost in the ring or by the recorder."""
    recorder = health.get("recorder") or {}
    return int(health.get("rows_lost", 0)) + int(recorder.get("lost", 0))


def words(told: Counter[str]) -> str:
    """What was told, most often first; the supervisor's part is in the journal."""
    return ", ".join(name for name, _ in told.most_common(3)) or "nothing"


def line(row: Row, runs: list[Seen]) -> str:
    """One line of the table."""
    times = [each.neutral for each in runs]
    went_on = sum(math.isinf(t) for t in times)
    finite = sorted(t for t in times if math.isfinite(t))
    middle = f"{1e3 * statistics.median(finite):.1f}" if finite else "goes on"
    longest = f"{1e3 * finite[-1]:.1f}" if finite else "goes on"
    if finite and went_on:
        longest += f" ({went_on} of {len(runs)} go on)"
    promised = "may go on" if math.isinf(row.promised) else f"{1e3 * row.promised:.0f}"
    unguarded = sum(bool(each.failures) for each in runs)
    lost = max(each.lost for each in runs)
    told = Counter(each.told for each in runs).most_common(1)[0][0]
    return f"| {row.name} | {promised} | {middle} | {longest} | {unguarded} | {lost} | {told} |"


def kept(row: Row, runs: list[Seen]) -> bool:
    """Whether what is promised was kept in each run."""
    return all(each.neutral <= row.promised and not each.failures for each in runs)


def write(lines: dict[str, str], caption: str) -> None:
    """Put rows into the page, beside those that were not measured anew."""
    head, _, rest = PAGE.read_text().partition(BEGIN)
    before, _, tail = rest.partition(END)
    there = {each.split(" | ")[0].removeprefix("| "): each for each in before.splitlines()}
    table = [each for row in ROWS if (each := lines.get(row.name) or there.get(row.name))]
    PAGE.write_text("\n".join([f"{head}{BEGIN}", caption, "", HEAD, *table, f"{END}{tail}"]))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each row")
    parser.add_argument("--only", default="", help="rows that have one of these in their name, by comma")
    parser.add_argument("--write", action="store_true", help="into docs/faults.md")
    given = parser.parse_args()
    print(HEAD)
    lines: dict[str, str] = {}
    broken = []
    for row in ROWS:
        if any(part in row.name for part in given.only.split(",")):
            runs = [observe(row, seed) for seed in range(1, given.runs + 1)]
            lines[row.name] = line(row, runs)
            print(lines[row.name], flush=True)
            if not kept(row, runs):
                broken.append(row.name)
                print("   not kept:", *{f for each in runs for f in each.failures}, flush=True)
            if given.write:
                write(lines, f"{given.runs} runs a row; not kept: {', '.join(broken) or 'none'}.")
    print(f"{len(lines)} rows, {given.runs} runs each; not kept: {', '.join(broken) or 'none'}")
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
