"""Writes what `--out DIR` asks for: report.html, diagnosis.json and the extended rig."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

from seod import __version__
from seod.config.errors import ConfigErrors
from seod.config.load import load_text
from seod.diagnose.extend.can_rig import DBC, checked, dbc, on_can
from seod.diagnose.extend.model import Model
from seod.diagnose.extend.references import moved
from seod.diagnose.extend.rig_file import into_config, new_rig_file
from seod.diagnose.extend.seen import seen
from seod.diagnose.report.as_read import as_read
from seod.diagnose.report.page import page
from seod.files.user_files import write_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from seod.config.model import RigConfig
    from seod.data import Recording
    from seod.diagnose.result import Diagnosis

REPORT, ANSWER, RIG, CAN_RIG = "report.html", "diagnosis.json", "extended.yaml", "extended-can.yaml"
"""Names of the files."""


class Rig(NamedTuple):
    """A rig file: where it is, its text, what it says, and the axis that the recordings are of."""

    path: Path
    text: str
    config: RigConfig
    axis: str


def write(
    out: Path,
    d: Diagnosis,
    unit: str,
    recordings: Sequence[Recording],
    rig: Rig | None,
    command: str = "",
    answer: Mapping[str, Any] | None = None,
) -> list[str]:
    """Write all three; returns what could not be written, in sentences.

    Args:
        out: Folder; made where it is not there.
        d: The diagnosis.
        unit: Of y.
        recordings: What it is of.
        rig: Rig file, if there is one.
        command: By which it was asked for; "" where none was.
        answer: What diagnosis.json holds; None: the contract's answer.

    Raises:
        OSError: A file cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    sources = [path.name for recording in recordings for path in recording.paths]
    told = as_read(d, recordings[0], unit)
    write_text(out / REPORT, page(*told, sources, facts(recordings, command)))
    write_text(out / ANSWER, json.dumps(d.as_json() if answer is None else answer, indent=1) + "\n")
    try:
        write_rig(out, d, recordings[0], rig)
    except (ValueError, ConfigErrors) as error:
        return [f"no extended rig file: {error}"]
    return []


def facts(recordings: Sequence[Recording], command: str) -> list[tuple[str, str]]:
    """What a page says of its run: date, version, command, and what the recordings are."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    told = [("made", f"{now} by seod {__version__}"), *([("command", command)] if command else [])]
    return told + [("recording", _extent(each)) for each in recordings]


def _extent(recording: Recording) -> str:
    """Length and rate."""
    names = ", ".join(path.name for path in recording.paths)
    seconds = float(recording.t[-1] - recording.t[0])
    return f"{names}: {seconds:.4g} s at {recording.rate_hz:.4g} Hz, {len(recording.t)} rows"


def write_rig(out: Path, d: Diagnosis, recording: Recording, rig: Rig | None) -> None:
    """Write the extended rig: the user's own file with the model in it, or a new one, virtual and on CAN.

    Raises:
        ValueError, ConfigErrors: The model makes no rig.
        OSError: A file cannot be written.
    """
    text = extended_rig(d, recording, rig)
    if rig is not None and rig.config.simulation is not None:
        text = moved(text, rig.config, rig.path, out)
    config = load_text(text, RIG, out)
    write_text(out / RIG, text)
    if rig is None or rig.config.simulation is None:
        write_text(out / DBC, dbc(config))
        write_text(out / CAN_RIG, checked(on_can(text, config.loop.rate_hz), out))


def extended_rig(d: Diagnosis, recording: Recording, rig: Rig | None) -> str:
    """The extended model as a rig file: the user's own if it has a simulated plant, else a new one.

    Raises:
        ValueError, ConfigErrors: The model fits in neither.
    """
    e = d.extended
    lasts = float(recording.t[-1] - recording.t[0])
    model = Model(e.K_L, e.omega_n, e.zeta, e.effects, d.noise_sd[0] if d.noise_sd else 0.0).steady(lasts)
    if rig is not None and rig.config.simulation is not None:
        return into_config(rig.text, rig.config, rig.axis, model)
    speed = d.output == "velocity"
    return new_rig_file(model, seen(recording, speed), speed, recording.paths[0].name)
