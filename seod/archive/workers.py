"""Recordings read by this process, or by several; one that dies costs no more than its batch's time."""

from __future__ import annotations

import multiprocessing
import os
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from seod.archive import reports
from seod.archive.engines import ArchiveError
from seod.archive.fits import identify_missing
from seod.archive.reading import rows_of
from seod.archive.store import Store

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from seod.archive.reports import Report
    from seod.archive.store import Known

TASK: Final = 32
"""Recordings of one task: small ones take a millisecond each, and a task's way there and back as much."""
TRIES: Final = 3
"""A batch at which the workers die so often is told, by its first file."""


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


class Workers:
    """Reads batches; `count` 1: in this process."""

    def __init__(self, store: Store, count: int, identify: bool) -> None:
        self._store, self._count, self._identify = store, count, identify
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def rows(self, batch: Sequence[Work]) -> list[dict[str, Any]]:
        """Rows of a batch, in its order.

        Raises:
            ArchiveError: The workers die again and again.
        """
        if self._count == 1:
            return read(self._store, batch, self._identify)
        for _ in range(TRIES):
            try:
                return [row for rows in self._tasks(batch) for row in rows]
            except BrokenProcessPool:
                self._end()
        first = batch[0].file.name
        raise ArchiveError(f"a worker ended {TRIES} times among the {len(batch)} recordings from {first} on")

    def _tasks(self, batch: Sequence[Work]) -> Iterator[list[dict[str, Any]]]:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._count, context, initializer=_begin)
        tasks = [batch[k : k + TASK] for k in range(0, len(batch), TASK)]
        return self._pool.map(_task, [self._store.where] * len(tasks), tasks, [self._identify] * len(tasks))

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


_STORES: Final[dict[str, Store]] = {}
"""Of this worker: a store is opened once."""


def _task(where: str, work: Sequence[Work], identify: bool) -> list[dict[str, Any]]:
    if where not in _STORES:
        _STORES[where] = Store(where)
    return read(_STORES[where], work, identify)


def _begin() -> None:
    """A worker whose builder is killed ends as well: nobody would take what it reads."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
