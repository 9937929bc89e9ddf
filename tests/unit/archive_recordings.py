"""Small recordings for the tests of the archive, by the recorder's own file layout."""

from __future__ import annotations

import io
import json
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.archive.layout import FOLDER
from seod.processes.ring import FLAG_EXCITING, FLAG_FRESH
from seod.record.layout import ESTIMATES, EVENTS, MODEL_ERRORS, row_dtype
from seod.record.mcap_file import About, McapFile

if TYPE_CHECKING:
    from pathlib import Path

BEGAN = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
CLOCK = 500.0
"""The loop's clock at the first row [s]."""


def ticks(excited: str, rate_hz: float = 10.0, axes: int = 1) -> np.ndarray:
    """Rows by a word such as `--XX X-`: a row a letter, excited at an X, missing at a blank."""
    table = np.zeros(len(excited), row_dtype(axes))
    table["tick"] = np.arange(len(excited))
    table["tick_t"] = CLOCK + table["tick"] / rate_hz
    own = table["axes"]
    is_on = np.array([letter == "X" for letter in excited])
    own["t"] = own["t_u"] = table["tick_t"][:, None]
    own["reference"], own["ps"], own["temperature"] = 0.25, 7e6, np.nan
    own["e_a"] = np.where(is_on, 0.4, 9.0)[:, None]
    own["flags"] = FLAG_FRESH | np.where(is_on, FLAG_EXCITING, 0)[:, None]
    return table[[letter != " " for letter in excited]]


def estimate(after: float, quality: str = "ok", **values: float | None) -> tuple[str, dict[str, Any]]:
    """A message of so many seconds after the beginning."""
    told = {"zeta": 0.2, "zeta_sd": 0.01, "omega_n": 100.0, "omega_n_sd": 0.5, "K_L": 20.0, "K_L_sd": 0.1}
    return ESTIMATES, {"t": CLOCK + after, "quality": quality, **told, **values}


def model_error(after: float, left: bool, nrmse: float = 0.1) -> tuple[str, dict[str, Any]]:
    """Likewise."""
    return MODEL_ERRORS, {"t": CLOCK + after, "nrmse": nrmse, "left": left}


def fault(after: float, axis: str | None = "motor", **more: Any) -> tuple[str, dict[str, Any]]:
    """Likewise."""
    return EVENTS, {
        "event": "fault",
        "t": CLOCK + after,
        "axis": axis,
        "code": "limit",
        "why": "too far",
        **more,
    }


def recording(
    rig: str = "bench",
    rows: np.ndarray | None = None,
    notes: Any = (),
    began: datetime = BEGAN,
    axes: tuple[str, ...] = ("motor",),
    finished: bool = True,
) -> bytes:
    """One MCAP file; notes of kinds other than events go to the first axis."""
    out = io.BytesIO()
    offset_ns = round((began.timestamp() - CLOCK) * 1e9)
    told = json.dumps({"rig": rig, "simulation": {"axes": {}}})
    about = About(rig, axes, "", told, began.timestamp(), offset_ns, dict.fromkeys(axes, "rad"))
    file = McapFile(out, about, 1)  # type: ignore[arg-type]
    file.rows(ticks("-XXXXXXXXX-", axes=len(axes)) if rows is None else rows)
    for kind, note in notes:
        file.note(kind if kind == EVENTS else kind + axes[0], note["t"], note)
    file.end_chunk()
    if finished:
        file.finish()
    return out.getvalue()


def fill(folder: Path, rigs: int = 4, weeks: int = 3) -> None:
    """A folder of recordings: `rig0` ... of so many weeks; `rig1` has left its model from the second on."""
    for rig in range(rigs):
        for week in range(weeks):
            left = rig == 1 and week > 0
            notes = [
                estimate(0.5, omega_n=100.0 - week),
                model_error(0.5, False),
                model_error(0.7, left, 0.2),
            ]
            path = folder / f"rig{rig}" / f"{week}.mcap"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(recording(f"rig{rig}", notes=notes, began=BEGAN + timedelta(weeks=week)))


def catalogue_of(folder: Path) -> dict[str, bytes]:
    """All files of a catalogue but its lock."""
    found = (path for path in (folder / FOLDER).rglob("*") if path.is_file() and path.suffix != ".lock")
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def report(cause: str = "coulomb_friction") -> str:
    """As much of a diagnosis as the archive reads."""
    parameters = {"level": {"value": 520.0, "unit": "N m", "ci95": [500.0, 540.0]}}
    return json.dumps({"verdict": "effects", "effects": [{"name": cause, "parameters": parameters}]})
