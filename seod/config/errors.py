"""What is wrong with a rig file: all of it at once, each with its place."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

KeyPath = tuple[str | int, ...]
"""Keys and list indices from the top of the file to a value."""

LISTED = 30
"""Longest list of possible names in one message."""


@dataclass(frozen=True, slots=True)
class ConfigError:
    """One mistake.

    Attributes:
        file: The rig file as the user named it.
        line: Line, from 1.
        key: Dotted path, such as `axes.motor.limits.travel[0]`; "" for the file as a whole.
        message: What is wrong.
        right: What would be right, where the message does not say it already.
    """

    file: str
    line: int
    key: str
    message: str
    right: str = ""

    def __str__(self) -> str:
        parts = [f"{self.file}:{self.line}", self.key, self.message]
        return ": ".join(part for part in parts if part) + (f"; {self.right}" if self.right else "")


class ConfigErrors(Exception):  # noqa: N818 - it is many
    """All mistakes of a rig file, in the order of its lines; the text has one line for each."""

    def __init__(self, errors: Iterable[ConfigError]) -> None:
        self.errors = sorted(dict.fromkeys(errors), key=lambda error: (error.line, error.key))
        super().__init__("\n".join(map(str, self.errors)))


def dotted(path: KeyPath) -> str:
    """`("axes", "motor", "travel", 0)` as `axes.motor.travel[0]`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def suggest(name: str, known: Iterable[str], kind: str) -> str:
    """`did you mean 'rate_hz'? known keys: cpu, pace, rate_hz` for a name that is not known."""
    names = sorted(known)
    if not names:
        return f"there are no {kind}"
    close = difflib.get_close_matches(name, names, n=1) or [
        known_name for known_name in names if known_name.lower() == name.lower()
    ]
    hint = f"did you mean {close[0]!r}? " if close else ""
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return f"{hint}known {kind}: {', '.join(names[:LISTED])}{more}"
