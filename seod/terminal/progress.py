"""Progress of work that takes long: a bar on a terminal, which goes away in the end, else plain lines."""

from __future__ import annotations

import json
import os
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
PROGRESS_FD = "SEOD_PROGRESS_FD"
"""Environment variable: a descriptor that is told as well, a line of JSON a step."""


@contextmanager
def bar(talk: Console | None = None) -> Iterator[Show]:
    """A bar; gives the function that takes the step under way and how far all is, 0 to 1.

    Where there is no terminal, a line for each step that begins once the work has taken `PATIENCE_S`.

    Args:
        talk: Where to; standard error if left out.
    """
    talk = talk or console()
    told = told_elsewhere()
    if not talk.is_terminal:
        yield _lines(talk, told)
        return
    columns = (
        TextColumn("{task.description:32}", markup=False),
        BarColumn(),
        TaskProgressColumn(markup=False),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=talk, transient=True) as shown:
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


def _lines(talk: Console, tell: Show) -> Show:
    """Progress as plain lines: `trying causes, 23 %`; each step goes to `tell` as well."""
    began, told = time.monotonic(), [""]

    def show(step: str, part: float) -> None:
        tell(step, part)
        if step == told[0] or time.monotonic() < began + PATIENCE_S or part >= 1.0:
            return
        told[0] = step
        talk.print(f"{step}, {100.0 * part:.0f} %")

    return show
