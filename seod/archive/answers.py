"""Answers to questions for people and for other tools: a table on the terminal, CSV, JSON, HTML, Parquet."""

from __future__ import annotations

import csv
import io
import json
import os
from datetime import date, datetime
from html import escape
from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import ArchiveError
from seod.archive.parquet import to_bytes
from seod.files.user_files import named
from seod.terminal.text import number

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FORMATS: Final = ("csv", "parquet", "html", "json")
DIGITS: Final = 5
"""Of a number on the terminal and on a page; the other forms keep all."""
WIDTH: Final = 200
"""Characters of a line where no terminal says how wide it is."""


def as_text(table: Any, width: int) -> str:
    """A table for the terminal, and the number of its rows."""
    from rich.table import Table  # noqa: PLC0415 - only where it is shown

    from seod.terminal.console import as_text as lines  # noqa: PLC0415

    shown = Table(box=None, pad_edge=False, header_style="bold")
    for name in table.column_names:
        shown.add_column(name, justify="right" if _is_number(table[name].type) else "left", overflow="fold")
    for row in _cells(table):
        shown.add_row(*row)
    count = "1 row" if len(table) == 1 else f"{len(table)} rows"
    return "\n".join([*([lines(shown, width=width)] if table.column_names else []), count])


def _is_number(kind: Any) -> bool:
    return str(kind).startswith(("int", "uint", "float", "double", "decimal"))


def _cells(table: Any) -> list[list[str]]:
    columns = [[_cell(value) for value in table[name].to_pylist()] for name in table.column_names]
    return [list(row) for row in zip(*columns, strict=True)]


def _cell(value: object) -> str:
    """A value as people read it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value, DIGITS)
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%M:%S")
    return "-" if value is None else str(value)


def packed(table: Any, form: str, title: str = "") -> bytes:
    """A table as the bytes of a file.

    Args:
        table: A `pyarrow.Table`.
        form: One of `FORMATS`.
        title: Of the page.
    """
    if form == "parquet":
        return to_bytes(table)
    if form == "html":
        return _page(table, title).encode()
    rows = [{name: _plain(value) for name, value in row.items()} for row in table.to_pylist()]
    if form == "json":
        return (json.dumps(rows, indent=1, allow_nan=False) + "\n").encode()
    return _csv(table.column_names, rows).encode()


def _csv(names: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    page = io.StringIO()
    writer = csv.DictWriter(page, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return page.getvalue()


def _plain(value: object) -> object:
    """A value as JSON has it: times in ISO 8601, what is no number as null."""
    if isinstance(value, datetime | date):
        return value.isoformat()
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    return value if value is None or isinstance(value, bool | int | str | list | dict) else str(value)


def _page(table: Any, title: str) -> str:
    """One file, no scripts, nothing from outside."""
    from importlib.resources import files  # noqa: PLC0415

    style = (files("seod.answers") / "page.css").read_text("utf-8")
    head = "".join(f"<th>{escape(name)}</th>" for name in table.column_names)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n" for row in _cells(table)
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{style}</style></head><body><h1>{escape(title)}</h1>"
        f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></body></html>\n"
    )


def form_of(to: str | None, out: Path | None) -> str | None:
    """The form that was asked for, by name or by the ending of the file; None: the terminal's.

    Raises:
        ArchiveError: Neither tells it, or Parquet has nowhere to go.
    """
    form = to or (out.suffix.lower().lstrip(".") if out is not None else None)
    if form is not None and form not in FORMATS:
        raise ArchiveError(f"{out}: say by --to in which form: {', '.join(FORMATS)}")
    if form == "parquet" and out is None:
        raise ArchiveError("--to parquet needs --out FILE: it is no text")
    return form


def write(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all.

    Raises:
        OSError: It cannot be written; names it.
    """
    part = path.with_name(f"{path.name}.unfinished")
    with named(path, part):
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
