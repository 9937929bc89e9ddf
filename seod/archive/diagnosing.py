"""Diagnoses of the recordings in which a rig has left its model, as reports beside them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from seod.archive import reports
from seod.archive.fits import on_disk
from seod.archive.sql import ask
from seod.archive.store import Store

if TYPE_CHECKING:
    import os

    from seod.archive.build import Told

OPEN: Final = """
SELECT file, axis FROM segments
WHERE left_model AND verdict IS NULL AND NOT gone AND file IS NOT NULL
GROUP BY file, axis ORDER BY file, axis
"""


def diagnose_left(where: str | os.PathLike[str], told: Told) -> dict[str, str]:
    """Diagnose what has left its model and has no report yet; the next build takes the reports.

    A report is `RECORDING.AXIS.diagnosis.json`, by the quick search.

    Args:
        where: The archive, whose catalogue is there.
        told: Called with the recording and the part of all that is done.

    Returns:
        Of the recordings that tell nothing, why.

    Raises:
        ArchiveError: As of `ask`.
        OSError: A report cannot be written.
    """
    from seod.api.diagnoses import diagnose  # noqa: PLC0415 - numerics, and a compiler
    from seod.data.source import ReadError  # noqa: PLC0415
    from seod.diagnose.result import DiagnoseError  # noqa: PLC0415

    store, silent = Store(where), {}
    table = ask(where, OPEN)
    for k, row in enumerate(table.to_pylist()):
        file, axis = row["file"], row["axis"]
        told(f"diagnosing {file}", k / len(table))
        try:
            with on_disk(store, file) as path:
                found = diagnose(path, axis=axis, effort="quick").to_dict()
        except (ReadError, DiagnoseError, ValueError) as error:
            silent[file] = str(error)
            continue
        store.write(reports.name_of(file, axis), (json.dumps(found, indent=1) + "\n").encode())
    return silent
