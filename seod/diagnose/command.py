"""`seod diagnose`: recordings in, a table or JSON out, and a folder with report and extended rig file."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.config.load import load_rig
from seod.config.units import UNITS
from seod.data import read
from seod.data.units import BASE
from seod.diagnose import pipeline
from seod.diagnose.pipeline import diagnose
from seod.diagnose.record.daemon_part import telling_part
from seod.diagnose.report.files import REPORT, RIG, write
from seod.diagnose.report.text import as_text
from seod.diagnose.result import RELEVANCE, DiagnoseError
from seod.diagnose.show.bootstrap import with_intervals
from seod.terminal.progress import bar

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.pipeline import Progress
    from seod.diagnose.record.daemon_part import Part
    from seod.diagnose.result import Diagnosis, Hold, Output
    from seod.diagnose.search.budget import Effort

_LEFT_OUT: Final = (
    "duplicate",
    "decreasing",
    "infinite",
    "several_commands",
    "truncated",
    "damaged",
    "unread",
    "unit",
)
"""Problems of a file that the search for defects does not see, because the reader has left these rows out."""
_SPEEDS: Final = ("angular speed", "speed")


class Options(NamedTuple):
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
    effort: Effort = "normal"
    hold: Hold = "zero"
    gain: float | None = None
    delay: float | None = None
    relevance: float = RELEVANCE


def run(paths: Sequence[Path], options: Options) -> str:
    """The answer as it is printed; writes the folder if one is wished.

    Raises:
        ReadError: A file cannot be read.
        DiagnoseError: A recording tells nothing.
        OSError: The folder cannot be written.
    """
    parts = [None if options.between else _part(path, options.axis) for path in paths]
    recordings = [
        _read(path, options, part[:2] if part else options.between)
        for path, part in zip(paths, parts, strict=True)
    ]
    holdout = [_read(path, options) for path in options.holdout]
    config = options.rig[1] if options.rig is not None else None
    asked = pipeline.Options(
        options.output or (output_of(recordings[0], config, options.axis) if config is not None else None),
        config,
        options.axis,
        options.effort,
        options.hold,
        options.gain,
        options.delay,
        output_of(recordings[0], config, options.axis),
        options.relevance,
    )
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)  # that it cannot be made is told before the work
    with bar() as progress:
        d = with_intervals(_diagnosed(recordings, holdout, asked, progress))
    d = replace(d, remarks=(*_cut_short(paths, parts), *d.remarks))
    unit = unit_of(recordings[0], d.output, config, options.axis)
    told = [] if options.as_json else [as_text(d, unit)]
    if options.out is not None:
        rig = None
        if options.rig is not None:
            rig = (*options.rig, options.axis or next(iter(options.rig[1].axes)))
        missing = write(options.out, d, unit, [*recordings, *holdout], rig, command_line(paths, options))
        told += [f"! {each}" for each in missing] if not options.as_json else []
        told += [] if missing or options.as_json else [_written(options.out)]
    return json.dumps(d.as_json()) if options.as_json else "\n".join(told)


def command_line(paths: Sequence[Path], options: Options) -> str:
    """The command that asks for this; what is as usual is left out."""
    usual, rig = Options(), options.rig[0] if options.rig is not None else None
    between = ":".join(f"{end:g}" if math.isfinite(end) else "" for end in options.between or ())
    relevance = "" if options.relevance == usual.relevance else f"{100.0 * options.relevance:g}"
    told = {
        "--config": rig,
        "--out": options.out,
        "--axis": options.axis,
        "--output": options.output,
        "--gain": options.gain,
        "--delay": options.delay,
        "--hold": "" if options.hold == usual.hold else options.hold,
        "--columns": options.columns,
        "--units": options.units,
        "--between": between,
        "--effort": "" if options.effort == usual.effort else options.effort,
        "--relevance": relevance,
    }
    words = ["seod", "diagnose", *map(str, paths)]
    words += [word for each in options.holdout for word in ("--holdout", str(each))]
    words += [word for name, value in told.items() if value not in (None, "") for word in (name, str(value))]
    return shlex.join([*words, *(["--json"] if options.as_json else [])])


def _read(path: Path, options: Options, between: tuple[float, float] | None = None) -> Recording:
    of_rig = options.rig is not None
    return read(path, options.columns, options.units, options.axis, between=between, of_rig=of_rig)


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
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    options: pipeline.Options,
    progress: Progress,
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
    port = load_rig(out / RIG).server.port
    rig = f"{out / RIG}: the extended rig, for `seod run` (port {port}) and `seod simulate`"
    return f"{out / REPORT}: the report; {rig}"
