"""Tasks on Dask: workers of this machine, or of any number of machines behind a scheduler.

Dask counts the deaths of workers, and gives a task up that was there at several of them, whether it killed
them or not. Such a task is done again alone, after the others: who then kills its worker again has failed.
A scheduler that was restarted knows nothing; all that is under way is then handed out again.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import dask
from distributed import Client, KilledWorker, LocalCluster

from seod.batch.executor import Failed, StoppedError, attempted, failed

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Self

PATIENCE_S = 120.0
"""A scheduler or all workers may be away so long: a service that is started again, a machine that boots."""
LOOK_S = 0.5
"""How often workers are counted, and a scheduler that is away is tried."""
CONNECT_S = 5.0
"""One attempt to reach a scheduler."""
LOCAL_SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # who was there at a death is tried again alone
    "distributed.scheduler.worker-saturation": 1.0,  # a worker's death takes no waiting task with it
    "distributed.worker.preload": ["seod.batch.quiet_worker"],
    "distributed.worker.daemon": False,  # readers of damaged files run in a process of their own
}
_CANCELLED = (asyncio.CancelledError, concurrent.futures.CancelledError)


class _Task(NamedTuple):
    function: Callable[[Any], Any]
    item: Any


class _Lost(NamedTuple):
    """In the place of a result: the scheduler that had the task is gone."""

    connection: int


class OnDask:
    """Does tasks on Dask's workers.

    Args:
        scheduler: `local`: workers of this machine, which end with this; or the address of a scheduler.
        workers: How many, if local.
        memory: Of each local worker, such as `2 GB`; a worker that takes more is ended. `auto`: its share.
        patience_s: How long the scheduler or all workers may be away [s].
        tell: Takes sentences for whoever waits.
        dashboard: Where a local scheduler shows its state; None: on loopback, and nobody is told where.
    """

    def __init__(
        self,
        scheduler: str = "local",
        workers: int = 1,
        memory: str = "auto",
        patience_s: float = PATIENCE_S,
        tell: Callable[[str], None] = lambda _: None,
        dashboard: str | None = "127.0.0.1:0",
    ) -> None:
        self.scheduler, self._workers, self._memory = scheduler, workers, memory
        self._patience_s, self._tell, self._dashboard = patience_s, tell, dashboard
        self._runner = asyncio.Runner()
        self._cluster: Any = None
        self._client: Any = None
        self._connections = 0
        self._under_way: dict[int, _Task] = {}
        self._unsent: list[int] = []
        self._suspects: list[int] = []
        self._alone: int | None = None
        self._following: set[asyncio.Task[None]] = set()
        self._ended: asyncio.Queue[tuple[int, Any]]
        self.slots = max(1, workers)
        self.link: str | None = None

    def __enter__(self) -> Self:
        try:
            self._runner.run(self._begin())
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._runner.run(self._end())
        finally:
            self._runner.close()

    def submit(self, number: int, function: Callable[[Any], Any], item: Any) -> None:
        """As of `Executor`."""
        self._under_way[number] = _Task(function, item)
        self._unsent.append(number)  # `next` sends several at once: half the time of one by one

    def next(self) -> tuple[int, Any]:
        """As of `Executor`."""
        return self._runner.run(self._next())

    async def _begin(self) -> None:
        self._ended = asyncio.Queue()
        _quiet()
        if self.scheduler == "local":
            with dask.config.set(LOCAL_SETTINGS):
                self._cluster = await LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=self._workers,
                    threads_per_worker=1,
                    processes=True,
                    memory_limit=self._memory,
                    dashboard_address=self._dashboard or "127.0.0.1:0",
                    asynchronous=True,
                    silence_logs=logging.CRITICAL,
                )
        await self._connect()
        self.link = self._client.dashboard_link if self._dashboard else None

    async def _end(self) -> None:
        for task in self._following:
            task.cancel()
        await asyncio.gather(*self._following, return_exceptions=True)
        if self._client is not None:
            await self._client.close()
        if self._cluster is not None:
            await self._cluster.close()

    async def _connect(self) -> None:
        """Reach the scheduler, which may be away for a while.

        Raises:
            StoppedError: It stays away.
        """
        deadline = time.monotonic() + self._patience_s
        where = self.scheduler if self._cluster is None else self._cluster.scheduler_address
        while True:
            try:
                self._client = await Client(  # type: ignore[no-untyped-call]
                    where, asynchronous=True, set_as_default=False, timeout=CONNECT_S
                )
                break
            except OSError as error:
                if time.monotonic() > deadline:
                    raise StoppedError(
                        f"no scheduler answers at {where} for {self._patience_s:g} s: start one by "
                        "`dask scheduler`, or take --scheduler local"
                    ) from error
                await asyncio.sleep(LOOK_S)
        self._connections += 1
        await self._count()

    async def _count(self) -> int:
        """Tasks that can run at a time; at least one slot is taken for tasks to wait in."""
        threads = await self._client.nthreads()
        there: int = sum(threads.values())
        self.slots = max(1, there)
        return there

    def _hand_out(self, numbers: list[int]) -> None:
        for number in numbers:
            task = self._under_way[number]
            key = f"seod-{self._client.id}-{self._connections}-{number}-{number in self._suspects}"
            future = self._client.submit(attempted, task.function, task.item, key=key, pure=False)
            following = asyncio.create_task(self._follow(number, future, self._connections))
            self._following.add(following)
            following.add_done_callback(self._following.discard)

    async def _follow(self, number: int, future: Any, connection: int) -> None:
        """Puts the end of one task, whatever it is, into the queue."""
        try:
            result = await future.result()
        except _CANCELLED:
            result = _Lost(connection)
        except Exception as error:  # noqa: BLE001 - of Dask: the task's own come as results
            result = error
        self._ended.put_nowait((number, result))

    async def _next(self) -> tuple[int, Any]:
        empty_since = time.monotonic()
        self._hand_out(self._unsent)
        self._unsent = []
        while True:
            try:
                number, result = await asyncio.wait_for(self._ended.get(), LOOK_S)
            except TimeoutError:
                empty_since = await self._look(empty_since)
                continue
            if isinstance(result, _Lost):
                await self._again(result)
            elif isinstance(result, KilledWorker) and number != self._alone:
                self._suspects.append(number)
                self._try_suspect()
            else:
                return self._end_of(number, result)

    def _end_of(self, number: int, result: Any) -> tuple[int, Any]:
        del self._under_way[number]
        if number == self._alone:
            self._suspects.remove(number)
            self._alone = None
        self._try_suspect()
        if isinstance(result, KilledWorker):
            return number, Failed(
                "its worker died again and again, the last time with no other task beside: "
                "more memory than a worker may take, or a crash"
            )
        return number, failed(result) if isinstance(result, Exception) else result

    def _try_suspect(self) -> None:
        """Once nothing else is under way: one of those who were there when workers died."""
        if self._suspects and self._alone is None and len(self._under_way) == len(self._suspects):
            self._alone = self._suspects[0]
            self._hand_out([self._alone])

    async def _look(self, empty_since: float) -> float:
        """Whether scheduler and workers are there; gives since when there is no worker.

        Raises:
            StoppedError: No worker for too long.
        """
        if self._client.status != "running":  # its futures say so as well, one by one
            return time.monotonic()
        try:
            there = await self._count()
        except OSError:
            return time.monotonic()
        if there:
            return time.monotonic()
        if time.monotonic() - empty_since > self._patience_s:
            where = self._client.scheduler.address if self._client.scheduler else self.scheduler
            raise StoppedError(
                f"the scheduler has had no worker for {self._patience_s:g} s: start some by "
                f"`dask worker {where}`"
            )
        return empty_since

    async def _again(self, lost: _Lost) -> None:
        """Everything under way, at a scheduler that was away."""
        if lost.connection != self._connections:
            return
        self._tell(
            f"the scheduler {self.scheduler} is away: waiting up to {self._patience_s:g} s for it, "
            f"then {len(self._under_way)} tasks are handed out again"
        )
        await self._client.close()
        await self._connect()
        waiting = [number for number in self._suspects if number != self._alone]
        self._hand_out([number for number in self._under_way if number not in waiting])
        self._tell(f"the scheduler {self.scheduler} is back")


def _quiet() -> None:
    """Dask's own log stays silent: what matters is told in sentences."""
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
