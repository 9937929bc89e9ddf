"""What stands in for `subprocess` and `threading`: simulated processes, and further tasks of them."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import threading
from typing import TYPE_CHECKING, Any

from tests.dst.shells import Pid, Shell
from tests.dst.sockets import Holder
from tests.dst.world import End, Process, World

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

INHERITED: set[int] = set()
"""Real descriptors of simulated processes that are open."""


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
