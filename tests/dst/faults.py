"""Faults: each at a time, of a kind, with its numbers; any part of a run's list can be run.

A kind is one record: how its numbers are drawn, and what it does to the system.
"""

from __future__ import annotations

import errno
import signal
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tests.dst.clients import Client
from tests.dst.frames import valve_frame

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from tests.dst.run import Run
    from tests.dst.world import Process

Numbers = dict[str, Any]


@dataclass(frozen=True)
class Fault:
    """One fault."""

    t: float
    kind: str
    numbers: Numbers = field(default_factory=dict)

    def __str__(self) -> str:
        numbers = " ".join(f"{key}={value}" for key, value in self.numbers.items())
        return f"{self.t:.4f} {self.kind} {numbers}".rstrip()


@dataclass(frozen=True)
class Kind:
    """What a kind of fault is; `weight` is how often it is drawn, `wires` where it makes sense."""

    weight: float
    draw: Callable[[Random], Numbers]
    do: Callable[[Run, Numbers], None]
    wires: tuple[str, ...] = ("can", "serial")


def _span(rng: Random, short: float, long: float) -> float:
    """A time [s] between two, short ones more often."""
    return round(short * (long / short) ** rng.random(), 5)


def _process(run: Run, name: str) -> Process | None:
    return run.processes.get(name)


def _kill(run: Run, numbers: Numbers) -> None:
    process = _process(run, numbers["who"])
    if process is None or not process.alive:
        return

    def now(_: str = "") -> None:
        run.checks.touched(process)
        run.world.kill(process, signal.SIGKILL)

    _at_a_point(run, process, numbers, now)


def _at_a_point(run: Run, process: Process, numbers: Numbers, do: Callable[[str], None]) -> None:
    """At once, or at the so many-th point within its next steps."""
    left = numbers["points"]
    if left == 0:
        do("")
        return

    def grip(place: str) -> None:
        nonlocal left
        left -= 1
        if left > 0:
            process.grip = grip
        elif process.able:
            run.world.note(f"gripped {process.name} at {place}")
            do(place)
            if process.stopped:
                run.world.block()
            elif not process.alive:
                run.world.me()

    process.grip = grip


def _stop(run: Run, numbers: Numbers) -> None:
    process = _process(run, numbers["who"])
    if process is None or not process.able:
        return

    def go_on() -> None:
        if process.alive:
            run.checks.touched(process)
            run.world.kill(process, signal.SIGCONT)

    def now(_: str = "") -> None:
        run.checks.touched(process)
        run.world.kill(process, signal.SIGSTOP)
        for task in process.tasks:
            task.due = True
        run.world.at(run.world.now + numbers["for"], go_on)

    _at_a_point(run, process, numbers, now)


def _term(run: Run, _: Numbers) -> None:
    process = _process(run, "supervisor")
    if process is not None and process.able:
        run.checks.touched(process)
        run.world.kill(process, signal.SIGTERM)


def _kill_all(run: Run, _: Numbers) -> None:
    for name in ("supervisor", "loop", "gateway", "observe"):
        process = _process(run, name)
        if process is not None and process.alive:
            run.checks.touched(process)
            run.world.kill(process, signal.SIGKILL)


def _bus(**state: Any) -> Callable[[Run, Numbers], None]:
    """The bus in another state for a while."""

    def do(run: Run, numbers: Numbers) -> None:
        bus = run.system.bus
        before = {name: getattr(bus, name) for name in state}
        if before == state:
            return
        bus.set_state(**state)
        run.world.at(run.world.now + numbers["for"], lambda: run.heal_bus(before))

    return do


def sensor(name: str, value: Any, back: Any) -> Callable[[Run, Numbers], None]:
    """The rig's sensors in another state for a while."""

    def do(run: Run, numbers: Numbers) -> None:
        setattr(run.rig, name, numbers.get("value", value))
        run.world.at(run.world.now + numbers["for"], lambda: setattr(run.rig, name, back))

    return do


def _foreign(run: Run, numbers: Numbers) -> None:
    data = valve_frame(numbers["volts"], numbers["counter"])
    if numbers["local"]:
        run.system.bus.send_local(data)
    else:
        run.system.bus.put(513, data)


def _clock(run: Run, numbers: Numbers) -> None:
    run.system.time.offset += numbers["by"]


