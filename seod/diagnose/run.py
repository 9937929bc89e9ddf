"""`seod diagnose`: recordings in, a table or JSON out, and a folder with report and extended rig file."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.config.units import UNITS
from seod.data import read
from seod.data.units import BASE
from seod.diagnose.answer import DiagnoseError
from seod.diagnose.command import Options, diagnose
from seod.diagnose.progress import bar
from seod.diagnose.recorded import telling_part
from seod.diagnose.report.files import REPORT, RIG, write
from seod.diagnose.report.text import as_text
from seod.diagnose.show.bootstrap import with_intervals

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.answer import Diagnosis, Output
    from seod.diagnose.command import Progress
    from seod.diagnose.recorded import Part

_LEFT_OUT: Final = (
    "duplicate",
    "decreasing",
    "infinite",
    "several_commands",
    "truncated",
    "damaged",
    "unread",
)
"""Problems of a file that the search for defects does not see, because the reader has left these rows out."""
_SPEEDS: Final = ("angular speed", "speed")


class Wishes(NamedTuple):
    """Options of the command; `rig` is a rig file and what it says."""

    holdout: Sequence[Path] = ()
    rig: tuple[Path, RigConfig] | None = None
    out: Path | None = None
    axis: str | None = None
    output: Output | None = None
    columns: str = ""
    units: str = ""
    between: tuple[float, float] | None = None
    as_json: bool = False


def run(paths: Sequence[Path], wishes: Wishes) -> str:
    """The answer as it is printed; writes the folder if one is wished.

    Raises:
        ReadError: A file cannot be read.
        DiagnoseError: A recording tells nothing.
        OSError: The folder cannot be written.
    """
    parts = [None if wishes.between else _part(path, wishes.axis) for path in paths]
    recordings = [
        read(path, wishes.columns, wishes.units, wishes.axis, between=part[:2] if part else wishes.between)
        for path, part in zip(paths, parts, strict=True)
    ]
    holdout = [read(path, wishes.columns, wishes.units, wishes.axis) for path in wishes.holdout]
    config = wishes.rig[1] if wishes.rig is not None else None
    options = Options(wishes.output or output_of(recordings[0], config, wishes.axis), config, wishes.axis)
    if wishes.out is not None:
        wishes.out.mkdir(parents=True, exist_ok=True)  # that it cannot be made is told before the work
    with bar() as progress:
        d = with_intervals(_diagnosed(recordings, holdout, options, progress))
    d = replace(d, remarks=(*_cut_short(paths, parts), *d.remarks))
    unit = unit_of(recordings[0], d.output, config, wishes.axis)
    told = [] if wishes.as_json else [as_text(d, unit)]
    if wishes.out is not None:
        rig = None
        if wishes.rig is not None:
            rig = (*wishes.rig, wishes.axis or next(iter(wishes.rig[1].axes)))
        missing = write(wishes.out, d, unit, [*recordings, *holdout], rig)
        told += [f"! {each}" for each in missing] if not wishes.as_json else []
        told += [] if missing or wishes.as_json else [_written(wishes.out)]
    return json.dumps(d.as_json()) if wishes.as_json else "\n".join(told)


def _part(path: Path, axis: str | None) -> Part | None:
    return telling_part(path, axis) if path.suffix == ".mcap" else None


def _cut_short(paths: Sequence[Path], parts: Sequence[Part | None]) -> list[str]:
    """What is said of recordings that are diagnosed in part."""
    return [
        f"{path.name}: {part.why} from t = {part.start:.2f} s{_until(part.end)}: only that is diagnosed; "
        "--between FROM:TO takes another part"
        for path, part in zip(paths, parts, strict=True)
        if part is not None
    ]


def _until(end: float) -> str:
    return f" to {end:.2f} s" if math.isfinite(end) else " on"


def _diagnosed(
    recordings: Sequence[Recording], holdout: Sequence[Recording], options: Options, progress: Progress
) -> Diagnosis:
    """The diagnosis, with what reading the files has left out."""
    every = (*recordings, *holdout)
    remarks = tuple(str(each) for one in every for each in one.problems if each.kind in _LEFT_OUT)
    try:
        d = diagnose(recordings, holdout, options, progress)
    except DiagnoseError as error:
        raise DiagnoseError("; ".join([str(error), *remarks])) from error
    return replace(d, remarks=(*remarks, *d.remarks))


def output_of(recording: Recording, config: RigConfig | None, axis: str | None) -> Output:
    """What y is where nobody says it: by its unit, then by the rig file's axis; else a position."""
    dimension = UNITS.get(recording.units.get("y", ""), ("", 0.0))[0]
    if dimension and dimension != "number":
        return "velocity" if dimension in _SPEEDS else "position"
    return "position" if config is None else config.axes[axis or next(iter(config.axes))].mode


def unit_of(recording: Recording, output: Output, config: RigConfig | None, axis: str | None) -> str:
    """Of y: as the file tells it, or in SI by the rig file's sensor; `unit` where nobody does."""
    speed = "/s" if output == "velocity" else ""
    if config is not None and not recording.units.get("y"):
        own = config.axes[axis or next(iter(config.axes))]
        base = BASE.get(config.sensors[own.sensor].dimension, "unit")
        return f"{base.removesuffix('/s')}{speed}"
    return recording.units.get("y", "") or f"unit{speed}"


def _written(out: Path) -> str:
    return f"{out / REPORT}: the report; {out / RIG}: the extended rig, for `seod run` and `seod simulate`"
