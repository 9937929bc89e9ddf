"""Which names of the daemon's modules stand for simulated ones while a world lives."""

from __future__ import annotations

import asyncio
import os
from contextlib import contextmanager
from random import Random
from typing import TYPE_CHECKING, Any

import can

import drivers.can
import drivers.can_link
import drivers.can_socket
import drivers.clock
import drivers.neutral
import drivers.serial
import drivers.serial_link
import seod.gateway.desk
import seod.gateway.process
import seod.gateway.server
import seod.gateway.turns
import seod.loop.pacer
import seod.loop.process
import seod.loop.tick
import seod.observe.process
import seod.processes.handover
import seod.processes.ring
import seod.record.disk
import seod.record.opening
import seod.record.recorder
import seod.supervisor.child
import seod.supervisor.process
from seod.files.user_files import create_recording
from tests.dst import bus, line, net, processes, shells, sockets
from tests.dst.variety import variety

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tests.dst.world import World

TICK_S = 0.01
FIFO, NORMAL = (2e-6, 3e-5), (2e-5, 8e-4)
"""Wake-up delays [s] of what runs in real time, and of what does not."""


class System:
    """All shells of one world.

    Args:
        world: Where they live.
        wire: The rig hangs on `can` or `serial`.
    """

    def __init__(self, world: World, wire: str = "can") -> None:
        self.world, self.wire = world, wire
        self.time = shells.Time(world)
        self.os = FilesOs(world)
        self.bus: Any = (
            bus.Bus(world, self.time.time)
            if wire == "can"
            else line.Line(world, Random(f"{world.seed} line"))
        )
        self.network = net.Network(world)
        self.can_socket = type("Raw", (bus.CanSocket,), {"bus": self.bus})
        self.processes = processes.Subprocesses(
            world,
            {
                "seod.loop": (seod.loop.process.main, FIFO),
                "seod.gateway": (seod.gateway.process.main, NORMAL),
                "seod.observe": (seod.observe.process.main, NORMAL),
            },
        )
        self.notified: list[str] = []
        self.loop_made: Callable[[Any], Any] = lambda loop: loop
        self.mailbox_made: Callable[[Any], Any] = lambda mailbox: mailbox

    def _create(self, path: Path) -> int:
        fd = create_recording(path)
        self.os.hold(fd)
        return fd

    def names(self) -> Iterator[tuple[Any, str, Any]]:
        """Module, name in it, what stands for it."""
        world, clock, system = self.world, self.time, self.os
        signals, sys, select = shells.Signals(world), shells.Sys(world), shells.Select(world)
        pairs = sockets.Sockets(world, self.can_socket)
        for module in (
            seod.supervisor.process,
            seod.loop.pacer,
            seod.loop.tick,
            drivers.can,
            drivers.serial,
            seod.gateway.process,
            seod.gateway.turns,
            seod.observe.process,
            seod.record.opening,
        ):
            yield module, "time", clock
        for module in (
            seod.supervisor.process,
            seod.supervisor.child,
            seod.loop.tick,
            seod.gateway.process,
            seod.observe.process,
            seod.record.disk,
            seod.processes.ring,
        ):
            yield module, "os", system
        for module in (
            seod.supervisor.process,
            seod.supervisor.child,
            seod.loop.process,
            seod.gateway.process,
            seod.observe.process,
        ):
            yield module, "signal", signals
        for module in (
            seod.supervisor.child,
            seod.loop.process,
            seod.gateway.process,
            seod.observe.process,
            drivers.neutral,
        ):
            yield module, "socket", pairs
        if self.wire == "can":
            yield drivers.can_link, "socket", shells_of_link(world, self)
            yield drivers.can_link, "can", CanShell(self.bus, self.can_socket)
        else:
            yield from self._port()
        for module in (seod.supervisor.process, seod.observe.process, drivers.can_socket):
            yield module, "select", select
        yield seod.supervisor.process, "sys", sys
        yield seod.processes.handover, "sys", sys
        for module in (seod.supervisor.child, seod.gateway.process):
            yield module, "subprocess", self.processes
        yield seod.gateway.process, "asyncio", net.AsyncioShell(world, self.network)
        yield seod.record.recorder, "threading", processes.Threads(world)
        yield from self._functions()

    def _port(self) -> Iterator[tuple[Any, str, Any]]:
        world, wire = self.world, self.bus
        for module in (drivers.serial_link, drivers.neutral):
            yield module, "os", line.PortOs(world, wire)
            yield module, "termios", line.Termios(world, wire)
        yield drivers.serial_link, "serial", line.Serial(world, wire)
        yield drivers.serial_link, "select", line.HangUp(world)
        yield drivers.serial_link, "Arrivals", lambda fd: line.Arrivals(world.ends[fd])

    def _functions(self) -> Iterator[tuple[Any, str, Any]]:
        def die_with_parent(pid: int) -> None:
            process = self.world.me().process
            process.dies_with_parent = True
            if self.os.getppid() != pid:
                raise SystemExit(1)

        for module in (
            seod.supervisor.process,
            seod.loop.process,
            seod.gateway.process,
            seod.observe.process,
        ):
            yield module, "die_with_parent", die_with_parent
        for module in (seod.supervisor.process, seod.gateway.process):
            yield module, "set_fifo", lambda _: ""
        yield seod.supervisor.process, "lock_memory", lambda: ""
        yield seod.supervisor.process, "notify", self.notified.append
        yield seod.supervisor.process, "watchdog_interval", lambda: 0.5
        yield seod.loop.process, "enter_realtime", lambda *_: []
        yield seod.gateway.process, "prepare", lambda: None
        yield seod.gateway.server, "listen_on", lambda *_: None
        yield seod.observe.process, "leave_realtime", lambda: None
        looks = variety(self.world.seed).looks
        yield seod.gateway.process, "POLL_S", TICK_S * looks[0]
        yield seod.observe.process, "POLL_S", TICK_S * looks[1]
        make = seod.loop.process.Loop
        yield seod.loop.process, "Loop", lambda *arguments: self.loop_made(make(*arguments))
        make_mailbox = seod.gateway.desk.Mailbox
        yield seod.gateway.desk, "Mailbox", lambda *arguments: self.mailbox_made(make_mailbox(*arguments))
        yield drivers.clock.StampClock.__init__, "__defaults__", (self.time.time, True)
        yield seod.record.disk, "create_recording", self._create
        yield seod.record.recorder.McapRecorder.__init__, "__defaults__", (self.time.monotonic,)


