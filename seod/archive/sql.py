"""Questions in SQL: DuckDB sees the views `segments` and `fleet`, and nothing else of this machine."""

from __future__ import annotations

import os
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Final

from seod.archive import live
from seod.archive.catalogue import dataset
from seod.archive.engines import ArchiveError, engine
from seod.archive.layout import schema
from seod.archive.store import Store
from seod.files.damage import said

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_CLOSED: Final = (
    "SET TimeZone='UTC'",
    "SET enable_external_access=false",
    "SET lock_configuration=true",
)
"""After these a statement reads and writes no file, loads nothing, and cannot undo that."""


def ask(where: str | os.PathLike[str], sql: str, parameters: Mapping[str, Any] | None = None) -> Any:
    """The answer to a question, as a `pyarrow.Table`; of several statements that of the last.

    Args:
        where: The archive: a folder or a URL.
        sql: Of DuckDB's dialect; recordings are in `segments` (columns: `seod.archive.layout`), what a fleet
            told is in `fleet` (`seod.archive.live`).
        parameters: Values of `$name` in it.

    Raises:
        ArchiveError: There is no catalogue, or DuckDB refuses the question: its own words, with the place.
    """
    duckdb, pa = engine("duckdb"), engine("pyarrow")
    with _views(Store(where), sql) as views, duckdb.connect(":memory:") as connection:
        for name, rows in views.items():
            connection.register(name, rows)
        for statement in _CLOSED:
            connection.execute(statement)
        try:
            found = connection.sql(sql, params=dict(parameters) if parameters else None)
            return pa.table({}) if found is None else pa.table(found)
        except duckdb.Error as error:
            raise ArchiveError(_with_place(connection, sql, parameters) or str(error)) from error
        except pa.ArrowException as error:  # a day's file that is damaged
            raise ArchiveError(f"{os.fspath(where)}: the catalogue cannot be read: {said(error)}") from error


@contextmanager
def _views(store: Store, sql: str) -> Iterator[dict[str, Any]]:
    """Both views; what a fleet told is fetched only for a question that names it."""
    told = live.files(store)
    messages = live.empty()
    with ExitStack() as open_views:
        try:
            segments = open_views.enter_context(dataset(store))
        except ArchiveError:
            if not told:
                raise
            segments = schema().empty_table()
        if told and "fleet" in sql.casefold():
            folder = open_views.enter_context(store.here(told))
            paths = [f"{folder}/{name}" for name in told]
            messages = engine("pyarrow.dataset").dataset(paths, schema=messages.schema)
        yield {"segments": segments, "fleet": messages}


def _with_place(connection: Any, sql: str, parameters: Mapping[str, Any] | None) -> str:
    """What DuckDB says of a question that it has refused, with the line: a relation's errors are without."""
    try:
        connection.execute(sql, dict(parameters) if parameters else None)
    except engine("duckdb").Error as error:
        return str(error)
    return ""
