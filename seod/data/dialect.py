"""How a text file of measured data is written: encoding, separator, decimal mark, header, units. Pure.

Found from the beginning of the file: the reading in which most cells are numbers is the right one. What
stands above the first row of numbers is header, units and talk.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections import Counter
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from seod.data.source import Column, ReadError
from seod.data.units import is_unit_cell, split_header, unit_of_cell

if TYPE_CHECKING:
    from collections.abc import Sequence

COMMENTS = ("#", "%", "//")
_TRIED = (
    (",", "."),
    (";", ","),
    (";", "."),
    ("\t", "."),
    ("\t", ","),
    ("|", "."),
    (" ", "."),
    (" ", ","),
    (",", ","),
)
_LOOKED_AT = 50
"""Rows at the end of the sample by which readings are compared."""

MISSING = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a", "nil"))
"""Words, in lower case, for a value that is not there."""

LONGEST_NUMBER = 400
"""Characters; the longest that a program prints of a double is 1 + 309 + 17. What is longer is damage, and
takes time that grows with the square of its length to convert."""
_NUMBER = re.compile(
    r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*|\s*[-+]?inf(inity)?\s*", re.ASCII | re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to read the rest of the file.

    Attributes:
        encoding: Python's name of it.
        separator: Between cells; a space stands for any white space.
        decimal: `.` or `,`, "" if the beginning does not tell.
        columns: Those of the header; numbered from 1 if there is none.
        first: Line of the first row of values, from 1.
        dates: Indices of columns that hold dates.
        empty: Indices of columns that have no value yet.
        unnamed: Columns at the end that the header has no cell for.
    """

    encoding: str
    separator: str
    decimal: str
    columns: tuple[Column, ...]
    first: int
    dates: frozenset[int] = frozenset()
    empty: frozenset[int] = frozenset()
    unnamed: int = 0


def encoding_of(data: bytes) -> str:
    """Of the beginning of a file: by its byte order mark, else UTF-8, else that of Windows in the west."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(data)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def cells(line: str, separator: str) -> list[str]:
    """One line, cut."""
    if separator == " ":
        return line.split()
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def is_comment(line: str) -> bool:
    """Whether a line is left out wherever it stands."""
    return not line.strip() or line.lstrip().startswith(COMMENTS)


def number(cell: str, decimal: str) -> float | None:
    """A cell's number, nan where a word says that there is none; None if it is something else."""
    if len(cell) > LONGEST_NUMBER or (decimal == "," and "." in cell):
        return None
    if decimal != ".":
        cell = cell.replace(",", ".")
    if _NUMBER.fullmatch(cell):
        return float(cell)
    return float("nan") if cell.strip().lower() in MISSING else None


def date(cell: str) -> float | None:
    """Date and time in ISO's form as seconds since 1970 (UTC where it tells no zone); None for all else."""
    try:
        when = datetime.fromisoformat(cell.strip().replace(",", "."))
    except ValueError:
        return None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _is_number(cell: str, decimal: str) -> bool:
    value = number(cell, decimal)
    return value is not None and not math.isnan(value)


def _score(lines: list[str], separator: str, decimal: str) -> tuple[float, int]:
    """Numbers in rows of the best width, as part of the cells of all rows with any; and that width, or 0."""
    numbers: Counter[int] = Counter()
    total = 0
    for line in lines:
        row = cells(line, separator)
        found = sum(_is_number(cell, decimal) for cell in row)
        numbers[len(row)] += found
        total += len(row) if found else 0
    width = max((width for width in numbers if width > 1), key=lambda width: numbers[width], default=0)
    return (numbers[width] / total, width) if numbers[width] else (0.0, 0)


def _best(lines: list[str]) -> tuple[str, str, int]:
    """Separator, decimal mark ("" if it can be either) and width that make the most of these lines."""
    scores = {tried: _score(lines, *tried) for tried in _TRIED}
    separator, decimal = best = max(_TRIED, key=lambda tried: scores[tried])
    either = scores[best] == scores.get((separator, "," if decimal == "." else "."))
    return separator, "" if either else decimal, scores[best][1]


