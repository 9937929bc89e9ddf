"""Blocks of one group into a file for other tools."""

from __future__ import annotations

import csv
import math
import re
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np

from seod.data.columns import ROLES
from seod.data.mat_file import UNITS
from seod.data.mdf_writer import MdfWriter
from seod.data.parquet_file import UNIT
from seod.data.source import ReadError, needs_extra
from seod.data.units import BASE, KNOWN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seod.data.source import Block, Column, Group, Values

_MAT_NAME = 63
"""Longest name of a MATLAB variable."""
_MAT_BYTES = 1 << 31
"""Largest variable of a MAT file of version 5."""


class Writer(Protocol):
    """Takes the blocks of its groups in order.

    Attributes:
        left_out: Rows that the format cannot hold.

    Raises:
        OSError, ReadError: They cannot be written.
    """

    left_out: int

    def write(self, block: Block) -> None:
        """Append."""
        ...

    def close(self) -> None:
        """Complete the file."""
        ...


def header(column: Column) -> str:
    """Name and unit; a standard column in its standard unit is called by its name alone."""
    base = KNOWN.get(column.unit) and BASE[KNOWN[column.unit][0]] == column.unit
    plain = column.name.rpartition(".")[2] in ROLES and base
    return column.name if plain or not column.unit else f"{column.name} [{column.unit}]"


class CsvWriter:
    """CSV; numbers have all their digits, what is undefined is empty."""

    left_out = 0

    def __init__(self, path: Path, groups: Sequence[Group], _notes: dict[str, str]) -> None:
        self._file: IO[str] = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._columns = groups[0].columns
        self._writer.writerow(map(header, self._columns))

    def write(self, block: Block) -> None:
        """Append."""
        columns = [_cells(block.values[column.name], column.text) for column in self._columns]
        self._writer.writerows(zip(*columns, strict=True))

    def close(self) -> None:
        """Complete the file."""
        self._file.close()


def _cells(values: Values, text: bool) -> list[Any]:
    if text:
        return [str(value) for value in values]
    if np.isnan(values).any():
        return ["" if math.isnan(value) else repr(value) for value in values.tolist()]
    return list(map(repr, values.tolist()))


class ParquetWriter:
    """Parquet; units are in the fields' metadata, what is undefined is null."""

    left_out = 0

    def __init__(self, path: Path, groups: Sequence[Group], notes: dict[str, str]) -> None:
        try:
            import pyarrow  # noqa: PLC0415, ICN001 - optional
            from pyarrow import parquet  # noqa: PLC0415
        except ImportError as error:
            raise needs_extra(path, "pyarrow", "parquet") from error
        fields = [
            pyarrow.field(
                column.name,
                pyarrow.string() if column.text else pyarrow.float64(),
                metadata={UNIT: column.unit.encode()},
            )
            for column in groups[0].columns
        ]
        self._pyarrow: Any = pyarrow
        self._schema = pyarrow.schema(fields, metadata={key: value for key, value in notes.items() if value})
        self._writer = parquet.ParquetWriter(path, self._schema)

    def write(self, block: Block) -> None:
        """Append."""
        arrays = [
            self._pyarrow.array(block.values[field.name].tolist(), field.type)
            if field.type == self._pyarrow.string()
            else self._pyarrow.array(block.values[field.name], field.type, from_pandas=True)
            for field in self._schema
        ]
        self._writer.write_table(self._pyarrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Complete the file."""
        self._writer.close()


class MatWriter:
    """MAT version 5: a vector for each column, `motor.y` as a field of a struct; in memory until the end."""

    left_out = 0

    def __init__(self, path: Path, groups: Sequence[Group], _notes: dict[str, str]) -> None:
        self._path = path
        self._groups = groups
        self._pieces: dict[tuple[str, str], list[Values]] = {
            (group.name, column.name): [] for group in groups for column in group.columns
        }

    def write(self, block: Block) -> None:
        """Append."""
        for name, values in block.values.items():
            self._pieces[block.group.name, name].append(values)

    def close(self) -> None:
        """Complete the file."""
        from scipy.io import savemat  # noqa: PLC0415 - slow to import

        content: dict[str, Any] = {}
        units: dict[str, Any] = {}
        for group in self._groups:
            for column in group.columns:
                words = [group.name] * (len(self._groups) > 1) + column.name.split(".")
                path = [_identifier(word) for word in words]
                whole = np.concatenate(self._pieces[group.name, column.name] or [np.array([])])
                self._put(content, path, whole)
                if column.unit:
                    self._put(units, path, column.unit)
        savemat(self._path, {**content, UNITS: units}, False, oned_as="column", long_field_names=True)

    def _put(self, content: dict[str, Any], path: list[str], value: Values | str) -> None:
        where = ".".join(path)
        for word in path[:-1]:
            content = content.setdefault(word, {})
        if path[-1] in content or not isinstance(content, dict):
            raise ReadError(f"{self._path}: two columns would be called {where!r} in MATLAB")
        if isinstance(value, np.ndarray) and value.nbytes >= _MAT_BYTES:
            raise ReadError(
                f"{self._path}: {where} has {len(value)} rows: too many for MAT; export to parquet"
            )
        content[path[-1]] = value


def _identifier(name: str) -> str:
    """A name that MATLAB takes."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name.strip("/"))
    return (word if word[:1].isalpha() else f"x{word}")[:_MAT_NAME]


WRITERS: dict[str, Callable[[Path, Sequence[Group], dict[str, str]], Writer]] = {
    "csv": CsvWriter,
    "parquet": ParquetWriter,
    "mat": MatWriter,
    "mdf": MdfWriter,
}
SUFFIXES = {"csv": ".csv", "parquet": ".parquet", "mat": ".mat", "mdf": ".mf4"}
ONE_GROUP = ("csv", "parquet")
"""Formats whose files hold one table."""
