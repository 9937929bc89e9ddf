"""Who does tasks: the contract, this process as one that keeps it, and how many are under way at a time."""

from __future__ import annotations

from collections import deque
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

from seod.files.user_files import said

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from types import TracebackType
    from typing import Self

Item = TypeVar("Item")

AHEAD = 4
"""Tasks that are handed out for each one that can run: one runs, the others wait near it. Fewer leave workers
idle while an answer travels (a task of 10 ms, 64 workers); more would only fill the scheduler's memory."""


class Failed(NamedTuple):
    """In the place of a task's result: why there is none."""

    why: str


class StoppedError(Exception):
    """No task can be done any more; the message says why."""


class Executor(Protocol):
    """Does tasks, in any order. A context manager: what it started ends with it."""

    @property
    def slots(self) -> int:
        """Tasks that can run at the same time, now."""

    def submit(self, number: int, function: Callable[[Any], Any], item: Any) -> None:
        """Hand out `function(item)` under a number that no other task under way has."""

    def next(self) -> tuple[int, Any]:
        """Number and result of a task that has ended, each once: what the function gave, or `Failed`.

        Raises:
            StoppedError: No task can be done any more.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Here:
    """Does tasks in this process, one after the other."""

    slots = 1

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Callable[[Any], Any], Any]] = deque()

    def submit(self, number: int, function: Callable[[Any], Any], item: Any) -> None:
        """As of `Executor`."""
        self._waiting.append((number, function, item))

    def next(self) -> tuple[int, Any]:
        """As of `Executor`."""
        number, function, item = self._waiting.popleft()
        return number, attempted(function, item)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.clear()


def attempted(function: Callable[[Item], Any], item: Item) -> Any:
    """What the function gives; `Failed` where it raises."""
    try:
        return function(item)
    except Exception as error:  # noqa: BLE001 - whatever a task raises is its own failure
        return failed(error)


def failed(error: Exception) -> Failed:
    """What an exception says, with its kind where that says more."""
    if isinstance(error, OSError) and error.strerror:
        return Failed(said(error))
    text = " ".join(str(error).split())
    return Failed(f"{type(error).__name__}: {text}" if text else type(error).__name__)


def completed(
    executor: Executor, function: Callable[[Item], Any], items: Iterable[Item], ahead: int = AHEAD
) -> Iterator[tuple[Item, Any]]:
    """Do `function` of all items; gives each with its result as it ends, in any order.

    Never more than `ahead` times the executor's slots are under way, so that a million tasks need no more
    memory than a hundred.

    Args:
        executor: Who does it.
        function: Can be found by its name in other processes.
        items: Taken one by one.
        ahead: Tasks under way for each slot.

    Yields:
        An item, and what the function gave, or `Failed`.

    Raises:
        StoppedError: As of the executor.
    """
    waiting, under_way = enumerate(items), dict[int, Item]()
    while True:
        room = max(1, ahead * executor.slots) - len(under_way)
        for number, item in islice(waiting, max(room, 0)):
            under_way[number] = item
            executor.submit(number, function, item)
        if not under_way:
            return
        number, result = executor.next()
        yield under_way.pop(number), result
