"""Which executor does the work: this process, workers of this machine, or a scheduler's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.batch.executor import Here
from seod.machine.limits import processors

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.batch.executor import Executor

LOCAL = "local"


def door(
    scheduler: str = LOCAL,
    workers: int | None = None,
    memory: str = "auto",
    tell: Callable[[str], None] = lambda _: None,
) -> Executor:
    """An executor, to be used as a context manager.

    Args:
        scheduler: `local`, or the address of a scheduler of Dask, `tcp://host:8786`.
        workers: Of this machine; 0: this process alone; None: one for each processor.
        memory: Of each of them: `2 GB`, `auto`.
        tell: Takes sentences for whoever waits.

    Raises:
        ValueError: The address is none, or a number of workers is given with it.
        ImportError: Dask is not installed.
    """
    if scheduler != LOCAL and "://" not in scheduler:
        raise ValueError(f"--scheduler {scheduler}: give local, or an address such as tcp://host:8786")
    if scheduler != LOCAL and workers is not None:
        raise ValueError(f"--workers: {scheduler} has its own; leave it out")
    if workers == 0:
        return Here()
    try:
        from seod.batch.cluster import OnDask  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ImportError("workers need Dask: pip install 'seod[batch]'; --workers 0 does without") from error
    return OnDask(scheduler, processors() if workers is None else workers, memory, tell=tell)
