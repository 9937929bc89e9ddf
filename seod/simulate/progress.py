"""Shows how far long work has come, on a terminal only; work that is quick shows nothing."""

from __future__ import annotations

import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from rich.console import Console
from rich.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

T = TypeVar("T")

QUICK_S = 0.5
"""Shorter work shows nothing."""
REFRESH_S = 0.1


@contextmanager
def shown(what: str, console: Console | None = None) -> Iterator[Callable[[float], None]]:
    """A bar with `what` in front, on a terminal; gives the function that takes how far it is, 0 to 1."""
    console = console or Console(file=sys.stderr)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


def watched(
    what: str, work: Callable[[], T], fraction: Callable[[], float], console: Console | None = None
) -> T:
    """Do `work` in a thread and, on a terminal, show `fraction` of it done meanwhile.

    Whatever `work` raises is raised here. An interrupt is heard at once, even while compiled code runs, and
    leaves the thread to the end of the process.

    Args:
        what: In front of the bar.
        work: What is to be done.
        fraction: Tells how far it is, 0 to 1.
        console: Where to; standard error where left out.
    """
    console = console or Console(file=sys.stderr)
    done: list[T] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:  # noqa: BLE001 - raised again by whoever waits
            raised.append(error)

    thread = threading.Thread(target=run, name=what, daemon=True)
    thread.start()
    thread.join(QUICK_S if console.is_terminal else None)
    if thread.is_alive():
        with shown(what, console) as show:
            while thread.is_alive():
                show(fraction())
                thread.join(REFRESH_S)
    if raised:
        raise raised[0]
    return done[0]