def detect(data: bytes, path: str, complete: bool) -> Dialect:
    """Of the beginning of a file.

    Args:
        data: Its first bytes, decompressed.
        path: For messages.
        complete: Whether that is all of it; else the last line is not looked at.

    Raises:
        ReadError: No table of numbers in it.
    """
    encoding = encoding_of(data)
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(data, final=complete)
    except UnicodeDecodeError as error:
        raise ReadError(f"{path}: is no text: {error}") from error
    lines = text.splitlines()
    if not complete and len(lines) > 1:
        lines.pop()
    numbered = [(at, line) for at, line in enumerate(lines, 1) if not is_comment(line)]
    if not numbered:
        raise ReadError(f"{path}: is empty; expected a header line and rows of numbers")
    separator, decimal, width = _best([line for _, line in numbered[-_LOOKED_AT:]])
    every = [(at, cells(line, separator)) for at, line in numbered]
    rows = [(at, row) for at, row in every if len(row) == width]
    found = _with_header(rows, Dialect(encoding, separator, decimal, (), 0)) if width else None
    if found is not None:
        own = [at for at, _ in rows if at < found.first]
        words = _words(every, found)
        found = found if own or not words else _with_other_header(every, words[-1], found)
        found = _with_odd_rows(every, max(own or words, default=0), found)
    if found is None:
        raise ReadError(
            f"{path}: no table of numbers in it: expected a header line and rows of at least two cells, "
            "separated by commas, semicolons, tabs or spaces"
        )
    return found


def _with_header(rows: list[tuple[int, list[str]]], found: Dialect) -> Dialect | None:
    """Complete a dialect by its rows of the right width and their lines; None if none of them has values."""
    columns = list(zip(*(row for _, row in rows[-_LOOKED_AT:]), strict=True))
    numeric = [
        k for k, column in enumerate(columns) if any(_is_number(cell, found.decimal) for cell in column)
    ]
    dates = frozenset(
        k for k, column in enumerate(columns) if k not in numeric and date(column[-1]) is not None
    )
    begin = next((k for k, (_, row) in enumerate(rows) if _is_values(row, numeric, found.decimal)), None)
    if begin is None:
        return None
    values = zip(*(row for _, row in rows[begin:][-_LOOKED_AT:]), strict=True)
    numbers = [k for k, column in enumerate(values) if k in numeric or k in dates or _is_empty(column)]
    names = _columns([row for _, row in rows[:begin]], len(columns), numbers, dates)
    empty = frozenset(numbers) - frozenset(numeric) - dates
    return replace(found, columns=names, first=rows[begin][0], dates=dates, empty=empty)


def _words(rows: list[tuple[int, list[str]]], found: Dialect) -> list[int]:
    """Lines above the values that have words in several cells, and no number."""
    return [
        at
        for at, row in rows
        if at < found.first and len(row) > 1 and not any(_is_number(cell, found.decimal) for cell in row)
    ]


def _with_other_header(rows: list[tuple[int, list[str]]], line: int, found: Dialect) -> Dialect:
    """By the header of a logger that ends its rows, or its header, in a separator that the other has not."""
    width = len(found.columns)
    header = next(row for at, row in rows if at == line)
    if any(header[width:]):
        return found
    named = _columns(
        [[*header, *map(str, range(len(header) + 1, width + 1))][:width]], width, [], frozenset()
    )
    columns = tuple(replace(new, text=old.text) for new, old in zip(named, found.columns, strict=True))
    first = next(at for at, _ in rows if at > line)
    return replace(found, columns=columns, first=first, unnamed=max(0, width - len(header)))


def _with_odd_rows(rows: list[tuple[int, list[str]]], header: int, found: Dialect) -> Dialect:
    """Begun at rows of another width right below the header's line: they are not to vanish."""
    begin = next(
        (at for at, row in rows if header < at < found.first and _begins_as_values(row, found)), None
    )
    return found if begin is None else replace(found, first=begin)


def _begins_as_values(row: list[str], found: Dialect) -> bool:
    """Whether a row of any width has, in the first column of numbers or dates, one of these."""
    index = next(k for k, column in enumerate(found.columns) if not column.text and k not in found.empty)
    if index >= len(row):
        return False
    return date(row[index]) is not None if index in found.dates else _is_number(row[index], found.decimal)


def _is_empty(column: Sequence[str]) -> bool:
    return all(cell.strip().lower() in MISSING for cell in column)


def _is_values(row: list[str], numeric: list[int], decimal: str) -> bool:
    """Whether a row has numbers, or words for none, where numbers belong; and at least one number."""
    found = [number(row[index], decimal) for index in numeric]
    return None not in found and any(_is_number(row[index], decimal) for index in numeric)


def _columns(
    above: list[list[str]], width: int, numbers: list[int], dates: frozenset[int]
) -> tuple[Column, ...]:
    names, units = [str(index + 1) for index in range(width)], [""] * width
    if above:
        has_units = len(above) > 1 and all(map(is_unit_cell, above[-1])) and any(above[-1])
        split = [split_header(cell) for cell in above[-2 if has_units else -1]]
        names = [name or str(index + 1) for index, (name, _) in enumerate(split)]
        units = [unit for _, unit in split]
        if has_units:
            units = [unit or unit_of_cell(cell) for unit, cell in zip(units, above[-1], strict=True)]
    return tuple(
        Column(name, "s" if index in dates else unit, index not in numbers)
        for index, (name, unit) in enumerate(zip(names, units, strict=True))
    )
