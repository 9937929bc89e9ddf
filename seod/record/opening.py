"""Which recorder a file name asks for."""

from __future__ import annotations

import time
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, cast

from drivers import driver_class
from seod.record.csv_recorder import CsvRecorder
from seod.record.errors import BusLogError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from drivers.can_config import CanOptions
    from seod.config.model import RigConfig
    from seod.record.bus import BusLog


class Recorder(Protocol):
    """What the gateway needs of a recorder; nothing here waits for a disk but `close`."""

    @property
    def waiting(self) -> int:
        """Rows that are not yet written."""

    @property
    def error(self) -> str:
        """What is wrong at present; "" if nothing is."""

    def add(self, rows: NDArray[np.void]) -> None:
        """Take rows (dtype `seod.record.layout.row_dtype`)."""

    def note(self, topic: str, t: float, message: Mapping[str, Any]) -> None:
        """Take an estimate, an event or a health message of time `t` [s]."""

    def report(self) -> dict[str, Any]:
        """For `health`."""

    def close(self) -> int:
        """Write what waits and end; returns how many rows are not in the file."""


def open_recorder(path: Path, config: RigConfig, rig_text: str) -> Recorder:
    """Start recording: CSV for the suffix `.csv`, else MCAP.

    Args:
        path: The file.
        config: The rig file as it was read.
        rig_text: The rig file.

    Raises:
        OSError: The file cannot be had.
    """
    axes = list(config.axes)
    units = {name: axis.measured_unit for name, axis in config.axes.items()}
    if path.suffix.lower() == ".csv":
        return CsvRecorder(path, axes, units)
    from seod.config.redact import redacted  # noqa: PLC0415 - likewise
    from seod.record.mcap_file import About  # noqa: PLC0415 - not needed without a recording
    from seod.record.recorder import McapRecorder  # noqa: PLC0415
    from seod.record.series import Rotation  # noqa: PLC0415

    offset_ns = time.time_ns() - time.monotonic_ns()
    about = About(
        config.rig, axes, redacted(rig_text), config.model_dump_json(), time.time(), offset_ns, units
    )
    size = None if config.record.max_megabytes is None else config.record.max_megabytes * 1e6
    return McapRecorder(path, about, Rotation(size, config.record.max_time))


def open_bus_log(config: RigConfig, directory: Path) -> BusLog | None:
    """Start logging the bus, if the rig file asks for it.

    Args:
        config: The rig file as it was read.
        directory: Its folder.

    Raises:
        BusLogError: There is no bus, or bus or file cannot be had.
    """
    if config.record.bus_log is None:
        return None
    if config.record.bus_log.lower().endswith(".mf4"):
        import_module("can")  # whole: a driver imports it without its MF4 files
    driver = driver_class(config.driver["kind"])
    if not driver.bus_log:
        raise BusLogError(f"record.bus_log: driver kind {config.driver['kind']} has no bus: leave it out")
    from seod.record.bus import BusLog  # noqa: PLC0415 - python-can only where there is a bus

    options = driver.Options.model_validate(config.driver)
    return BusLog(directory / config.record.bus_log, cast("CanOptions", options))
