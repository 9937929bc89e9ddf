"""Tasks in processes of this machine, without Dask: for work of minutes; one that dies ends it all."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any

from seod.batch.executor import StoppedError, attempted

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Self


class Processes:
    """Does tasks in processes that end with this.

    Args:
        workers: How many.
    """

    def __init__(self, workers: int) -> None:
        self.slots = workers
        self._pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
        self._under_way: dict[Future[Any], int] = {}

    def submit(self, number: int, function: Callable[[Any], Any], item: Any) -> None:
        """As of `Executor`."""
        self._under_way[self._pool.submit(attempted, function, item)] = number

    def next(self) -> tuple[int, Any]:
        """As of `Executor`."""
        ended, _ = wait(self._under_way, return_when=FIRST_COMPLETED)
        future = ended.pop()
        try:
            return self._under_way.pop(future), future.result()
        except BrokenProcessPool as error:
            raise StoppedError("a process that computed died: killed, or out of memory") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)
