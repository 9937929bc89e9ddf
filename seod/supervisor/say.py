"""What the daemon tells the journal, or the terminal. Standard library only."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """One line for the journal or the terminal."""
    print(f"seod: {text}", file=sys.stderr, flush=True)  # noqa: T201 - the daemon's own log
