"""Measured data that is in memory already: a table of pandas or polars, or arrays by their names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import Column, Group, ReadError, Table, place
from seod.data.units import split_header

if TYPE_CHECKING:
    from numpy.typing import NDArray

FORMAT = "memory"


def is_table(data: Any) -> bool:
    """Whether it has named columns: a mapping, or a table of pandas, polars and others alike."""
    return isinstance(data, Mapping) or (hasattr(data, "columns") and hasattr(data, "__getitem__"))


def table_of(data: Any, name: str = "data") -> Table:
    """A table of named columns as a source of rows.

    Args:
        data: A mapping of arrays, or a table of pandas or polars. A named index of pandas is a column. A
            column may carry its unit in its name, as in a file: `y [deg]`.
        name: Stands for the file's in messages.

    Raises:
        ReadError: Columns differ in length, or one has not one dimension.
    """
    columns: list[Column] = []
    arrays: dict[str, NDArray[Any]] = {}
    for key, values in _named(data):
        column, unit = split_header(str(key))
        if column in arrays:
            raise ReadError(f"{name}: two columns are called {column!r}")
        arrays[column], unit = _plain(values, unit, place(name, column=column))
        columns.append(Column(column, unit, arrays[column].dtype == object))
    if not columns:
        raise ReadError(f"{name}: has no columns")
    lengths = {column: len(array) for column, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{column} {length}" for column, length in lengths.items())
        raise ReadError(f"{name}: columns have different lengths: {told}")
    if not next(iter(lengths.values())):
        raise ReadError(f"{name}: has no rows")
    return Table(Path(name), FORMAT, (Group("", tuple(columns)),), {"": arrays})


def _named(data: Any) -> Iterable[tuple[Any, Any]]:
    if isinstance(data, Mapping):
        yield from data.items()
        return
    index = getattr(data, "index", None)
    name = getattr(index, "name", None)
    if name is not None and name not in list(data.columns):
        yield name, index
    for key in data.columns:
        yield key, data[key]


def _plain(values: Any, unit: str, where: str) -> tuple[NDArray[Any], str]:
    """One column as numbers, or objects where it holds text; times of day become seconds from the first."""
    array = np.asarray(values)
    if array.ndim != 1:
        raise ReadError(f"{where}: has {array.ndim} dimensions; a column has one")
    if array.dtype.kind in "mM":
        since = array - array[0] if array.dtype.kind == "M" else array
        seconds = since.astype("timedelta64[ns]").astype(np.int64) * 1e-9
        return np.where(np.isnat(array), np.nan, seconds), "s"
    if array.dtype.kind in "fiub":
        return np.asarray(array, np.float64), unit
    try:
        return np.array([np.nan if each is None else each for each in array.tolist()], np.float64), unit
    except (TypeError, ValueError):
        return array.astype(object), unit
