"""What stands in for the system: modules with the few names that the daemon uses of them.

Each is put in the place of a module within the modules of the daemon (`tests.dst.exchange`); what the daemon
does with it is its own code.
"""

from __future__ import annotations

import errno
import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from tests.dst.world import Dead, End, Process, World

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

EPOCH_S = 1.7e9
"""CLOCK_REALTIME less CLOCK_MONOTONIC at the start [s]."""
PACKETS = 278
"""Datagrams that a socket pair holds."""


class Shell:
    """A module but for what a subclass replaces."""

    def __init__(self, world: World, module: Any) -> None:
        self._world, self._module = world, module

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


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


class Holder:
    """A process' hold on an end of a socket pair."""

    def __init__(self, world: World, end: PairEnd) -> None:
        self.world, self.end = world, end
        self.open = True
        end.holders += 1
        self._process = world.current.process if world.current is not None else None
        if self._process is not None:
            self._process.held.append(self)

    def give_back(self) -> None:
        """Closed, by the process or by its end."""
        if self.open:
            self.open = False
            self.end.drop()

    # ---- as `socket.socket`

    def setblocking(self, _: bool) -> None:
        """It never blocks."""

    def setsockopt(self, *_: object) -> None:
        """Its buffers are as they are."""

    def fileno(self) -> int:
        """Its descriptor."""
        return self.end.fd

    def send(self, data: bytes, *_: object) -> int:
        """One datagram."""
        self.world.me()
        return self.end.send(data)

    def recv(self, *_: object) -> bytes:
        """One datagram; b"" at the end."""
        self.world.me()
        return self.end.recv()

    def close(self) -> None:
        """Give it back."""
        if self._process is not None and self in self._process.held:
            self._process.held.remove(self)
        self.give_back()

    def __enter__(self) -> Holder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PairEnd(End):
    """One end of a pair of SOCK_SEQPACKET sockets."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.fd = next(world.fds)
        world.ends[self.fd] = self
        self.inbox: deque[bytes] = deque()
        self.other: PairEnd
        self.holders = 0
        self.closed = False

    def readable(self) -> bool:
        return bool(self.inbox) or self.other.closed

    def send(self, data: bytes) -> int:
        if self.other.closed:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        if len(self.other.inbox) >= PACKETS:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        self.other.inbox.append(bytes(data))
        self.other.changed()
        return len(data)

    def recv(self) -> bytes:
        if self.inbox:
            return self.inbox.popleft()
        if self.other.closed:
            return b""
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    def drop(self) -> None:
        self.holders -= 1
        if self.holders == 0:
            self.closed = True
            self.other.changed()


class Sockets(Shell):
    """Socket pairs between processes; raw CAN sockets by `tests.dst.bus`."""

    def __init__(self, world: World, can_socket: type | None = None) -> None:
        super().__init__(world, socket)
        self._can = can_socket
        self.socket: Any = _Sock(world, can_socket)

    def socketpair(self, *_: object) -> tuple[Holder, Holder]:
        """Two connected ends."""
        a, b = PairEnd(self._world), PairEnd(self._world)
        a.other, b.other = b, a
        return Holder(self._world, a), Holder(self._world, b)


class _Sock:
    """`socket.socket`, called."""

    def __init__(self, world: World, can_socket: Any) -> None:
        self._world, self._can = world, can_socket

    def __call__(self, family: int = -1, *_: object, fileno: int | None = None) -> Any:
        if fileno is not None:
            return Holder(self._world, self._world.ends[fileno])
        if family == socket.AF_CAN:
            return self._can(self._world)
        raise OSError(errno.EAFNOSUPPORT, f"no socket of family {family} here")


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


class Child:
    """`subprocess.Popen` of one of the daemon's processes."""

    def __init__(self, world: World, process: Process) -> None:
        self._world, self.process, self.pid = world, process, process.pid

    @property
    def returncode(self) -> int | None:
        return self.process.code

    def wait(self, timeout: float = math.inf) -> int:
        end = Pid(self._world, self.process)
        until = self._world.now + timeout
        while self.process.code is None:
            self._world.block(until, [end])
            if self.process.code is None and self._world.now >= until:
                raise subprocess.TimeoutExpired(self.process.name, timeout)
        return self.process.code

    def kill(self) -> None:
        self._world.kill(self.process, signal.SIGKILL)


class Subprocesses(Shell):
    """Starts simulated processes.

    Args:
        mains: By module, what it runs, and the range of its wake-up delays [s].
    """

    def __init__(
        self, world: World, mains: Mapping[str, tuple[Callable[[], int], tuple[float, float]]]
    ) -> None:
        super().__init__(world, subprocess)
        self._mains = mains
        self.started: Callable[[Process], None] = lambda _: None

    def Popen(self, command: list[str], **_: object) -> Child:
        """`python -m MODULE ARGUMENTS`."""
        _, _, module, arguments = command
        main, latency = self._mains[module]
        parent = self._world.me().process
        text = inherited(self._world, arguments)
        process = self._world.start(module.rpartition(".")[2], main, ["seod", text[0]], parent, latency)
        process.held += text[1]
        self.started(process)
        return Child(self._world, process)


INHERITED: set[int] = set()
"""Real descriptors of simulated processes that are open."""


class Descriptor:
    """A real descriptor that a process inherits."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        INHERITED.add(fd)

    def give_back(self) -> None:
        if self.fd in INHERITED:
            INHERITED.discard(self.fd)
            os.close(self.fd)


def inherited(world: World, arguments: str) -> tuple[str, list[Any]]:
    """A child's arguments with descriptors of its own, and what it holds by them."""
    given = json.loads(arguments)
    held: list[Any] = []
    for name in ("config_fd", "shared_fd"):
        given[name] = os.dup(given[name])
        held.append(Descriptor(given[name]))
    before, world.current = world.current, None
    held.append(Holder(world, world.ends[given["supervisor_fd"]]))
    world.current = before
    return json.dumps(given), held


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


class Threads(Shell):
    """Threads as further tasks of their process."""

    def __init__(self, world: World) -> None:
        super().__init__(world, threading)

    def Thread(self, target: Callable[[], None], **_: object) -> Any:
        """A thread that is not started yet."""
        return _Thread(self._world, target)

    def Event(self) -> Any:
        """An event that threads wait for."""
        return _Event(self._world)


class _Thread(End):
    def __init__(self, world: World, target: Callable[[], None]) -> None:
        super().__init__(world)
        self._target = target
        self._alive = False

    def readable(self) -> bool:
        return not self._alive

    def start(self) -> None:
        self._alive = True

        def run() -> None:
            self._target()
            self._alive = False
            self.changed()

        self.world.me().process.spawn(run)

    def join(self, timeout: float) -> None:
        until = self.world.now + timeout
        while self._alive and self.world.now < until:
            self.world.block(until, [self])

    def is_alive(self) -> bool:
        return self._alive


class _Event(End):
    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._set = False

    def readable(self) -> bool:
        return self._set

    def set(self) -> None:
        self._set = True
        self.changed()

    def wait(self, timeout: float) -> bool:
        if not self._set:
            self.world.block(self.world.now + timeout, [self])
        return self._set