def _disk(run: Run, numbers: Numbers) -> None:
    """The disk fails, or is slow, for a while."""
    code, slow = numbers["code"], numbers["slow"]

    def access(_: str) -> None:
        if slow:
            run.world.block(run.world.now + slow)
        if code:
            raise OSError(code, errno.errorcode[code])

    def whole() -> None:
        run.system.os.disk = lambda _: None

    run.system.os.disk = access
    run.world.at(run.world.now + numbers["for"], whole)


def _busy(run: Run, numbers: Numbers) -> None:
    """Something takes the processor from a process again and again: it wakes up late."""
    process = _process(run, numbers["who"])
    if process is None or not process.able:
        return
    run.checks.touched(process)

    def calm() -> None:
        run.checks.disturbed[process.pid] = run.world.now + numbers["late"]  # a wait that began before
        process.taken_by.remove(numbers["late"])

    process.taken_by.append(numbers["late"])
    run.world.at(run.world.now + numbers["for"], calm)


def _flood(run: Run, numbers: Numbers) -> None:
    client = Client(run.world, run.system.network, "flood")
    if client.connect():
        line = b'{"jsonrpc":"2.0","id":1,"method":"%s"}\n' % numbers["method"].encode()
        client.asked = _Anything()
        client.send(line * numbers["count"])
        run.world.at(run.world.now + 2.0, client.leave)


class _Anything(dict[int, tuple[str, float]]):
    def pop(self, *_: Any) -> Any:
        return "flood", 0.0


def _garbage(run: Run, numbers: Numbers) -> None:
    client = Client(run.world, run.system.network, "garbage")
    if client.connect():
        client.asked = _Anything()
        client.send(bytes.fromhex(numbers["data"]))
        run.world.at(run.world.now + 1.0, client.leave)


def _loris(run: Run, numbers: Numbers) -> None:
    """Clients that connect, say half a line, and hold on."""
    for _ in range(numbers["count"]):
        client = Client(run.world, run.system.network, "loris")
        if client.connect():
            client.send(b'{"jsonrpc"')
            run.world.at(run.world.now + numbers["for"], client.leave)


def _deaf(run: Run, numbers: Numbers) -> None:
    client = run.watcher.client
    client.reads = False
    run.world.at(run.world.now + numbers["for"], client.read_again)


def _cut_client(run: Run, numbers: Numbers) -> None:
    (run.watcher if numbers["who"] == "watcher" else run.operator).client.leave()


def _line(name: str) -> Callable[[Run, Numbers], None]:
    """A number of the line for a while."""

    def do(run: Run, numbers: Numbers) -> None:
        run.heal_bus({name: numbers["value"]})
        run.world.at(run.world.now + numbers["for"], lambda: run.heal_bus({name: 0.0}))

    return do


CAN, SERIAL = ("can",), ("serial",)
WHO = ("loop", "gateway", "observe", "supervisor")


def _who(rng: Random) -> str:
    return rng.choices(WHO, (4, 3, 2, 2))[0]


