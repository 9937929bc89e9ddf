"""One thread, one clock, one seed: the processes of the daemon as greenlets that a scheduler resumes.

Time stands while code runs and moves when all wait. A process waits only in a shell (`tests.dst.shells`);
there it can be preempted, stopped or killed. Nothing here knows what the processes do.
"""

from __future__ import annotations

import asyncio
import math
import signal
from abc import ABC, abstractmethod
from hashlib import blake2b
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import TYPE_CHECKING, Any

from greenlet import getcurrent, greenlet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

START_S = 1000.0
INJECTED = "injected"
"""The message of an exception that is itself the fault."""
EXEC_S = (0.02, 0.2)
"""From `exec` to the first line of a process [s]."""


class Dead(BaseException):
    """Thrown into the code of a process that has ended: nothing that it does has an effect any more."""


class End(ABC):
    """Something with a descriptor that one can wait for."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.watchers: dict[Task, None] = {}

    @abstractmethod
    def readable(self) -> bool:
        """Whether a read would bring something."""

    def changed(self) -> None:
        """Wake whoever waits for it."""
        for task in list(self.watchers):
            self.world.wake(task)


class Task:
    """A thread of a process."""

    def __init__(self, world: World, process: Process, run: Callable[[], None]) -> None:
        self.world, self.process = world, process
        self.greenlet = greenlet(run, world.hub)
        self.token = 0
        self.waiting: tuple[End, ...] = ()
        self.due = False
        """It would run, were its process not stopped."""


class Process:
    """One process: its tasks, its signals, what it holds.

    Attributes:
        taken_by: How late each fault makes it that takes the processor from it [s].
        stopped: By SIGSTOP.
        code: How it ended, as `subprocess` tells it; None while it runs.
        crash: The exception that ended it.
        grip: Called at each point of a tick at which the outside can take hold of it.
    """

    def __init__(
        self,
        world: World,
        name: str,
        main: Callable[[], int],
        argv: list[str],
        parent: Process | None,
        latency: tuple[float, float],
    ) -> None:
        self.world, self.name, self.argv, self.parent = world, name, argv, parent
        self.pid = next(world.pids)
        self.prompt = latency
        self.taken_by: list[float] = []
        self.rng = Random(f"{world.seed} {name} {self.pid}")
        self.stopped = False
        self.code: int | None = None
        self.crash: BaseException | None = None
        self.handlers: dict[int, Callable[..., object]] = {}
        self.pending: list[int] = []
        self.wakeup: Callable[[int], None] = lambda _: None
        self.held: list[Any] = []
        self.said: list[str] = []
        self.deaths: list[Callable[[], None]] = []
        self.dies_with_parent = False
        self.grip: Callable[[str], None] | None = None
        self._main = main
        self.tasks = [Task(world, self, self._run)]

    @property
    def latency(self) -> tuple[float, float]:
        """Range of its wake-up delays [s]."""
        return (self.prompt[0], max([self.prompt[1], *self.taken_by])) if self.taken_by else self.prompt

    def delay(self) -> float:
        """From its wake-up to when it runs [s]."""
        least, most = self.latency
        return least + (most - least) * self.rng.random()

    @property
    def alive(self) -> bool:
        """It has not ended."""
        return self.code is None

    @property
    def able(self) -> bool:
        """It runs."""
        return self.code is None and not self.stopped

    def _run(self) -> None:
        try:
            code = self._main()
        except Dead:
            return
        except SystemExit as end:
            self._exit(end.code if isinstance(end.code, int) else 1)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what ended the process
            if self.code is None:
                self.crash = error
                self._exit(1)
        else:
            self._exit(code)

    def _exit(self, code: int) -> None:
        self.world.bury(self, code)

    def spawn(self, run: Callable[[], None]) -> Task:
        """A thread; whatever ends it ends it alone."""

        def body() -> None:
            try:
                run()
            except Dead:
                return

        task = Task(self.world, self, body)
        self.tasks.append(task)
        self.world.wake(task)
        return task


class World:
    """Scheduler, clock and what has happened.

    Args:
        seed: Of all chances.
        keep: Keep the whole trace, not only its digest.
    """

    def __init__(self, seed: int, keep: bool = False) -> None:
        self.seed = seed
        self.hub = getcurrent()
        self.now = START_S
        self.pids = count(100)
        self.fds = count(100_000)
        self.ends: dict[int, Any] = {}
        self.processes: dict[int, Process] = {}
        self.current: Task | None = None
        self.steps = 0
        self.after_step: Callable[[], None] = lambda: None
        self.failures: list[str] = []
        self.trace: list[str] | None = [] if keep else None
        self._digest = blake2b(digest_size=16)
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()

    # ---- what has happened

    def note(self, text: str) -> None:
        """One line of the trace."""
        line = f"{self.now:.6f} {text}"
        self._digest.update(line.encode())
        if self.trace is not None:
            self.trace.append(line)

    def fail(self, text: str) -> None:
        """An invariant does not hold; each is told once."""
        if len(self.failures) < 20:
            self.note(f"FAILED {text}")
            self.failures.append(f"t = {self.now - START_S:.4f} s: {text}")

    def digest(self) -> str:
        """Of the whole trace."""
        return self._digest.hexdigest()

    # ---- time

    def at(self, t: float, do: Callable[[], None]) -> None:
        """Have something done at `t` [s]."""
        heappush(self._heap, (t if t > self.now else self.now, next(self._order), do))

    def run(self, until: float) -> None:
        """Let time pass."""
        heap = self._heap
        while heap and heap[0][0] <= until and not self.failures:
            t, _, do = heappop(heap)
            if t > self.now:
                self.now = t
            do()
            self.steps += 1
            self.after_step()
        if not self.failures:
            self.now = max(self.now, until)

    # ---- processes

    def start(
        self,
        name: str,
        main: Callable[[], int],
        argv: list[str],
        parent: Process | None,
        latency: tuple[float, float],
    ) -> Process:
        """A new process; its first line comes later."""
        process = Process(self, name, main, argv, parent, latency)
        self.processes[process.pid] = process
        self.note(f"start {name} {process.pid}")
        task = process.tasks[0]
        token = task.token
        self.at(self.now + process.rng.uniform(*EXEC_S), lambda: self._resume(task, token))
        return process

    def wake(self, task: Task) -> None:
        """What it waits for is there: it runs as soon as the machine lets it."""
        token, process = task.token, task.process
        self.at(self.now + process.delay(), lambda: self._resume(task, token))

    def _resume(self, task: Task, token: int) -> None:
        process = task.process
        if token != task.token or process.code is not None:
            return
        if process.stopped:
            task.due = True
            return
        task.token += 1
        for end in task.waiting:
            end.watchers.pop(task, None)
        task.waiting = ()
        self._switch(task)

    def _switch(self, task: Task, throw: bool = False) -> None:
        before, self.current = self.current, task
        loop = asyncio._get_running_loop()  # of a process that kills another
        try:
            if throw:
                task.greenlet.throw(Dead)
            else:
                task.greenlet.switch()
        finally:
            self.current = before
            asyncio._set_running_loop(loop)

    def me(self) -> Task:
        """Whose code runs.

        Raises:
            Dead: That of a process that has ended.
        """
        task = self.current
        if task is None or task.process.code is not None:
            raise Dead
        return task

    def block(self, until: float = math.inf, ends: Iterable[End] = ()) -> None:
        """Wait until `until` [s], until an end changes, or for a signal; handlers run before it returns.

        Raises:
            Dead: The process ended meanwhile.
        """
        task = self.me()
        process = task.process
        if not (process.pending and task is process.tasks[0]):
            task.waiting = tuple(ends)
            for end in task.waiting:
                end.watchers[task] = None
            if until < math.inf:
                token = task.token
                self.at(until + process.delay(), lambda: self._resume(task, token))
            loop = asyncio._get_running_loop()
            asyncio._set_running_loop(None)  # that of another gateway may run meanwhile
            try:
                self.hub.switch()
            finally:
                asyncio._set_running_loop(loop)
            if process.code is not None:
                raise Dead
        if process.pending and task is process.tasks[0]:
            self._handle(process)

    def _handle(self, process: Process) -> None:
        while process.pending:
            number = process.pending.pop(0)
            process.handlers[number](number, None)

    def touch(self, place: str) -> None:
        """A point within a step at which a process can be taken hold of."""
        process = self.me().process
        if process.grip is not None:
            grip, process.grip = process.grip, None
            grip(place)

    def kill(self, process: Process, number: int) -> None:
        """Send a signal."""
        if process.code is not None:
            return
        self.note(f"signal {number} to {process.name}")
        if number == signal.SIGKILL:
            self.bury(process, -int(number))
        elif number == signal.SIGSTOP:
            process.stopped = True
        elif number == signal.SIGCONT:
            self._go_on(process)
        elif number not in process.handlers:
            self.bury(process, -int(number))
        elif process.handlers[number] is not None:
            process.pending.append(number)
            process.wakeup(number)
            self.wake(process.tasks[0])

    def _go_on(self, process: Process) -> None:
        process.stopped = False
        for task in process.tasks:
            if task.due:
                task.due = False
                self.wake(task)

    def bury(self, process: Process, code: int) -> None:
        """A process ends: its code has no effect any more, what it held is given back."""
        if process.code is not None:
            return
        process.code = code
        self.note(f"end {process.name} {process.pid} {code}")
        for task in process.tasks:
            task.token += 1
            for end in task.waiting:
                end.watchers.pop(task, None)
            if task is not self.current and task.greenlet and not task.greenlet.dead:
                self._throw(task)
        for held in process.held[::-1]:
            held.give_back()
        process.held.clear()
        for told in process.deaths:
            told()
        for other in list(self.processes.values()):
            if other.parent is process and other.dies_with_parent:
                self.kill(other, signal.SIGTERM)

    def _throw(self, task: Task) -> None:
        mine, task.greenlet.parent = task.greenlet.parent, getcurrent()
        self._switch(task, throw=True)
        if not task.greenlet.dead:
            task.greenlet.parent = mine
