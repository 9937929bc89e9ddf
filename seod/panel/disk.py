"""The disk that recordings go to."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from seod.panel.panel import Panel


class Disk(NamedTuple):
    """Bytes."""

    free: int
    size: int


def disk_of(panel: Panel) -> Disk | None:
    """Where recordings go, or would go; None where that is gone."""
    recorder = panel.house.health.get("recorder") or {}
    folder = panel.rig_file.parent / (panel.config.record.folder or "")
    if recorder.get("file"):
        folder = Path(recorder["file"]).parent
    if not folder.is_dir():
        folder = panel.rig_file.parent
    try:
        used = shutil.disk_usage(folder)
    except OSError:
        return None
    return Disk(used.free, used.total)
