"""The catalogue as it stands: its files, and its rows for who asks."""

from __future__ import annotations

from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from seod.archive.engines import ArchiveError, engine
from seod.archive.layout import FOLDER, schema
from seod.archive.store import Store

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator


@contextmanager
def dataset(store: Store) -> Iterator[Any]:
    """All rows as a `pyarrow.dataset.Dataset`, partitioned by day.

    Raises:
        ArchiveError: There is no catalogue yet, or the store does not answer.
    """
    files = [each.name for each in store.files(".parquet", FOLDER) if is_of_a_day(each.name)]
    if not files:
        raise ArchiveError(f"{store.where}: has no catalogue yet: `seod archive {store.where}` builds it")
    ds = engine("pyarrow.dataset")
    pa = engine("pyarrow")
    days = ds.partitioning(pa.schema([("day", pa.date32())]), flavor="hive")
    with store.here(files) as folder:
        yield ds.dataset(
            [f"{folder}/{name}" for name in files],
            schema=schema(),
            format="parquet",
            partitioning=days,
            partition_base_dir=f"{folder}/{FOLDER}",
        )


def is_of_a_day(name: str) -> bool:
    """Whether a file of the catalogue's folder holds rows for who asks: `catalogue/day=.../NAME.parquet`."""
    return name.rpartition("/")[0].rpartition("/")[2].startswith("day=")


def rows(folder: str | os.PathLike[str], rig: str | None = None, since: datetime | None = None) -> Any:
    """Rows of the catalogue as a `pyarrow.Table` (columns: `seod.archive.layout`), by rig, axis and time.

    Args:
        folder: The archive: a folder, or a URL such as `s3://bucket/prefix`.
        rig: Only of this one.
        since: Only segments that end later; without a time zone it is UTC.

    Raises:
        ArchiveError: There is no such folder or no catalogue, or a library is missing.
    """
    ds = engine("pyarrow.dataset")
    wanted = ds.scalar(True) if rig is None else ds.field("rig") == rig
    if since is not None:
        wanted &= ds.field("end") >= (since if since.tzinfo else since.replace(tzinfo=UTC))
    with dataset(Store(folder)) as segments:
        table = segments.to_table(filter=wanted)
    return table.sort_by([(name, "ascending") for name in ("rig", "axis", "begin", "file", "part")])
