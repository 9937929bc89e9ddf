"""Estimates of segments that the daemon has recorded none of, by `seod.identify`."""

from __future__ import annotations

import math
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from seod.archive.store import Known, Store
    from seod.identify.record import Output

LEAST_S: Final = 1.0
"""Excitation of a segment that is identified [s]: less is hardly ten periods of a slow actuator."""


def identify_missing(store: Store, known: Known, rows: Sequence[dict[str, Any]]) -> None:
    """Fill zeta, omega_n, K_L and quality of excited segments where all of them are null."""
    missing = [
        row for row in rows if row.get("quality") is None and (row.get("exciting_s") or 0.0) >= LEAST_S
    ]
    if not missing:
        return
    with on_disk(store, known.name) as path:
        for row in missing:
            row.update(_identified(path, row))


@contextmanager
def on_disk(store: Store, name: str) -> Iterator[Path]:
    """A recording as a file of this machine; that of an object store is fetched, and gone afterwards."""
    if store.is_local:
        yield Path(store.path(name))
        return
    with tempfile.TemporaryDirectory(prefix="seod-archive-") as folder:
        path = Path(folder) / Path(name).name
        path.write_bytes(store.read(name))
        yield path


def _identified(path: Path, row: dict[str, Any]) -> dict[str, Any]:
    """The columns; only `quality` where nothing is found."""
    from seod.api.identification import identify  # noqa: PLC0415 - numerics, and a compiler
    from seod.data.source import ReadError  # noqa: PLC0415
    from seod.identify.record import IdentifyError  # noqa: PLC0415

    output: Output = "velocity" if str(row.get("unit") or "").endswith("/s") else "position"
    try:
        found = identify(path, axis=row["axis"], between=row["span"], output=output)
    except (ReadError, IdentifyError, ValueError, ArithmeticError):
        return {"quality": "no_oscillation"}
    told: dict[str, Any] = {"quality": found.quality}
    for name in ("zeta", "omega_n", "K_L"):
        value = getattr(found, name)
        told |= {name: _finite(value.value), f"{name}_sd": _finite(value.sd)}
    return told


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
