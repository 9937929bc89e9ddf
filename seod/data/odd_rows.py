"""Rows and cells of a text file that are none: left out and said, each kind once with where it began."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from seod.data.source import ReadError, Remark, place
from seod.files.damage import plain, said

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FEW_CELLS: Final = 20
"""Cells of a column that may be no numbers, whatever the file's length ..."""
FEW_PART: Final = 0.02
"""... and beyond that this part of its rows: more are no damage, but another way to write numbers."""
_SHOWN: Final = 40
"""Characters of a cell that are shown."""
_KINDS: Final = 20
"""Remarks of each kind; a damaged file may give one for each of its cells."""


def shown(cell: str) -> str:
    """A cell in a message."""
    return repr(cell if len(cell) <= _SHOWN else f"{cell[:_SHOWN]}...")


@dataclass
class _Seen:
    """What is wrong, where it was first, and in how many rows."""

    row: int
    first: str
    count: int = 0


class OddRows:
    """What is odd in a file, gathered while it is read through."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notes: dict[tuple[str, str], _Seen] = {}
        self._cells: dict[str, _Seen] = {}
        self._end: list[Remark] = []

    def note(self, kind: str, what: str, row: int, cells: Sequence[str] = ()) -> None:
        """A row is odd; its cells are shown where it is the first of its kind."""
        seen = self._notes.get((kind, what))
        if seen is None and len(self._notes) < _KINDS:
            text = f": {shown(' '.join(cells))}" if cells else ""
            seen = self._notes[kind, what] = _Seen(row, f"{what}{text}")
        if seen is not None:
            seen.count += 1

    def cell(self, column: str, what: str, row: int) -> None:
        """A cell that should be a number is none."""
        self._cells.setdefault(column, _Seen(row, what)).count += 1

    def end(self, row: int, error: Exception) -> None:
        """Nothing can be read after this row."""
        kind = "truncated" if isinstance(error, EOFError) else "damaged"
        self._end.append(Remark(kind, f"the end after row {row} is missing: {said(error)}"))

    def check(self, rows: int) -> None:
        """After so many rows of the file.

        Raises:
            ReadError: So many cells of a column are no numbers that the file is misread rather than damaged.
        """
        for column, seen in self._cells.items():
            if seen.count > FEW_CELLS + FEW_PART * rows:
                raise ReadError(
                    f"{place(self._path, seen.row, column)}: {seen.first}; so in {seen.count} rows"
                )

    def remarks(self) -> list[Remark]:
        """All, in their order."""
        rows = [
            _remark(kind, f"row {seen.row}: {seen.first}", seen) for (kind, _), seen in self._notes.items()
        ]
        cells = [
            _remark("damaged", f"row {seen.row}: column {column!r}: {seen.first}; left out", seen)
            for column, seen in self._cells.items()
        ]
        return [*rows, *cells, *self._end]


def _remark(kind: str, message: str, seen: _Seen) -> Remark:
    more = f"; so in {seen.count} rows" if seen.count > 1 else ""
    return Remark(kind, plain(f"{message}{more}"), seen.count)
