"""Recordings read by this process, or by several; one that dies costs no more than its task's time.

Each worker has a pipe of its own: the end of one that is killed, in the middle of an answer too, is seen at
its pipe. The standard library's pool waits there for the rest of the answer, for good.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections import Counter, deque
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from seod.archive import reports
from seod.archive.engines import ArchiveError
from seod.archive.fits import identify_missing
from seod.archive.reading import rows_of
from seod.archive.store import Store

if TYPE_CHECKING:
    from collections.abc import Sequence
    from multiprocessing.connection import Connection

    from seod.archive.reports import Report
    from seod.archive.store import Known

TASK: Final = 32
"""Recordings of one task: small ones take a millisecond each, and a task's way there and back as much."""
TRIES: Final = 3
"""A task at which workers die so often is told, by its first file."""


class Work(NamedTuple):
    """A recording to be read, its stamp (with those of its reports), and its reports."""

    file: Known
    stamp: str
    reports: tuple[Report, ...]


def read(store: Store, work: Sequence[Work], identify: bool) -> list[dict[str, Any]]:
    """Rows of some recordings, in their order; one that cannot be read tells so in its row."""
    return [row for each in work for row in _read_one(store, each, identify)]


def _read_one(store: Store, work: Work, identify: bool) -> list[dict[str, Any]]:
    known = work.file._replace(stamp=work.stamp)
    try:
        with store.open(known) as file:
            rows = rows_of(known, file)
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}"
        return [{"file": known.name, "stamp": "", "gone": False, "problem": problem}]
    if identify:
        identify_missing(store, known, rows)
    reports.add(rows, work.reports, store)
    return rows


Rows = list[dict[str, Any]]


class Workers:
    """Reads batches; `count` 1: in this process."""

    def __init__(self, store: Store, count: int, identify: bool) -> None:
        self._store, self._count, self._identify = store, count, identify
        self._idle: list[_Worker] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._idle:
            worker.end()
        self._idle.clear()

    def rows(self, batch: Sequence[Work]) -> Rows:
        """Rows of a batch, in its order.

        Raises:
            ArchiveError: Workers die again and again at the same recordings.
        """
        if self._count == 1:
            return read(self._store, batch, self._identify)
        tasks = [batch[k : k + TASK] for k in range(0, len(batch), TASK)]
        busy: dict[Connection, tuple[_Worker, int]] = {}
        try:
            return [row for rows in self._answers(tasks, busy) for row in rows]
        finally:
            for worker, _ in busy.values():
                worker.end()

    def _answers(
        self, tasks: Sequence[Sequence[Work]], busy: dict[Connection, tuple[_Worker, int]]
    ) -> list[Rows]:
        """Rows of each task; `busy` holds the workers that have one."""
        waiting, found, deaths = deque(range(len(tasks))), dict[int, Rows](), Counter[int]()
        while len(found) < len(tasks):
            while waiting and len(busy) < self._count:
                self._give(waiting.popleft(), tasks, busy)
            answered = wait(list(busy))
            for connection in [each for each in busy if each in answered]:
                worker, number = busy.pop(connection)
                try:
                    found[number] = worker.take()
                except (EOFError, OSError) as error:
                    worker.end()
                    deaths[number] += 1
                    if deaths[number] == TRIES:
                        first = tasks[number][0].file.name
                        which = f"{len(tasks[number])} recordings from {first} on"
                        raise ArchiveError(f"a worker ended {TRIES} times among the {which}") from error
                    waiting.appendleft(number)
                else:
                    self._idle.append(worker)
        return [found[number] for number in range(len(tasks))]

    def _give(
        self, number: int, tasks: Sequence[Sequence[Work]], busy: dict[Connection, tuple[_Worker, int]]
    ) -> None:
        worker = self._idle.pop() if self._idle else _Worker(self._store.where, self._identify)
        busy[worker.connection] = worker, number
        worker.give(tasks[number])


class _Worker:
    """One process that reads; it ends when its builder does."""

    def __init__(self, where: str, identify: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, where, identify))
        self._process.start()
        theirs.close()  # so that its death ends the pipe

    def give(self, work: Sequence[Work]) -> None:
        """Hand out a task; whether the worker still lives is seen when its answer is taken."""
        try:
            self.connection.send(work)
        except OSError:  # it has died
            return

    def take(self) -> Rows:
        """The answer.

        Raises:
            EOFError, OSError: The worker has died.
        """
        answer = self.connection.recv()
        if isinstance(answer, Exception):
            raise answer
        rows: Rows = answer
        return rows

    def end(self) -> None:
        """End it, whatever it does."""
        self.connection.close()
        self._process.kill()
        self._process.join()
        self._process.close()


def _serve(connection: Connection, where: str, identify: bool) -> None:
    """A worker: tasks come, rows go, until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the builder's
    store = Store(where)
    while True:
        try:
            work = connection.recv()
        except (EOFError, OSError):  # the builder has ended
            return
        answer: Rows | Exception
        try:
            answer = read(store, work, identify)
        except Exception as error:  # noqa: BLE001 - told where the rows are wanted
            answer = RuntimeError(f"{type(error).__name__}: {error}")
        try:
            connection.send(answer)
        except OSError:
            return
