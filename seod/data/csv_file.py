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
from seod.data.source import BLOCK_ROWS, Block, Group, ReadError, Remark, place

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
        """As `Source`."""
        group = self.groups[0]
        indices = [(index, c) for index, c in enumerate(group.columns) if c.name in wanted.get("", ())]
        with self._open() as (file, text):
            lines = _Lines(text, self._dialect.first)
            rows = self._cut(lines)
            while not lines.ended:
                at, batch = self._batch(rows, lines)
                if not batch:
                    return
                cells = list(zip(*batch, strict=True))
                values = {c.name: self._values(index, cells[index], at) for index, c in indices}
                yield Block(group, values, np.array(at, np.int64), min(1.0, file.tell() / self._size))

    @contextmanager
    def _open(self) -> Iterator[tuple[IO[bytes], IO[str]]]:
        """The file, and its text."""
        with self.path.open("rb") as file:
            raw = cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if self._zipped else file
            with io.TextIOWrapper(raw, self._dialect.encoding, newline="") as text:
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

    def _batch(self, rows: Iterator[list[str]], lines: _Lines) -> tuple[list[int], list[list[str]]]:
        """The next rows and their lines."""
        width = len(self._dialect.columns)
        at: list[int] = []
        batch: list[list[str]] = []
        try:
            for row in islice(rows, BLOCK_ROWS):
                if len(row) == width or self._fits(row, lines):
                    at.append(lines.line)
                    batch.append(row)
        except _CUT_OFF as error:
            lines.ended = True
            self.remarks.append(Remark("truncated", f"the end after row {lines.line} is missing: {error}"))
        except UnicodeDecodeError as error:
            message = f"is not {error.encoding} as the beginning is: {error.reason}"
            raise ReadError(f"{place(self.path, lines.line + 1)}: {message}") from error
        except csv.Error as error:
            raise ReadError(f"{place(self.path, lines.line)}: {error}") from error
        return at, batch

    def _fits(self, row: list[str], lines: _Lines) -> bool:
        """Refuse a row of another width; the last one may be cut off."""
        width = len(self._dialect.columns)
        if len(row) < width and not lines.whole:
            self.remarks.append(Remark("truncated", f"row {lines.line} is cut off and left out"))
            return False
        raise ReadError(f"{place(self.path, lines.line)}: has {len(row)} cells, the header {width}")

    def _values(self, index: int, cells: tuple[str, ...], at: list[int]) -> Values:
        column = self._dialect.columns[index]
        if column.text:
            return np.array(cells, object)
        if self._dialect.decimal != "," and index not in self._dialect.dates:
            try:
                return np.array(list(map(float, cells)))
            except ValueError:  # some are empty, or something else
                pass
        return np.array([self._value(index, cell, row) for cell, row in zip(cells, at, strict=True)])

    def _value(self, index: int, cell: str, row: int) -> float:
        dialect = self._dialect
        value = number(cell, dialect.decimal)
        if index in dialect.dates and (value is None or not math.isnan(value)):
            value = date(cell)
        if value is None and index in dialect.empty:
            self.remarks.append(
                Remark(
                    "unread", f"row {row}: column {dialect.columns[index].name!r}: text {cell!r} is left out"
                )
            )
            return math.nan
        if value is None:
            where = place(self.path, row, dialect.columns[index].name)
            right = "a date" if index in dialect.dates else _RIGHT[dialect.decimal]
            raise ReadError(f"{where}: {cell!r} is no number; expected {right}")
        return value


class _Lines:
    """Lines that are neither blank nor comment, from line `first` on.

    Attributes:
        line: Number of the newest one, from 1.
        whole: Whether that one ended in a line end.
        ended: Nothing more can be read.
    """

    def __init__(self, text: IO[str], first: int) -> None:
        self._text = text
        self._first = first
        self.line = 0
        self.whole = True
        self.ended = False

    def __iter__(self) -> Iterator[str]:
        for line in self._text:
            self.line += 1
            if self.line >= self._first and (line[0] in _VALUE_STARTS or not is_comment(line)):
                self.whole = line.endswith(("\n", "\r"))
                yield line
        self.ended = True
