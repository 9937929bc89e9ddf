"""Which reader a file needs: by its first bytes, then by its name."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from seod.data.guarded import Guarded
from seod.data.source import ReadError
from seod.files.damage import TIMES_SIZE, DamagedError, bounded, heard, library
from seod.files.user_files import irregular
from seod.machine.limits import RESOURCE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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

_NAMES = {
    "mcap": "whole MCAP file",
    "parquet": "whole Parquet file",
    "mdf": "whole MDF file",
    "can": "CAN log of this kind",
    "mat": "whole MAT file",
    "csv": "table of numbers",
}
TIMES = {"mat": 16}
"""So many times its size a file may take that is in memory as a whole, unpacked."""


def kind_of(path: Path, dbc: Path | None = None) -> str:
    """`mcap`, `parquet`, `mdf`, `can`, `mat`, or `csv` for any other file.

    Raises:
        ReadError: There is no such file, or it is a pipe, a folder or a device.
    """
    for each in (path, dbc):
        if each is not None and (why := irregular(each)):
            raise ReadError(f"{each}: {why}")
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
    path = Path(path)
    kind = kind_of(path, dbc)
    with heard() as complaints:
        try:
            with bounded(path.stat().st_size, TIMES.get(kind, TIMES_SIZE)), library(ReadError):
                source = _make(path, kind, dbc, complaints)
        except DamagedError as error:
            raise ReadError(f"{path}: is no {_NAMES[kind]}: {error}") from error
        guarded = Guarded(source, complaints)
        try:
            yield guarded
        finally:
            guarded.close()


def _apart(path: Path, opened: Callable[[], Source], complaints: list[str]) -> Source:
    """Read by a process of its own where this system can bound one; else here."""
    if RESOURCE is None:
        return opened()
    from seod.data.apart import Apart  # noqa: PLC0415 - Linux only

    return Apart(path, opened, complaints)


def _make(path: Path, kind: str, dbc: Path | None, complaints: list[str]) -> Source:
    # Each format's library is imported only when such a file is read; what C code reads, apart.
    match kind:
        case "mcap":
            from seod.data.mcap_file import McapSource  # noqa: PLC0415

            return McapSource(path)
        case "parquet":
            from seod.data.parquet_file import ParquetSource  # noqa: PLC0415

            return ParquetSource(path)
        case "mat":
            from seod.data.mat_file import open_mat  # noqa: PLC0415

            return _apart(path, partial(open_mat, path), complaints)
        case "mdf":
            from seod.data.mdf_file import MdfSource  # noqa: PLC0415

            return _apart(path, partial(MdfSource, path), complaints)
        case "can":
            from seod.data.can_log import CanSource  # noqa: PLC0415

            if dbc is None:
                raise ReadError(f"{path}: is a log of CAN frames: `--dbc FILE` says what they mean")
            return _apart(path, partial(CanSource, path, dbc), complaints)
        case _:
            from seod.data.csv_file import CsvSource  # noqa: PLC0415

            return CsvSource(path)
