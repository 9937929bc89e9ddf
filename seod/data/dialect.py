"""How a text file of measured data is written: encoding, separator, decimal mark, header, units. Pure.

Found from the beginning of the file: the reading in which most cells are numbers is the right one. What
stands above the first row of numbers is header, units and talk.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime

from seod.data.source import Column, ReadError
from seod.data.units import is_unit_cell, split_header, unit_of_cell

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

_NUMBER = re.compile(
    r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*|\s*[-+]?inf(inity)?\s*", re.ASCII | re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to read the rest of the file.

    Attributes:
        encoding: Python's name of it.
        separator: Between cells; a space stands for any white space.
        decimal: `.` or `,`.
        columns: Those of the header; numbered from 1 if there is none.
        first: Line of the first row of values, from 1.
        dates: Indices of columns that hold dates.
    """

    encoding: str
    separator: str
    decimal: str
    columns: tuple[Column, ...]
    first: int
    dates: frozenset[int]


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
    if decimal == ",":
        if "." in cell:
            return None
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


def _counts(line: str, separator: str, decimal: str) -> tuple[int, int]:
    """Cells of a line, and how many of them are numbers."""
    found = cells(line, separator)
    known = (number(cell, decimal) is not None and cell.strip().lower() not in MISSING for cell in found)
    return len(found), sum(known)


def _score(lines: list[str], separator: str, decimal: str) -> tuple[float, int]:
    """Part of the cells that are numbers, and how many a line; (0, 0) where lines differ in length."""
    counts = [_counts(line, separator, decimal) for line in lines]
    widths = {width for width, _ in counts}
    width = max(widths)
    numbers = sum(found for _, found in counts)
    if len(widths) > 1 or width < 2 or not numbers:
        return 0.0, 0
    return numbers / (width * len(counts)), width


def _best(lines: list[str]) -> tuple[str, str]:
    """Separator and decimal mark that make the most of these lines."""
    scores = {tried: _score(lines, *tried) for tried in _TRIED}
    best = max(_TRIED, key=lambda tried: scores[tried])
    return best if scores[best][1] else ("", "")


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
    text = codecs.getincrementaldecoder(encoding)().decode(data, final=complete)
    lines = text.splitlines()
    if not complete and len(lines) > 1:
        lines.pop()
    numbered = [(at, line) for at, line in enumerate(lines, 1) if not is_comment(line)]
    if not numbered:
        raise ReadError(f"{path}: is empty; expected a header line and rows of numbers")
    separator, decimal = _settle(numbered)
    if not separator:
        raise ReadError(
            f"{path}: no table of numbers in it: expected a header line and rows of at least two cells, "
            "separated by commas, semicolons, tabs or spaces"
        )
    return _with_header(numbered, encoding, separator, decimal)


def _settle(numbered: list[tuple[int, str]]) -> tuple[str, str]:
    """By the last lines; of a short file by fewer and fewer, for the first of them may be header."""
    count = min(_LOOKED_AT, len(numbered))
    while count:
        separator, decimal = _best([line for _, line in numbered[-count:]])
        if separator:
            return separator, decimal
        count //= 2
    return "", ""


def _with_header(numbered: list[tuple[int, str]], encoding: str, separator: str, decimal: str) -> Dialect:
    rows = [(at, cells(line, separator)) for at, line in numbered]
    last = rows[-1][1]
    numeric = [
        index
        for index in range(len(last))
        if any(
            number(row[index], decimal) == number(row[index], decimal) is not None
            for _, row in rows[-_LOOKED_AT:]
            if len(row) == len(last)
        )
    ]
    dates = frozenset(
        index for index, cell in enumerate(last) if index not in numeric and date(cell) is not None
    )
    begin = len(rows)
    while begin and _is_values(rows[begin - 1][1], len(last), numeric, decimal):
        begin -= 1
    above = [row for _, row in rows[:begin] if len(row) == len(last)]
    columns = _columns(above, len(last), numeric, dates)
    return Dialect(encoding, separator, decimal, columns, rows[begin][0], dates)


def _is_values(row: list[str], width: int, numeric: list[int], decimal: str) -> bool:
    """Whether a row has numbers, or words for none, where numbers belong; and at least one number."""
    if len(row) != width:
        return False
    found = [number(row[index], decimal) for index in numeric]
    return None not in found and not all(value is None or math.isnan(value) for value in found)


def _columns(
    above: list[list[str]], width: int, numeric: list[int], dates: frozenset[int]
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
        Column(name, "s" if index in dates else unit, index not in numeric and index not in dates)
        for index, (name, unit) in enumerate(zip(names, units, strict=True))
    )
