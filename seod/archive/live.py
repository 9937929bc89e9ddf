"""What a fleet's listener keeps, a file of JSON lines for each day, as Parquet in the catalogue.

A day's file is read again when it has grown. Each Parquet file comes whole or not at all, and is noted after
it is there: a builder that is killed in between makes the same bytes again.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import engine
from seod.archive.layout import FOLDER, schema

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.archive.store import Known, Store

LINES: Final = "fleet"
"""Folder of the listener's files, in the archive's."""
ENDING: Final = ".jsonl"
PARQUET: Final = f"{FOLDER}/live"
"""Folder of the same days as Parquet."""
NOTE: Final = f"{PARQUET}/known.json"
"""By day the stamp of the file that was read."""
ROWS: Final = 65_536
"""Rows that are in memory at a time; a group of the Parquet file."""
SHARED: Final = (
    *("rig", "axis", "day", "end", "reference", "supply_pressure", "temperature", "e_a", "unit"),
    *("zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd", "quality"),
    *("model_error", "left_model", "left_since", "version", "simulated"),
)
"""Columns that mean the same as in the catalogue's segments; `end` is when the message was sent."""
_DUCK: Final = {"string": "VARCHAR", "double": "DOUBLE", "bool": "BOOLEAN", "date32[day]": "DATE"}
_OWN: Final = {"kind": "VARCHAR", "session": "BIGINT", "seq": "BIGINT", "message": "JSON"}


def catch_up(store: Store, step: Callable[[float], None] = lambda _part: None) -> int:
    """Bring the Parquet files of the days up to date; gives how many were written.

    Args:
        store: The archive; its builder's lock is held.
        step: Takes how far it is.

    Raises:
        OSError: A file cannot be read or written.
        ArchiveError: The store does not answer.
    """
    days = store.files(ENDING, LINES)
    if not days:
        return 0
    known = _known(store)
    changed = [each for each in days if known.get(each.name) != each.stamp]
    for k, each in enumerate(changed):
        step(k / len(changed))
        store.write(f"{PARQUET}/{Path(each.name).stem}.parquet", _parquet(store, each))
        known[each.name] = each.stamp
        store.write(NOTE, json.dumps(known, indent=1, sort_keys=True).encode())
    return len(changed)


def files(store: Store) -> list[str]:
    """Names of the days' Parquet files."""
    return [each.name for each in store.files(".parquet", PARQUET)]


def columns() -> dict[str, str]:
    """Columns of a message, with DuckDB's types."""
    kinds = {field.name: _DUCK.get(str(field.type), "TIMESTAMPTZ") for field in schema()}
    return {name: kinds[name] for name in SHARED} | _OWN


def _known(store: Store) -> dict[str, str]:
    try:
        return dict(json.loads(store.read(NOTE)))
    except (FileNotFoundError, ValueError, TypeError):
        return {}  # none yet, or damaged: all days are read


def _parquet(store: Store, day: Known) -> bytes:
    """A day's lines as the bytes of a Parquet file, in their order; half a line at the end is left out."""
    duckdb, parquet = engine("duckdb"), engine("pyarrow.parquet")
    with store.here([day.name]) as folder, duckdb.connect(":memory:") as connection:
        connection.execute("SET TimeZone='UTC'")
        lines = connection.read_json(
            f"{folder}/{day.name}", columns=columns(), format="newline_delimited", ignore_errors=True
        )
        batches = lines.filter("rig IS NOT NULL").to_arrow_reader(ROWS)
        with tempfile.TemporaryFile() as out:
            with parquet.ParquetWriter(out, batches.schema, compression="zstd") as writer:
                for batch in batches:
                    writer.write_batch(batch)
            out.seek(0)
            return out.read()


def empty() -> Any:
    """No rows, with the columns (`pyarrow.Table`): for archives that no fleet tells."""
    duckdb = engine("duckdb")
    named = ", ".join(f'CAST(NULL AS {kind}) AS "{name}"' for name, kind in columns().items())
    with duckdb.connect(":memory:") as connection:
        return connection.sql(f"SELECT {named} LIMIT 0").to_arrow_table()
