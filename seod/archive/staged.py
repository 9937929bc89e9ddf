"""Batches of rows on their way to the files of their days: what a killed builder has read is not lost."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import engine
from seod.archive.layout import FOLDER, schema, table_of
from seod.archive.parquet import from_bytes, to_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.archive.store import Store

STAGED: Final = f"{FOLDER}/staged"
_ENDING: Final = ".batch"
"""Not `.parquet`: nobody who asks the catalogue takes a batch for a day."""


class Staged:
    """The batches in a store, by number; of a file that is in several the last one counts."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._names = [each.name for each in store.files(_ENDING, STAGED)]
        self._next = 1 + max((_number(name) for name in self._names), default=0)

    def put(self, rows: Sequence[dict[str, Any]]) -> None:
        """Bring rows to the disk, whole files."""
        name = f"{STAGED}/{self._next:08}{_ENDING}"
        self._store.write(name, to_bytes(table_of(rows)))
        self._names.append(name)
        self._next += 1

    def table(self) -> Any:
        """All rows that count, as a `pyarrow.Table`."""
        pa, pc = engine("pyarrow"), engine("pyarrow.compute")
        kept: list[Any] = []
        later: set[str] = set()
        for name in reversed(self._names):
            table = from_bytes(self._store.read(name))
            fresh = pc.invert(pc.is_in(table["file"], pa.array(sorted(later), pa.string())))
            kept.append(table.filter(fresh))
            later.update(table["file"].unique().to_pylist())
        return pa.concat_tables(kept) if kept else schema().empty_table()

    def clear(self) -> None:
        """Take the batches away, the oldest first: what remains of a killed builder is what counts."""
        for name in self._names:
            self._store.remove([name])
        self._names = []


def _number(name: str) -> int:
    text = name.rpartition("/")[2].removesuffix(_ENDING)
    return int(text) if text.isdigit() else 0
