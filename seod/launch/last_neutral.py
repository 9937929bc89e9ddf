"""Neutral for a rig whose daemon has ended, however it ended: what the unit's ExecStopPost= does."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

from drivers import driver_class
from drivers.base import DriverError
from drivers.neutral import open_neutral
from seod.config.channels import input_channels, neutral_values, output_channels
from seod.launch.locks import LockedError, lock_rig

if TYPE_CHECKING:
    from seod.config.model import RigConfig

REPEATS: Final = 5
PAUSE_S: Final = 0.02
"""A frame can be lost: neutral is written so often, with this pause."""


def write_neutral(config: RigConfig) -> str:
    """Write neutral, by the driver's recipe for other processes; "" or why it was not written.

    Args:
        config: The rig file. A daemon that runs this rig has it: then nothing is written.
    """
    try:
        lock_rig(config.rig)
        recipe = _recipe(config)
    except (LockedError, DriverError) as error:
        return str(error)
    writer = open_neutral(recipe)
    try:
        why = [_write(writer) for _ in range(REPEATS)]
    finally:
        writer.close()
    return "" if "" in why else why[-1]


def _recipe(config: RigConfig) -> dict[str, Any]:
    kind = driver_class(config.driver["kind"])
    if kind.acts_on != "rig":
        raise DriverError(f"driver.kind {config.driver['kind']} moves no rig")
    driver = kind(kind.Options.model_validate(config.driver), time.monotonic)
    try:
        driver.open(input_channels(config), output_channels(config), neutral_values(config))
        return dict(driver.neutral_recipe())
    finally:
        driver.close()


def _write(writer: Any) -> str:
    why: str = writer.write(0)
    time.sleep(PAUSE_S)
    return why
