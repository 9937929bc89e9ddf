"""Tables as the bytes of a Parquet file: the same table gives the same bytes."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import engine

if TYPE_CHECKING:
    from collections.abc import Sequence

ROW_GROUP: Final = 8192
"""Rows of a group: by a group's least and greatest rig a question passes over the others."""


def to_bytes(table: Any) -> bytes:
    """The file."""
    out = io.BytesIO()
    engine("pyarrow.parquet").write_table(
        table.combine_chunks(), out, row_group_size=ROW_GROUP, compression="zstd"
    )
    return out.getvalue()


def from_bytes(content: bytes, columns: Sequence[str] | None = None) -> Any:
    """The table (`pyarrow.Table`); of all columns, or of some.

    Read by this thread alone: one of Arrow's that still holds a Python object when the interpreter ends
    aborts the process (apache/arrow#34314).
    """
    file = engine("pyarrow.parquet").ParquetFile(engine("pyarrow").BufferReader(content), pre_buffer=False)
    return file.read(columns=None if columns is None else list(columns), use_threads=False)
