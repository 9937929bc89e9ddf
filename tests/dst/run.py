"""One run: the daemon, a rig, clients and a list of faults, under one seed; then everything is healed."""

from __future__ import annotations

import gc
import json
import logging
import os
import signal
import sys
import tempfile
import warnings
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import seod.supervisor.process
from seod.config.load import load_rig
from seod.launch.daemon import ring_rows
from seod.processes.handover import write_memfd
from seod.supervisor.arguments import SupervisorArguments
from tests.dst.checks import Checks
from tests.dst.clients import Client, Operator, Watcher
from tests.dst.exchange import FIFO, Once, System, exchanged
from tests.dst.faults import KINDS, Fault, drawn
from tests.dst.line import Board
from tests.dst.rig import Rig
from tests.dst.variety import variety
from tests.dst.world import INJECTED, START_S, Dead, World

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.dst.world import Process

RIGS = {
    wire: Path(__file__).with_name(name) for wire, name in (("can", "rig.yaml"), ("serial", "serial.yaml"))
}
FAULTS_S = 0.35
"""Mean time between faults [s]."""
BEGIN_S, HEAL_S = 2.0, 4.0
"""Before the first fault, and after the last one has passed."""
RESTART_S = 1.0
"""As `RestartSec=` of the unit."""
EXCITED_S = 14.0
"""A healed rig is excited again within this time."""


@dataclass(frozen=True)
class Outcome:
    """What a run showed."""

    seed: int
    failures: tuple[str, ...]
    digest: str
    simulated_s: float
    steps: int
    faults: tuple[Fault, ...]
    commands: int
    trace: tuple[str, ...] = ()
    wire: str = "can"


@lru_cache
def rig_config(wire: str, sensor_hz: int) -> Any:
    """The rig file, read once, with another rate of its sensor."""
    config = load_rig(RIGS[wire])
    sender = config.driver["messages"]["Encoder"] if wire == "can" else config.driver
    sender["rate_hz"] = sensor_hz
    return config


class Run:
    """What faults act on.

    Attributes:
        processes: The newest of each name.
    """

    def __init__(self, world: World, system: System, folder: Path, record: bool) -> None:
        self.world, self.system, self.folder, self.record = world, system, folder, record
        sensor_hz = variety(world.seed).sensor_hz
        self.config = rig_config(system.wire, sensor_hz)
        self.processes: dict[str, Process] = {}
        self.checks = Checks(world, system, self.config)
        end: Any = Rig if system.wire == "can" else Board
        self.rig = end(world, system.bus, Random(f"{world.seed} rig"), float(sensor_hz), 0.4)
        self.checks.rig = self.rig
        system.bus.on_sensor = self.checks.sensed
        system.bus.on_foreign = self.checks.commanded_by_others
        system.processes.started = self._started
        self.starts = 0
        self.ending = False
        network = system.network
        self.operator = Operator(Client(world, network, "operator"), Random(f"{world.seed} operator"))
        self.watcher = Watcher(Client(world, network, "watcher"), Random(f"{world.seed} watcher"))
        self.watcher.client.heard = self.checks.heard

    def _started(self, process: Process) -> None:
        self.processes[process.name] = process
        if process.name == "gateway":
            self.checks.gateway = process
        process.deaths.append(lambda: self._ended(process))

    def _ended(self, process: Process) -> None:
        if process.crash is not None and process.crash.args != (INJECTED,):
            self.world.fail(f"the {process.name} crashed: {process.crash!r}")
        if process.name == "supervisor" and not self.ending:
            self.checks.supervisor_lost_at = self.world.now
            self.world.at(self.world.now + RESTART_S, self.launch)

    def launch(self) -> None:
        """Start the daemon, as the unit does."""
        config = self.config
        self.starts += 1
        fd = write_memfd("dst-config", config.model_dump_json().encode())
        self.system.os.mine.add(fd)
        arguments = SupervisorArguments(
            config_fd=fd,
            config_path=str(RIGS[self.system.wire]),
            rig=config.rig,
            axes=len(config.axes),
            rows=ring_rows(config),
            priority=config.loop.priority,
            hang_timeout=config.loop.hang_timeout,
            gateway_timeout=config.guard.gateway_timeout,
            duration=None,
            record=str(self.folder / f"{self.starts}.mcap") if self.record else None,
            parent=None,
        )
        argv = ["seod", json.dumps(asdict(arguments))]
        process = self.world.start("supervisor", seod.supervisor.process.main, argv, None, FIFO)
        process.held.append(Once(self.system.os.mine, fd))
        self.checks.supervisor = process
        self._started(process)

    def inject(self, fault: Fault) -> None:
        """Have a fault happen."""
        self.world.note(f"fault {fault}")
        KINDS[fault.kind].do(self, fault.numbers)

    def heal_bus(self, state: dict[str, Any]) -> None:
        """The bus is as it was."""
        self.system.bus.set_state(**state)

    def heal(self) -> None:
        """All that a fault may have left."""
        self.world.note("heal")
        bus, rig = self.system.bus, self.rig
        healthy = bus.HEALTHY
        if any(getattr(bus, name) != value for name, value in healthy.items()):
            bus.set_state(**healthy)
        rig.silent = rig.frozen = rig.corrupt = rig.nan = False
        rig.instead = ""
        rig.loss = rig.twice = rig.swap = rig.delay = rig.offset = 0.0
        rig.run = True
        self.system.os.disk = lambda _: None
        for process in self.processes.values():
            process.grip = None
            if process.alive and process.stopped:
                self.world.kill(process, signal.SIGCONT)