KINDS: dict[str, Kind] = {
    "kill": Kind(3, lambda r: {"who": _who(r), "points": r.choice([0, *range(1, 12)])}, _kill),
    "stop": Kind(
        4,
        lambda r: {"who": _who(r), "for": _span(r, 0.005, 2.5), "points": r.choice([0, *range(1, 12)])},
        _stop,
    ),
    "busy": Kind(
        3, lambda r: {"who": _who(r), "late": _span(r, 0.001, 0.06), "for": _span(r, 0.05, 1)}, _busy
    ),
    "term": Kind(0.4, lambda _: {}, _term),
    "kill_all": Kind(0.4, lambda _: {}, _kill_all),
    "down": Kind(2, lambda r: {"for": _span(r, 0.002, 2)}, _bus(up=False), CAN),
    "gone": Kind(1, lambda r: {"for": _span(r, 0.01, 2)}, _bus(there=False), CAN),
    "bus_off": Kind(2, lambda r: {"for": _span(r, 0.005, 1)}, _bus(off=True), CAN),
    "cut": Kind(2, lambda r: {"for": _span(r, 0.002, 1)}, _bus(cut=True), CAN),
    "load": Kind(2, lambda r: {"for": _span(r, 0.01, 1)}, _bus(slow=20.0), CAN),
    "passive": Kind(0.5, lambda _: {}, lambda run, _: run.system.bus.passive(), CAN),
    "silent": Kind(3, lambda r: {"for": _span(r, 0.005, 0.5)}, sensor("silent", True, False)),
    "frozen": Kind(2, lambda r: {"for": _span(r, 0.1, 1.5)}, sensor("frozen", True, False)),
    "corrupt": Kind(1, lambda r: {"for": _span(r, 0.005, 0.5)}, sensor("corrupt", True, False)),
    "lost": Kind(
        2, lambda r: {"value": r.uniform(0.01, 0.5), "for": _span(r, 0.1, 2)}, sensor("loss", 0, 0.0)
    ),
    "twice": Kind(
        1, lambda r: {"value": r.uniform(0.1, 1), "for": _span(r, 0.1, 2)}, sensor("twice", 0, 0.0), CAN
    ),
    "swapped": Kind(
        1, lambda r: {"value": r.uniform(0.1, 1), "for": _span(r, 0.1, 2)}, sensor("swap", 0, 0.0), CAN
    ),
    "delayed": Kind(
        2, lambda r: {"value": _span(r, 0.001, 0.1), "for": _span(r, 0.1, 1)}, sensor("delay", 0, 0.0)
    ),
    "jump": Kind(
        2, lambda r: {"value": r.uniform(-2, 2), "for": _span(r, 0.01, 0.5)}, sensor("offset", 0, 0.0)
    ),
    "other_axis": Kind(1, lambda r: {"for": _span(r, 0.01, 2)}, sensor("instead", "still", ""), CAN),
    "estop_line": Kind(2, lambda r: {"for": _span(r, 0.01, 1)}, sensor("run", False, True)),
    "foreign": Kind(
        1,
        lambda r: {
            "volts": r.choice([-0.4, 0.2, 5.0]),
            "counter": r.randrange(16),
            "local": r.random() < 0.5,
        },
        _foreign,
        CAN,
    ),
    "clock": Kind(2, lambda r: {"by": r.choice([-3600.0, -1.0, -0.01, 0.01, 1.0, 86400.0])}, _clock),
    "disk": Kind(
        1,
        lambda r: {
            "code": r.choice([0, errno.ENOSPC, errno.EIO]),
            "slow": r.choice([0.0, 0.1, 1.5]),
            "for": _span(r, 0.1, 3),
        },
        _disk,
    ),
    "flood": Kind(
        1,
        lambda r: {"method": r.choice(["get", "status", "list", "keepalive"]), "count": r.randrange(1, 400)},
        _flood,
    ),
    "garbage": Kind(1, lambda r: {"data": r.randbytes(r.randrange(1, 300)).hex() + "0a"}, _garbage),
    "loris": Kind(0.5, lambda r: {"count": r.randrange(1, 120), "for": _span(r, 0.1, 4)}, _loris),
    "deaf": Kind(1, lambda r: {"for": _span(r, 0.1, 4)}, _deaf),
    "client_gone": Kind(1, lambda r: {"who": r.choice(["watcher", "operator"])}, _cut_client),
    "unplugged": Kind(2, lambda r: {"for": _span(r, 0.01, 2)}, _bus(there=False), SERIAL),
    "cable": Kind(2, lambda r: {"for": _span(r, 0.002, 1)}, _bus(cut=True), SERIAL),
    "other_baud": Kind(1, lambda r: {"for": _span(r, 0.01, 1)}, _bus(other_baud=True), SERIAL),
    "bytes_lost": Kind(
        2, lambda r: {"value": r.uniform(0.001, 0.1), "for": _span(r, 0.05, 2)}, _line("loss"), SERIAL
    ),
    "noise": Kind(
        2, lambda r: {"value": r.uniform(0.01, 0.5), "for": _span(r, 0.05, 2)}, _line("noise"), SERIAL
    ),
    "restart": Kind(1, lambda _: {}, lambda run, _: run.rig.restart(), SERIAL),
    "nan": Kind(2, lambda r: {"for": _span(r, 0.005, 0.5)}, sensor("nan", True, False), SERIAL),
    "exchanged": Kind(
        1,
        lambda r: {"value": r.choice(["still", "pressure"]), "for": _span(r, 0.01, 0.5)},
        sensor("instead", "", ""),
        SERIAL,
    ),
}


def drawn(rng: Random, count: int, first: float, last: float, wire: str) -> list[Fault]:
    """So many faults between two times [s], in order."""
    names = [name for name, kind in KINDS.items() if wire in kind.wires]
    weights = [KINDS[name].weight for name in names]
    times = sorted(round(rng.uniform(first, last), 4) for _ in range(count))
    faults = []
    for t in times:
        name = rng.choices(names, weights)[0]
        faults.append(Fault(t, name, KINDS[name].draw(rng)))
    return faults
