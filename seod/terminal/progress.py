"""A bar for work that takes long, on a terminal only; it goes away in the end."""

from __future__ import annotations

import json
import os
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from seod.terminal.console import console

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console

    Show = Callable[[str, float], None]

Made = TypeVar("Made")

QUICK_S = 0.5
"""Shorter work shows nothing."""
REFRESH_S = 0.1
PROGRESS_FD = "SEOD_PROGRESS_FD"
"""Environment variable: a descriptor that is told as well, a line of JSON a step."""


@contextmanager
def bar(talk: Console | None = None) -> Iterator[Show]:
    """A bar; gives the function that takes the step under way and how far all is, 0 to 1.

    Args:
        talk: Where to; standard error if left out.
    """
    talk = talk or console()
    told = told_elsewhere()
    columns = (
        TextColumn("{task.description:32}", markup=False),
        BarColumn(),
        TaskProgressColumn(markup=False),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=talk, transient=True, disable=not talk.is_terminal) as shown:
        task = shown.add_task("", total=1.0)

        def show(step: str, part: float) -> None:
            shown.update(task, description=step, completed=part)
            told(step, part)

        yield show


def told_elsewhere() -> Show:
    """Tells the descriptor that the environment names; does nothing where there is none."""
    number = os.environ.get(PROGRESS_FD)
    if number is None:
        return lambda _step, _part: None

    def tell(step: str, part: float) -> None:
        line = json.dumps({"step": step, "part": part}).encode() + b"\n"
        os.write(int(number), line)

    return tell


def watched(
    what: str, work: Callable[[], Made], fraction: Callable[[], float], talk: Console | None = None
) -> Made:
    """Do `work` in a thread and, on a terminal, show `fraction` of it done meanwhile.

    Whatever `work` raises is raised here. An interrupt is heard at once, even while compiled code runs, and
    leaves the thread to the end of the process.

    Args:
        what: In front of the bar.
        work: What is to be done.
        fraction: Tells how far it is, 0 to 1.
        talk: Where to; standard error if left out.
    """
    talk = talk or console()
    done: list[Made] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:  # noqa: BLE001 - raised again by whoever waits
            raised.append(error)

    thread = threading.Thread(target=run, name=what, daemon=True)
    thread.start()
    thread.join(QUICK_S if talk.is_terminal else None)
    if thread.is_alive():
        with bar(talk) as show:
            while thread.is_alive():
                show(what, fraction())
                thread.join(REFRESH_S)
    if raised:
        raise raised[0]
    return done[0]
