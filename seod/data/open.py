"""Which reader a file needs: by its first bytes, then by its name."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from seod.data.source import ReadError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.data.source import Source

_MAGIC = (
    (b"\x89MCAP0\r\n", "mcap"),
    (b"PAR1", "parquet"),
    (b"MDF ", "mdf"),
    (b"LOGG", "can"),
    (b"MATLAB ", "mat"),
    (b"\x89HDF", "mat"),
)
_SUFFIXES = {
    ".mcap": "mcap",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".mat": "mat",
    ".mf4": "mdf",
    ".mdf": "mdf",
    ".blf": "can",
    ".asc": "can",
    ".trc": "can",
}


def kind_of(path: Path, dbc: Path | None = None) -> str:
    """`mcap`, `parquet`, `mdf`, `can`, `mat`, or `csv` for any other file.

    Raises:
        ReadError: There is no such file.
    """
    try:
        with path.open("rb") as file:
            head = file.read(512)
    except OSError as error:
        raise ReadError(f"{path}: {error.strerror or error}") from error
    if not head:
        raise ReadError(f"{path}: is empty")
    magic = next((kind for start, kind in _MAGIC if head.startswith(start)), None)
    name = path.name.lower().removesuffix(".gz")
    kind = magic or _SUFFIXES.get(Path(name).suffix, "csv")
    if dbc is not None and kind in ("mdf", "csv"):
        return "can"
    return kind


@contextmanager
def open_source(path: Path | str, dbc: Path | None = None) -> Iterator[Source]:
    """Open a recording of any format.

    Args:
        path: Its file.
        dbc: For a log of CAN frames: the DBC that says what they mean.

    Raises:
        ReadError: It cannot be read; says why, and which package is missing if that is it.
    """
    source = _make(Path(path), dbc)
    try:
        yield source
    finally:
        source.close()


def _make(path: Path, dbc: Path | None) -> Source:
    # Each format's library is imported only when such a file is read.
    match kind_of(path, dbc):
        case "mcap":
            from seod.data.mcap_file import McapSource  # noqa: PLC0415

            return McapSource(path)
        case "parquet":
            from seod.data.parquet_file import ParquetSource  # noqa: PLC0415

            return ParquetSource(path)
        case "mat":
            from seod.data.mat_file import open_mat  # noqa: PLC0415

            return open_mat(path)
        case "mdf":
            from seod.data.mdf_file import MdfSource  # noqa: PLC0415

            return MdfSource(path)
        case "can":
            from seod.data.can_log import CanSource  # noqa: PLC0415

            if dbc is None:
                raise ReadError(f"{path}: is a log of CAN frames: `--dbc FILE` says what they mean")
            return CanSource(path, dbc)
        case _:
            from seod.data.csv_file import CsvSource  # noqa: PLC0415

            return CsvSource(path)
