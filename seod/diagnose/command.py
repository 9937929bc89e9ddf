"""Between recordings and the search: the part that is looked at, what y is, the command as it is typed."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.config.units import UNITS
from seod.data.units import BASE
from seod.diagnose import pipeline
from seod.diagnose.pipeline import diagnose
from seod.diagnose.record.column_checks import time_remarks
from seod.diagnose.record.daemon_part import telling_part
from seod.diagnose.result import RELEVANCE, DiagnoseError
from seod.diagnose.verdict.bootstrap import with_intervals

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
    """Options of the command, by which its line is told again; `config` is a rig file."""

    holdout: Sequence[Path] = ()
    config: Path | None = None
    out: Path | None = None
    axis: str | None = None
    output: Output | None = None
    columns: str = ""
    units: str = ""
    between: tuple[float, float] | None = None
    effort: Effort = "normal"
    hold: Hold | None = None
    gain: float | None = None
    delay: float | None = None
    relevance: float = RELEVANCE


def found(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    config: RigConfig | None,
    options: Options,
    parts: Sequence[Part | None],
    progress: Progress,
) -> Diagnosis:
    """The diagnosis with intervals, and with what was read of each recording.

    Args:
        recordings: At least one.
        holdout: Further ones, that no fit sees.
        config: The rig whose model is the baseline.
        options: See there.
        parts: Of each recording, the part that it is of.
        progress: Called with what is being done and the part of all work that is.

    Raises:
        DiagnoseError: A recording tells nothing.
    """
    usual = output_of(recordings[0], config, options.axis)
    asked = pipeline.Options(
        output=options.output or (usual if config is not None else None),
        config=config,
        axis=options.axis,
        effort=options.effort,
        hold=options.hold,
        gain=options.gain,
        delay=options.delay,
        usual=usual,
        relevance=options.relevance,
    )
    d = with_intervals(_diagnosed(recordings, holdout, asked, progress))
    names = [each.paths[0].name for each in recordings]
    slow = time_remarks(recordings[0], d.extended.omega_n)
    return replace(d, remarks=(*_cut_short(names, parts), *d.remarks, *slow))


def command_line(paths: Sequence[Path], options: Options) -> str:
    """The command that asks for this; what is as usual is left out."""
    usual = Options()
    between = ":".join(f"{end:g}" if math.isfinite(end) else "" for end in options.between or ())
    relevance = "" if options.relevance == usual.relevance else f"{100.0 * options.relevance:g}"
    told = {
        "--config": options.config,
        "--out": options.out,
        "--axis": options.axis,
        "--output": options.output,
        "--gain": options.gain,
        "--delay": options.delay,
        "--hold": options.hold,
        "--columns": options.columns,
        "--units": options.units,
        "--between": between,
        "--effort": "" if options.effort == usual.effort else options.effort,
        "--relevance": relevance,
    }
    words = ["seod", "diagnose", *map(str, paths)]
    words += [word for each in options.holdout for word in ("--holdout", str(each))]
    words += [word for name, value in told.items() if value not in (None, "") for word in (name, str(value))]
    return shlex.join(words)


def part_of(path: Path, axis: str | None) -> Part | None:
    """The part of a daemon's recording that tells of the plant; None: all of it."""
    return telling_part(path, axis) if path.suffix == ".mcap" else None


def _cut_short(names: Sequence[str], parts: Sequence[Part | None]) -> list[str]:
    """What is said of recordings that are diagnosed in part."""
    return [
        f"{name}: {part.why} from t = {part.start:.2f} s{_until(part.end)}: only that is diagnosed; "
        "--between FROM:TO takes another part"
        for name, part in zip(names, parts, strict=True)
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
