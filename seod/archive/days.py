"""The files of the days: new rows into them, one day after the other, each whole or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from seod.archive.catalogue import is_of_a_day
from seod.archive.engines import engine
from seod.archive.layout import FOLDER, schema
from seod.archive.parquet import from_bytes, to_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from seod.archive.store import Store

FILE: Final = "segments.parquet"
NO_DAY: Final = "__HIVE_DEFAULT_PARTITION__"
"""Of files whose beginning cannot be read; engines read it as null."""
_KNOWN: Final = ("file", "stamp", "gone")
_ORDER: Final = [(name, "ascending") for name in ("rig", "axis", "begin", "file", "part")]


class Days:
    """The rows that stand in a store, by day."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._at = {
            each.name.split("/")[-2].removeprefix("day="): each.name
            for each in store.files(f"/{FILE}", FOLDER)
            if is_of_a_day(each.name)
        }
        self.files: dict[str, dict[str, tuple[str, bool]]] = {}
        """Of each day the files in it, with stamp and whether they are gone."""
        for day, name in self._at.items():
            table = from_bytes(store.read(name), _KNOWN)
            columns = (table[column].to_pylist() for column in _KNOWN)
            self.files[day] = {file: (stamp, gone) for file, stamp, gone in zip(*columns, strict=True)}

    def stamps(self) -> dict[str, str]:
        """Of the files that are there; none of one that stands in two days, so that it is read anew."""
        found: dict[str, str] = {}
        for files in self.files.values():
            for file, (stamp, gone) in files.items():
                found[file] = "" if gone or file in found else stamp
        return found

    def merge(self, new: Any, present: Collection[str], told: Callable[[float], None]) -> None:
        """Put rows in the place of older ones of the same files, and mark the files that are gone.

        Args:
            new: Rows, a `pyarrow.Table` of the whole layout.
            present: Recordings that are there now.
            told: Called with the part that is done.
        """
        pc = engine("pyarrow.compute")
        names = set(new["file"].unique().to_pylist())
        day_of = new["day"].cast("string").fill_null(NO_DAY)
        growing = set(day_of.unique().to_pylist())
        waning = {day for day, files in self.files.items() if self._differs(files, names, present)}
        order = [*sorted(growing), *sorted(waning - growing)]  # rows come to their new day before they leave
        for k, day in enumerate(order):
            own = new.filter(pc.equal(day_of, day)).drop_columns(["day"])
            self._write(day, own, names, present)
            told((k + 1) / len(order))

    def _differs(
        self, files: dict[str, tuple[str, bool]], names: Collection[str], present: Collection[str]
    ) -> bool:
        return any(file in names or gone is (file in present) for file, (_, gone) in files.items())

    def _write(self, day: str, own: Any, names: Collection[str], present: Collection[str]) -> None:
        pa = engine("pyarrow")
        at = self._at.get(day, f"{FOLDER}/day={day}/{FILE}")
        table = own
        if day in self._at:
            old = from_bytes(self._store.read(at))
            kept = old.filter(pa.array([file not in names for file in old["file"].to_pylist()], pa.bool_()))
            table = pa.concat_tables([kept.cast(own.schema), own])
        if not len(table):
            self._store.remove([at])
            return
        gone = pa.array([file not in present for file in table["file"].to_pylist()], pa.bool_())
        table = table.set_column(table.schema.get_field_index("gone"), schema().field("gone"), gone)
        self._store.write(at, to_bytes(table.sort_by(_ORDER)))