def faults_of(seed: int, duration: float, wire: str) -> list[Fault]:
    """The list of a seed."""
    rng = Random(f"{seed} faults")
    count = max(1, round(duration / FAULTS_S * rng.uniform(0.2, 1.5)))
    return drawn(rng, count, BEGIN_S, BEGIN_S + duration, wire)


def run(
    seed: int,
    duration: float,
    faults: Sequence[Fault] | None = None,
    keep: bool = False,
    wire: str = "can",
) -> Outcome:
    """One run.

    Args:
        seed: Of all chances.
        duration: Time with faults [s].
        faults: Instead of the seed's own.
        keep: Keep the trace.
        wire: The rig hangs on `can` or `serial`.
    """
    chosen = tuple(faults_of(seed, duration, wire) if faults is None else faults)
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    enabled, hook = gc.isenabled(), sys.unraisablehook
    gc.disable()  # what it does must not depend on when
    sys.unraisablehook = lambda told: None if isinstance(told.exc_value, Dead) else hook(told)
    try:
        return _outcome(seed, duration, chosen, keep, wire)
    finally:
        gc.collect()  # what the processes had mapped
        sys.unraisablehook = hook
        if enabled:
            gc.enable()


def _outcome(seed: int, duration: float, faults: tuple[Fault, ...], keep: bool, wire: str) -> Outcome:
    world = World(seed, keep)
    system = System(world, wire)
    with (
        tempfile.TemporaryDirectory(prefix="seod-dst-", dir=_fast_folder()) as folder,
        warnings.catch_warnings(),
        exchanged(system),
    ):
        warnings.simplefilter("ignore")
        this = Run(world, system, Path(folder), record=seed % 3 == 0)
        _run(this, duration, faults)
    return Outcome(
        seed,
        tuple(world.failures),
        world.digest(),
        world.now - START_S,
        world.steps,
        faults,
        this.checks.checked,
        tuple(world.trace or ()),
        wire,
    )


def _fast_folder() -> str | None:
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def _run(this: Run, duration: float, faults: Sequence[Fault]) -> None:
    world = this.world
    try:
        this.launch()
        for fault in faults:
            world.at(START_S + fault.t, lambda fault=fault: this.inject(fault))  # type: ignore[misc]
        world.run(START_S + BEGIN_S + duration)
        this.heal()
        world.run(world.now + HEAL_S)
        this.heal()
        _recover(this)
    finally:
        this.ending = True
        world.after_step = lambda: None
        for process in list(world.processes.values())[::-1]:
            world.bury(process, -int(signal.SIGKILL))


def _recover(this: Run) -> None:
    """Nothing is wrong any more: the rig can be excited, and stopped."""
    world, operator = this.world, this.operator
    deadline, operator.plain = world.now + EXCITED_S, True
    excited = 0
    while world.now < deadline and excited < 3 and not world.failures:
        world.run(world.now + 0.5)
        excited = excited + 1 if operator.state == "exciting" else 0
    if world.failures:
        return
    if excited < 3:
        said = f"{operator.state!r}, {operator.fault}, {operator.client.errors}"
        world.fail(f"healed, but not excited within {EXCITED_S:g} s: {said}")
        return
    operator.calm = True
    world.run(world.now + 1.5)
    operator.client.call("stop")
    world.run(world.now + 5.0)
    if not world.failures and operator.state != "idle":
        world.fail(f"stopped, but after 5 s its state is {operator.state!r}: {operator.fault}")