class FilesOs(shells.Os):
    """Descriptors that simulated processes inherit, closed once."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.mine: set[int] = set()

    def memfd_create(self, name: str, flags: int) -> int:
        """Given back with the process that made it."""
        fd = os.memfd_create(name, flags)
        self.hold(fd)
        return fd

    def hold(self, fd: int) -> None:
        """Give it back with the process whose code runs."""
        self.mine.add(fd)
        self._world.me().process.held.append(Once(self.mine, fd))

    def close(self, fd: int) -> None:
        """A descriptor of either kind; what a dead process had is given back already."""
        current = self._world.current
        if current is None or not current.process.alive:
            return
        if fd in self.mine:
            Once(self.mine, fd).give_back()
        elif fd in self._world.ends:
            super().close(fd)
        else:
            processes.INHERITED.discard(fd)
            os.close(fd)


class Once:
    """A real descriptor, closed by whoever is first."""

    def __init__(self, mine: set[int], fd: int) -> None:
        self.mine, self.fd = mine, fd

    def give_back(self) -> None:
        if self.fd in self.mine:
            self.mine.discard(self.fd)
            os.close(self.fd)


class CanShell:
    """`can` but for `Bus`."""

    def __init__(self, host: bus.Bus, can_socket: Any) -> None:
        self._host, self._socket = host, can_socket

    def Bus(self, **options: Any) -> bus.HostBus:
        """Of the simulated interface."""
        raw = self._socket(self._host.world)
        raw.wanted = frozenset(each["can_id"] for each in options["can_filters"])
        raw.bind(("can0",))
        return bus.HostBus(raw)

    def __getattr__(self, name: str) -> Any:
        value = getattr(can, name)
        setattr(self, name, value)
        return value


def shells_of_link(world: World, system: System) -> Any:
    """`socket` as `drivers.can_link` sees it."""
    link = bus.LinkSockets(world, system.bus)
    link.socket = system.can_socket
    return link


@contextmanager
def exchanged(system: System) -> Iterator[None]:
    """Simulated names in force."""
    before = []
    asyncio.set_event_loop(None)
    for place, name, value in list(system.names()):
        before.append((place, name, getattr(place, name)))
        setattr(place, name, value)
    try:
        yield
    finally:
        for place, name, value in before[::-1]:
            setattr(place, name, value)
