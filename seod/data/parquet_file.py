"""Parquet, by pyarrow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import BLOCK_ROWS, Block, Column, Group, Remark, needs_extra
from seod.data.units import split_header
from seod.files.damage import DamagedError, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from seod.data.source import Values

UNIT = b"unit"
"""Key of a field's metadata that holds its unit."""


class ParquetSource:
    """A Parquet file as one group.

    Raises:
        ReadError: pyarrow is missing.
        DamagedError: It is no such file.
    """

    format = "parquet"

    def __init__(self, path: Path) -> None:
        try:
            from pyarrow import parquet  # noqa: PLC0415 - optional
        except ImportError as error:
            raise needs_extra(path, "pyarrow", "parquet") from error
        self.path = path
        self.remarks: list[Remark] = []
        self._file: Any = parquet.ParquetFile(path)
        self._fields = {field.name: field for field in self._file.schema_arrow if _kind(field)}
        self._names = {name: split_header(name)[0] for name in self._fields}
        others = [field.name for field in self._file.schema_arrow if not _kind(field)]
        if others:
            self.remarks.append(
                Remark("unread", f"neither numbers nor text: {', '.join(others)}", len(others))
            )
        self.groups: tuple[Group, ...] = (Group("", tuple(map(self._column, self._fields))),)
        self.notes: Mapping[str, str] = {}

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; what is damaged of a row group is left out and said."""
        asked = [field for field, name in self._names.items() if name in wanted.get("", ())]
        total, first = max(1, self._file.metadata.num_rows), 0
        for number in range(self._file.num_row_groups):
            at = first
            try:
                for batch in self._batches(number, asked):
                    values = {self._names[field]: _values(batch.column(field)) for field in asked}
                    rows = np.arange(at + 1, at + 1 + batch.num_rows)
                    at += batch.num_rows
                    yield Block(self.groups[0], values, rows, min(1.0, at / total))
            except DamagedError as error:
                message = f"row group {number + 1} cannot be read after its row {at - first}: {error}"
                self.remarks.append(Remark("damaged", message))
            first += self._file.metadata.row_group(number).num_rows

    def _batches(self, number: int, fields: Sequence[str]) -> Iterator[Any]:
        with library():
            yield from self._file.iter_batches(BLOCK_ROWS, [number], list(fields), use_threads=False)

    def _column(self, name: str) -> Column:
        field = self._fields[name]
        unit = (field.metadata or {}).get(UNIT, b"").decode() or split_header(name)[1]
        kind = _kind(field)
        return Column(self._names[name], "s" if kind == "time" else unit, kind == "text")


def _kind(field: Any) -> str:
    """What a field holds: `number`, `time`, `text`, or "" for what cannot be read."""
    from pyarrow import types  # noqa: PLC0415 - there by now

    if types.is_timestamp(field.type) or types.is_duration(field.type):
        return "time"
    if types.is_floating(field.type) or types.is_integer(field.type) or types.is_boolean(field.type):
        return "number"
    is_text = (
        types.is_string(field.type) or types.is_large_string(field.type) or types.is_dictionary(field.type)
    )
    return "text" if is_text else ""


def _values(array: Any) -> Values:
    from pyarrow import float64, int64, types  # noqa: PLC0415 - there by now

    if types.is_timestamp(array.type) or types.is_duration(array.type):
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[array.type.unit]
        return (
            np.asarray(array.cast(int64()).cast(float64(), safe=False).to_numpy(zero_copy_only=False)) * scale
        )
    if types.is_boolean(array.type):
        array = array.cast(int64())
    if types.is_floating(array.type) or types.is_integer(array.type):
        return np.asarray(array.cast(float64(), safe=False).to_numpy(zero_copy_only=False), np.float64)
    return np.array(["" if value is None else str(value) for value in array.to_pylist()], object)
