"""Long counts by the same door as `seod batch`: this process, workers of this machine, or a scheduler's.

Workers of a scheduler elsewhere need this checkout at the same path, `bench` and `tests/blind` in PYTHONPATH.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeVar

from seod.batch.door import LOCAL, door
from seod.batch.executor import Failed, completed

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterable, Iterator

Item = TypeVar("Item")


def add_options(parser: argparse.ArgumentParser, workers: int) -> None:
    """`--scheduler` and `--workers`, with how many there are where nothing is said."""
    parser.add_argument("--scheduler", default=LOCAL, help="local, or the address of one: tcp://host:8786")
    text = f"of this machine; 0: this process; default {workers}, with --scheduler those that it has"
    parser.add_argument("--workers", type=int, help=text)
    parser.set_defaults(usual_workers=workers)


def results(
    options: argparse.Namespace, function: Callable[[Item], Any], items: Iterable[Item]
) -> Iterator[tuple[Item, Any]]:
    """Each item with what the function gives, in any order; failures are told, not given.

    Args:
        options: Of `add_options`.
        function: Of a module that workers can import, not of the script itself.
        items: Can be pickled.
    """
    workers = options.workers
    if workers is None and options.scheduler == LOCAL:
        workers = options.usual_workers
    with door(options.scheduler, workers, tell=lambda text: print(text, file=sys.stderr)) as executor:
        for item, found in completed(executor, function, items):
            if isinstance(found, Failed):
                print(f"{item}: {found.why}", file=sys.stderr, flush=True)
            else:
                yield item, found
