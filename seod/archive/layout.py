"""What a row of the catalogue holds: one segment of one axis of one recording.

A segment is a run of rows in which the axis is excited, or is not; it is no longer than `LONGEST_S`. Files
are `catalogue/day=YYYY-MM-DD/*.parquet`, sorted by rig, axis and time. Undefined is null, never nan.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final, NamedTuple

from seod.archive.engines import engine

FOLDER: Final = "catalogue"
"""Of the catalogue, in the folder of the recordings."""
LONGEST_S: Final = 600.0
"""A segment ends after this long [s]: a day of excitation gives 144 points of a trend."""


class Column(NamedTuple):
    """A column: its Arrow type, its unit ("" for none), what it holds."""

    kind: str
    unit: str
    means: str


COLUMNS: Final[dict[str, Column]] = {
    "file": Column("string", "", "path of the recording, relative to the archive's folder"),
    "part": Column("int32", "", "number of the segment among those of its axis in this file, from 1"),
    "rig": Column("string", "", "name of the rig"),
    "axis": Column("string", "", "name of the axis"),
    "day": Column("date32", "", "UTC date of the file's first row"),
    "begin": Column("time", "", "UTC, first row of the segment"),
    "end": Column("time", "", "UTC, last row of the segment"),
    "seconds": Column("float64", "s", "from the first to the last row"),
    "rows": Column("int64", "", "rows of the segment"),
    "lost": Column("int64", "", "rows that are missing between its first and its last"),
    "reference": Column("float64", "unit", "mean set point"),
    "supply_pressure": Column("float64", "Pa", "mean"),
    "temperature": Column("float64", "K", "mean, of the oil"),
    "e_a": Column("float64", "V", "mean amplitude of the relay while it was on"),
    "unit": Column("string", "", "SI unit of what the axis measures: rad, m, or per second"),
    "zeta": Column("float64", "", "damping ratio"),
    "zeta_sd": Column("float64", "", "its standard deviation"),
    "omega_n": Column("float64", "rad/s", "natural frequency"),
    "omega_n_sd": Column("float64", "rad/s", "its standard deviation"),
    "K_L": Column("float64", "unit/s/V", "gain"),
    "K_L_sd": Column("float64", "unit/s/V", "its standard deviation"),
    "quality": Column("string", "", "of the estimate; null where none was made"),
    "model_error": Column(
        "float64", "", "median error of the model that ran beside, over the movement; null if none ran"
    ),
    "left_model": Column("bool", "", "the rig had left that model, for a time at least; null likewise"),
    "left_since": Column("time", "", "UTC, when that was first told in this segment"),
    "verdict": Column("string", "", "of the diagnosis beside the recording; null where there is none"),
    "causes": Column("string", "", 'JSON, of the same: [{"name": ..., "parameters": {...}}]'),
    "faults": Column("string", "", 'JSON: [{"t": UTC, "code": ..., "why": ...}]'),
    "exciting_s": Column("float64", "s", "of excitation in this segment"),
    "version": Column("string", "", "of the seod that recorded"),
    "simulated": Column("bool", "", "by the rig file: the rig is a simulated one"),
    "problem": Column("string", "", "why the file could not be read whole; null if it could"),
    "gone": Column("bool", "", "the recording was there once and is not any more"),
    "stamp": Column("string", "", "by which a changed recording is known"),
}


@cache
def schema() -> Any:
    """The columns as a `pyarrow.Schema`.

    Raises:
        ArchiveError: pyarrow is not installed.
    """
    pa = engine("pyarrow")
    kinds = {"time": pa.timestamp("us", "UTC"), "bool": pa.bool_(), "date32": pa.date32()}
    return pa.schema(
        [(name, kinds.get(column.kind) or getattr(pa, column.kind)()) for name, column in COLUMNS.items()]
    )


def table_of(rows: Any) -> Any:
    """Rows (dicts by column; what is missing is null) as a `pyarrow.Table` of this layout."""
    return engine("pyarrow").Table.from_pylist(list(rows), schema=schema())
