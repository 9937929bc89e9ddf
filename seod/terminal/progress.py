"""Progress of work that takes long: a bar on a terminal, which goes away in the end, else plain lines."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from seod.terminal.console import console

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console

    Show = Callable[[str, float], None]

PATIENCE_S = 5.0
"""Lines are printed of work only that has taken so long."""


@contextmanager
def bar(talk: Console | None = None) -> Iterator[Show]:
    """A bar; gives the function that takes the step under way and how far all is, 0 to 1.

    Where there is no terminal, a line for each step that begins once the work has taken `PATIENCE_S`.

    Args:
        talk: Where to; standard error if left out.
    """
    talk = talk or console()
    if not talk.is_terminal:
        yield _lines(talk)
        return
    columns = (
        TextColumn("{task.description:32}", markup=False),
        BarColumn(),
        TaskProgressColumn(markup=False),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=talk, transient=True) as shown:
        task = shown.add_task("", total=1.0)
        yield lambda step, part: shown.update(task, description=step, completed=part)


def _lines(talk: Console) -> Show:
    """Progress as plain lines: `trying causes, 23 %`."""
    began, told = time.monotonic(), [""]

    def show(step: str, part: float) -> None:
        if step == told[0] or time.monotonic() < began + PATIENCE_S or part >= 1.0:
            return
        told[0] = step
        talk.print(f"{step}, {100.0 * part:.0f} %")

    return show
