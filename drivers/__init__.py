"""Drivers: the loop's ways to a rig. One file a driver, imported only when a rig file names it."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import cast

from drivers.base import Driver, DriverError
from drivers.light_can import import_light

TABLE: dict[str, tuple[str, str]] = {
    "can": ("drivers.can", "CanDriver"),
    "replay": ("drivers.replay", "ReplayDriver"),
    "serial": ("drivers.serial", "SerialDriver"),
    "virtual": ("drivers.virtual", "VirtualDriver"),
}
"""Built-in drivers: kind -> (module, class)."""

ENTRY_POINTS = "seod.drivers"
"""Entry point group by which other packages add kinds."""


def driver_kinds() -> list[str]:
    """Names that `driver.kind` may have: the built-in ones and those of installed packages."""
    return sorted({*TABLE, *(point.name for point in entry_points(group=ENTRY_POINTS))})


def driver_class(kind: str) -> type[Driver]:
    """The driver class of a kind; imports only that driver.

    Raises:
        DriverError: No such kind; the message lists those there are.
    """
    if kind in TABLE:
        module, name = TABLE[kind]
        if kind == "can":
            import_light()
        return cast("type[Driver]", getattr(import_module(module), name))
    for point in entry_points(group=ENTRY_POINTS, name=kind):
        return cast("type[Driver]", point.load())
    raise DriverError(f"unknown driver kind {kind!r}; known: {', '.join(driver_kinds())}")
