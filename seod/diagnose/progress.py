"""How far a diagnosis is: one bar on a terminal, with the step that is under way."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextmanager
def bar(console: Console | None = None) -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error; gives the function that takes the step's name and how far all is, 0 to 1."""
    console = console or Console(file=sys.stderr)
    columns = (TextColumn("{task.description:32}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        task = shown.add_task("", total=1.0)
        yield lambda step, fraction: shown.update(task, description=step, completed=fraction)
