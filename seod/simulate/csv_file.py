"""Measured data as a CSV file, plain or gzip: a header line, then a line for each row, SI units.

Numbers have all their digits; what is undefined is empty. The same data make the same bytes.
"""

from __future__ import annotations

import gzip
import math
import os
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, cast

from seod.files.user_files import create_recording, keep_earlier, named

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

ENDINGS = (".csv", ".csv.gz")

BLOCK = 20_000
"""Rows that are written at a time."""


def write_csv(
    path: Path, columns: Mapping[str, NDArray[np.float64]], told: Callable[[float], None] = lambda _: None
) -> None:
    """Write columns of one length; a file that is there already is kept as `NAME~`.

    Args:
        path: Ends in `.csv` or `.csv.gz`. It is there once it is whole.
        columns: By their names.
        told: Is told which part has been written.

    Raises:
        OSError: It cannot be written.
    """
    rows = len(next(iter(columns.values())))
    part = path.with_name(path.name + ".part")
    with named(path, part):
        try:
            with _opened(part, path.name.endswith(".gz")) as file:
                file.write((",".join(columns) + "\n").encode())
                for k in range(0, rows, BLOCK):
                    block = zip(*(column[k : k + BLOCK].tolist() for column in columns.values()), strict=True)
                    file.write("".join([_line(row) for row in block]).encode("ascii"))
                    told(min(1.0, (k + BLOCK) / rows))
            keep_earlier(path)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


def _line(row: tuple[float, ...]) -> str:
    return ",".join([repr(x) if math.isfinite(x) else "" for x in row]) + "\n"


@contextmanager
def _opened(path: Path, packed: bool) -> Iterator[IO[bytes]]:
    with os.fdopen(create_recording(path), "wb") as file:
        if not packed:
            yield file
            return
        with gzip.GzipFile(filename="", mode="wb", fileobj=file, compresslevel=6, mtime=0) as gz:
            yield cast("IO[bytes]", gz)
