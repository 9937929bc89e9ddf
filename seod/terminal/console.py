"""Consoles of rich that print words as they are: brackets in a path or a question are no markup."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from typing import TextIO

    from rich.table import Table


def console(stream: TextIO | None = None) -> Console:
    """Where a person is talked to.

    Args:
        stream: Standard error if left out: standard output is for answers.
    """
    return Console(file=stream or sys.stderr, markup=False, highlight=False, emoji=False)


def ask(talk: Console, question: str) -> str:
    """The line that a person answers with, without the spaces around it.

    Raises:
        EOFError: Nobody is there.
    """
    return talk.input(question, markup=False, emoji=False).strip()


def as_text(*tables: Table, width: int) -> str:
    """Tables as lines of text, at most `width` characters long, each without spaces at its end."""
    page = io.StringIO()
    talk = Console(file=page, width=width, markup=False, highlight=False, emoji=False)
    for table in tables:
        talk.print(table)
    return "\n".join(line.rstrip() for line in page.getvalue().splitlines())
