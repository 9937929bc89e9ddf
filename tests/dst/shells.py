"""What stands in for the system: modules with the few names that the daemon uses of them.

Each is put in the place of a module within the modules of the daemon (`tests.dst.exchange`); what the daemon
does with it is its own code. Sockets are in `sockets`, processes and threads in `processes`.
"""

from __future__ import annotations

import math
import os
import select
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

from tests.dst.world import Dead, End, Process, World

if TYPE_CHECKING:
    from collections.abc import Callable

EPOCH_S = 1.7e9
"""CLOCK_REALTIME less CLOCK_MONOTONIC at the start [s]."""


class Shell:
    """A module but for what a subclass replaces."""

    def __init__(self, world: World, module: Any) -> None:
        self._world, self._module = world, module

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        setattr(self, name, value)  # asked once: what follows finds it here
        return value


class Time(Shell):
    """Clocks that stand while code runs, and sleep."""

    def __init__(self, world: World) -> None:
        super().__init__(world, time)
        self.offset = EPOCH_S

    def monotonic(self) -> float:
        """Simulated CLOCK_MONOTONIC [s]."""
        return self._world.now

    perf_counter = monotonic

    def monotonic_ns(self) -> int:
        """Likewise [ns]."""
        return int(self._world.now * 1e9)

    def time(self) -> float:
        """Simulated CLOCK_REALTIME [s]: it may be set."""
        return self._world.now + self.offset

    def time_ns(self) -> int:
        """Likewise [ns]."""
        return int(self.time() * 1e9)

    def sleep(self, seconds: float) -> None:
        """Wait; goes on after a signal's handler."""
        until = self._world.now + seconds
        while True:
            self._world.block(until)
            if self._world.now >= until:
                return


class Pid(End):
    """A pidfd."""

    def __init__(self, world: World, process: Process) -> None:
        super().__init__(world)
        self.process = process
        self.fd = next(world.fds)
        world.ends[self.fd] = self
        process.deaths.append(self.changed)

    def readable(self) -> bool:
        return self.process.code is not None


class Pipe(End):
    """A pipe that wakes up."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.content = bytearray()

    def readable(self) -> bool:
        return bool(self.content)


class Os(Shell):
    """Descriptors, processes and the disk."""

    def __init__(self, world: World) -> None:
        super().__init__(world, os)
        self.disk: Callable[[str], None] = lambda _: None
        """Called before each access to the disk; raises what the disk says."""

    def _exit(self, code: int) -> None:
        process = self._world.me().process
        self._world.bury(process, code)
        raise Dead

    def getpid(self) -> int:
        """Of the simulated process."""
        return self._world.me().process.pid

    def getppid(self) -> int:
        """Likewise."""
        parent = self._world.me().process.parent
        return parent.pid if parent is not None and parent.alive else 1

    def pidfd_open(self, pid: int) -> int:
        """A descriptor of a process."""
        return Pid(self._world, self._world.processes[pid]).fd

    def pipe2(self, _: int) -> tuple[int, int]:
        """A pipe; both ends are one here."""
        pipe = Pipe(self._world)
        fd = next(self._world.fds)
        self._world.ends[fd] = pipe
        return fd, fd

    def read(self, fd: int, most: int) -> bytes:
        """From a pipe."""
        pipe = self._world.ends[fd]
        data = bytes(pipe.content[:most])
        del pipe.content[:most]
        return data

    def close(self, fd: int) -> None:
        """A simulated descriptor."""
        del self._world.ends[fd]

    def write(self, fd: int, data: bytes) -> int:
        """To a file, if the disk has room."""
        self.disk("write")
        return os.write(fd, data)

    def fdatasync(self, _: int) -> None:
        """As quick as the disk is."""
        self.disk("sync")

    fsync = fdatasync

    def setpriority(self, *_: object) -> None:
        """Priorities are in the latencies."""

    def sched_getscheduler(self, _: int) -> int:
        """Ordinary."""
        return os.SCHED_OTHER


class Signals(Shell):
    """Handlers of the simulated process, and signals to others."""

    def __init__(self, world: World) -> None:
        super().__init__(world, signal)

    def signal(self, number: int, handler: Any) -> None:
        """Set a handler."""
        self._world.me().process.handlers[number] = None if handler is signal.SIG_IGN else handler

    def set_wakeup_fd(self, fd: int) -> None:
        """Where to signals are told."""
        pipe = self._world.ends[fd]

        def tell(number: int) -> None:
            pipe.content.append(number)
            pipe.changed()

        self._world.me().process.wakeup = tell

    def pidfd_send_signal(self, fd: int, number: int) -> None:
        """To the process of a pidfd."""
        process = self._world.ends[fd].process
        if process.code is not None:
            raise ProcessLookupError
        self._world.kill(process, number)


class Poller:
    """`select.poll()`."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._fds: dict[int, End] = {}

    def register(self, fd: int, _: int) -> None:
        self._fds[fd] = self._world.ends[fd]

    def unregister(self, fd: int) -> None:
        del self._fds[fd]

    def _ready(self) -> list[tuple[int, int]]:
        return [(fd, select.POLLIN) for fd, end in self._fds.items() if end.readable()]

    def poll(self, milliseconds: float) -> list[tuple[int, int]]:
        ready = self._ready()
        if not ready:
            self._world.block(self._world.now + math.ceil(milliseconds) / 1e3, self._fds.values())
            ready = self._ready()
        return ready


class Select(Shell):
    """`poll` and `select`."""

    def __init__(self, world: World) -> None:
        super().__init__(world, select)

    def poll(self) -> Poller:
        """A new poll object."""
        return Poller(self._world)

    def select(self, read: list[Any], _w: object, _x: object, timeout: float) -> tuple[Any, Any, Any]:
        """Wait for any of some ends."""
        fds = {each: self._world.ends[each.fileno()] for each in read}
        if not any(end.readable() for end in fds.values()):
            self._world.block(self._world.now + timeout, fds.values())
        return [each for each, end in fds.items() if end.readable()], [], []


class Sys(Shell):
    """Arguments and standard error of the simulated process."""

    def __init__(self, world: World) -> None:
        super().__init__(world, sys)

    @property
    def argv(self) -> list[str]:
        """Of the process whose code runs."""
        return self._world.me().process.argv

    @property
    def stderr(self) -> Any:
        """Of the process whose code runs."""
        return _Stderr(self._world)


class _Stderr:
    def __init__(self, world: World) -> None:
        self._world = world

    def write(self, text: str) -> int:
        if text.strip():
            process = self._world.me().process
            process.said.append(text.strip())
            self._world.note(f"{process.name} says {text.strip()}")
        return len(text)

    def flush(self) -> None:
        """At once anyway."""
