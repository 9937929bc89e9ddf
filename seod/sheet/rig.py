"""What a rig file tells a sheet: its calibrations and the unit of its commands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from seod.calibrate.value import Value
from seod.sheet.segments import SheetError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.sheet.segments import Segment

VALUES: Final = ("K_L", "K_L_up", "K_L_down", "null", "delay")
EDGES: Final = ("deadband_up", "deadband_down")
"""What a calibration holds: values with intervals, and voltages between which an edge lies."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What `seod calibrate` wrote.

    Attributes:
        day: Of the measurement (UTC).
        values: Of `VALUES`, those that were measured.
        edges: Of `EDGES`, likewise: the lower voltage first.
        supply_pressure: Meanwhile [Pa].
    """

    day: str
    values: Mapping[str, Value]
    edges: Mapping[str, tuple[float, float]]
    supply_pressure: float | None


@dataclass(frozen=True, slots=True)
class RigFacts:
    """What is known of a rig by its file.

    Attributes:
        source: Where the file is, for people.
        calibrations: By axis; an axis without one is left out.
        commands: SI unit of the command by axis.
    """

    source: str
    calibrations: Mapping[str, Calibration]
    commands: Mapping[str, str]


def of_file(path: Path, rig: str) -> RigFacts:
    """Of a rig file that the user names.

    Raises:
        ConfigErrors: It is wrong.
        SheetError: It is that of another rig.
    """
    from seod.config.load import load_rig  # noqa: PLC0415 - pydantic, and the driver

    config = load_rig(path)
    if config.rig != rig:
        raise SheetError(f"{path}: is the rig file of {config.rig!r}, not of {rig!r}")
    told = {name: axis.calibration for name, axis in config.axes.items() if axis.calibration is not None}
    return RigFacts(
        str(path),
        {name: _calibration(each.model_dump()) for name, each in told.items()},
        {name: axis.command_unit for name, axis in config.axes.items()},
    )


def of_recording(archive: str, found: Sequence[Segment]) -> RigFacts | None:
    """Of the rig file inside the newest recording that has one; None: the archive gives none."""
    from seod.record.read import RecordingError, beginning  # noqa: PLC0415 - mcap

    newest = sorted({(each.begin, each.file) for each in found}, reverse=True)
    for file in dict.fromkeys(file for _, file in newest):
        path = Path(archive) / file
        if path.suffix != ".mcap" or not path.is_file():
            continue
        try:
            rig = beginning(path).rig
        except (RecordingError, OSError):
            continue
        if rig:
            return _of_json(f"the rig file in {file}", rig)
    return None


def _of_json(source: str, rig: Mapping[str, Any]) -> RigFacts:
    axes: Mapping[str, Any] = rig.get("axes", {})
    outputs = rig.get("outputs", {})
    told = {name: axis["calibration"] for name, axis in axes.items() if axis.get("calibration")}
    commands = {name: outputs.get(axis.get("output"), {}).get("unit", "V") for name, axis in axes.items()}
    return RigFacts(source, {name: _calibration(each) for name, each in told.items()}, commands)


def _calibration(told: Mapping[str, Any]) -> Calibration:
    values = {name: told[name] for name in VALUES if told.get(name)}
    edges = {name: told[name]["interval"] for name in EDGES if told.get(name)}
    return Calibration(
        told["date"],
        {name: Value(each["value"], each["sd"], _pair(each["interval"])) for name, each in values.items()},
        {name: _pair(each) for name, each in edges.items()},
        told.get("supply_pressure"),
    )


def _pair(ends: Sequence[float]) -> tuple[float, float]:
    return float(ends[0]), float(ends[1])
