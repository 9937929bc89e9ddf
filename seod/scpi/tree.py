"""Headers in their long and short forms: `MEASure:ZETA?` answers to MEAS:ZETA? and MEASURE:ZETA? alone."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Generic, TypeVar

from seod.scpi.errors import ScpiError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seod.scpi.parser import Command

T = TypeVar("T")
_NODE: Final = re.compile(r"(\[)?:?([*A-Za-z0-9]+)\]?")


@dataclass(frozen=True, slots=True)
class Node:
    """One word of a header: its two forms, and whether it may be left out."""

    short: str
    long: str
    optional: bool

    def matches(self, word: str) -> bool:
        """Whether a word in capitals is this."""
        return word in {self.short, self.long}


def nodes(pattern: str) -> tuple[Node, ...]:
    """The words of a pattern such as `INITiate[:IMMediate]`; capitals are the short form."""
    found = []
    for bracket, word in _NODE.findall(pattern.removesuffix("?")):
        short = "".join(char for char in word if not char.islower())
        found.append(Node(short, word.upper(), bool(bracket)))
    return tuple(found)


def matches(pattern: tuple[Node, ...], header: tuple[str, ...]) -> bool:
    """Whether a header is a pattern's, with what may be left out left out or not."""
    if not pattern:
        return not header
    first, rest = pattern[0], pattern[1:]
    if header and first.matches(header[0]) and matches(rest, header[1:]):
        return True
    return first.optional and matches(rest, header)


class Tree(Generic[T]):
    """What each header means.

    Args:
        table: By pattern; with `?` at the end for a query.
    """

    def __init__(self, table: Mapping[str, T]) -> None:
        self._entries = [(nodes(pattern), pattern.endswith("?"), what) for pattern, what in table.items()]
        self.patterns = list(table)

    def find(self, command: Command) -> T:
        """What a command means.

        Raises:
            ScpiError: There is no such header.
        """
        for pattern, query, what in self._entries:
            if query == command.query and matches(pattern, command.header):
                return what
        raise ScpiError(-113, ":".join(command.header) + ("?" if command.query else ""))
