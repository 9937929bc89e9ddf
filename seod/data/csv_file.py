"""CSV and its relatives, plain or gzip, read line by line."""

from __future__ import annotations

import csv
import gzip
import io
import math
import zlib
from contextlib import contextmanager
from itertools import islice
from typing import IO, TYPE_CHECKING, cast

import numpy as np

from seod.data.dialect import Dialect, date, detect, is_comment, number
from seod.data.odd_rows import OddRows, shown
from seod.data.source import BLOCK_ROWS, Block, Group, ReadError, Remark

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from seod.data.source import Values

_VALUE_STARTS = frozenset("0123456789-+.")
"""A line that begins so needs no closer look: it is no comment."""
_SAMPLE_BYTES = 1 << 16
_RIGHT = {
    ".": "a number with a decimal point, or nothing",
    ",": "a number with a decimal comma, or nothing",
    "": "a number, or nothing",
}
_CUT_OFF = (OSError, EOFError, zlib.error)
"""What a damaged or cut-off gzip file raises."""
_LONGEST_LINE = 1 << 20
"""Characters of a line; a longer one is no row, and is not held in memory."""
_CELLS = 1 << 20
"""Cells that are in memory at once, as text."""


class CsvSource:
    """A text file as one group, its rows named by their lines.

    Raises:
        ReadError: It is not text, or has no table of numbers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: list[Remark] = []
        self._size = max(1, path.stat().st_size)
        with path.open("rb") as file:
            self._zipped = file.read(2) == b"\x1f\x8b"
        self.format = "csv.gz" if self._zipped else "csv"
        self._dialect = self._detect()
        columns = self._dialect.columns
        self._check_names([column.name for column in columns])
        self.groups: tuple[Group, ...] = (Group("", columns),)
        self.notes: Mapping[str, str] = {}

    def close(self) -> None:
        """Nothing stays open."""

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; what is no row, and cells that are none, are left out and said."""
        group = self.groups[0]
        indices = [(index, c) for index, c in enumerate(group.columns) if c.name in wanted.get("", ())]
        odd = OddRows(self.path)
        if self._dialect.unnamed:
            named = len(group.columns) - self._dialect.unnamed
            odd.note("unread", f"has more cells than the header's {named}", self._dialect.first)
        with self._open() as (file, text):
            lines = _Lines(text, self._dialect.first, odd)
            rows = self._cut(lines)
            while not lines.ended:
                at, batch = self._batch(rows, lines, odd)
                if not batch:
                    break
                cells = list(zip(*batch, strict=True))
                values = {c.name: self._values(index, cells[index], at, odd) for index, c in indices}
                odd.check(at[-1] - self._dialect.first + 1)
                yield Block(group, values, np.array(at, np.int64), min(1.0, file.tell() / self._size))
        self.remarks += odd.remarks()

    @contextmanager
    def _open(self) -> Iterator[tuple[IO[bytes], IO[str]]]:
        """The file, and its text."""
        with self.path.open("rb") as file:
            raw = cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if self._zipped else file
            with io.TextIOWrapper(raw, self._dialect.encoding, "replace", newline="") as text:
                yield file, text

    def _detect(self) -> Dialect:
        with self.path.open("rb") as file:
            stream = cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if self._zipped else file
            try:
                sample = stream.read(_SAMPLE_BYTES)
            except (*_CUT_OFF, UnicodeDecodeError) as error:
                raise ReadError(f"{self.path}: {error}") from error
        return detect(sample, str(self.path), complete=len(sample) < _SAMPLE_BYTES)

    def _check_names(self, names: Sequence[str]) -> None:
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ReadError(f"{self.path}: two columns are named {name!r}; give each a name of its own")

    def _cut(self, lines: _Lines) -> Iterator[list[str]]:
        if self._dialect.separator == " ":
            return (line.split() for line in lines)
        return csv.reader(lines, delimiter=self._dialect.separator, skipinitialspace=True)

    def _batch(
        self, rows: Iterator[list[str]], lines: _Lines, odd: OddRows
    ) -> tuple[list[int], list[list[str]]]:
        """The next rows and their lines."""
        width = len(self._dialect.columns)
        at: list[int] = []
        batch: list[list[str]] = []
        most = max(1, min(BLOCK_ROWS, _CELLS // width))
        while not lines.ended and len(batch) < most:
            try:
                for row in islice(rows, most - len(batch)):
                    fitted = row if len(row) == width else self._fitted(row, lines, odd)
                    if fitted is not None:
                        at.append(lines.line)
                        batch.append(fitted)
            except csv.Error as error:  # the row after it is read as any other
                odd.note("damaged", f"cannot be read: {error}", lines.line)
            except _CUT_OFF as error:
                lines.ended = True
                odd.end(lines.line, error)
            else:
                break
        return at, batch

    def _fitted(self, row: list[str], lines: _Lines, odd: OddRows) -> list[str] | None:
        """A row of another width, as wide as the others; None if it is none."""
        width, missing = len(self._dialect.columns), len(self._dialect.columns) - len(row)
        if missing < 0:
            odd.note("unread", f"has more cells than the header's {width}: those are left out", lines.line)
            return row[:width]
        if missing <= self._dialect.unnamed:
            return row + [""] * missing
        if lines.whole:
            odd.note("unread", f"is left out: it has fewer cells than the header's {width}", lines.line, row)
        else:
            self.remarks.append(Remark("truncated", f"row {lines.line} is cut off and left out"))
        return None

    def _values(self, index: int, cells: tuple[str, ...], at: list[int], odd: OddRows) -> Values:
        column = self._dialect.columns[index]
        if column.text:
            return np.array(cells, object)
        if self._dialect.decimal != "," and index not in self._dialect.dates:
            try:
                return np.array(list(map(float, cells)))
            except ValueError:  # some are empty, or something else
                pass
        return np.array([self._value(index, cell, row, odd) for cell, row in zip(cells, at, strict=True)])

    def _value(self, index: int, cell: str, row: int, odd: OddRows) -> float:
        dialect = self._dialect
        value = number(cell, dialect.decimal)
        if index in dialect.dates and (value is None or not math.isnan(value)):
            value = date(cell)
        if value is not None:
            return value
        name = dialect.columns[index].name
        if index in dialect.empty:
            odd.note("unread", f"column {name!r}: text {shown(cell)} is left out", row)
        else:
            right = "a date" if index in dialect.dates else _RIGHT[dialect.decimal]
            odd.cell(name, f"{shown(cell)} is no number; expected {right}", row)
        return math.nan


class _Lines:
    """Lines that are neither blank nor comment, from line `first` on.

    Attributes:
        line: Number of the newest one, from 1.
        whole: Whether that one ended in a line end.
        ended: Nothing more can be read.
    """

    def __init__(self, text: IO[str], first: int, odd: OddRows) -> None:
        self._text = text
        self._first = first
        self._odd = odd
        self.line = 0
        self.whole = True
        self.ended = False

    def __iter__(self) -> Iterator[str]:
        read = self._text.readline
        while line := read(_LONGEST_LINE):
            self.line += 1
            if len(line) == _LONGEST_LINE:
                self._pass_over()
            elif self.line >= self._first and (line[0] in _VALUE_STARTS or not is_comment(line)):
                self.whole = line.endswith(("\n", "\r"))
                yield line
        self.ended = True

    def _pass_over(self) -> None:
        """The rest of a line that is too long."""
        self._odd.note("damaged", f"is left out: it has more than {_LONGEST_LINE} characters", self.line)
        while (rest := self._text.readline(_LONGEST_LINE)) and not rest.endswith(("\n", "\r")):
            pass
