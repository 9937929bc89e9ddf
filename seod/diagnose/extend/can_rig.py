"""The same rig on a virtual CAN bus, for `seod rig` as its other end: rig file and DBC."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from seod.config.edit import edited
from seod.config.load import load_text

if TYPE_CHECKING:
    from seod.config.errors import KeyPath
    from seod.config.model import RigConfig

DBC: Final = "extended.dbc"
CHANNEL: Final = "vcan0"
_TEMPLATE: Final = Path(__file__).parent / "rig_template.dbc"
_RATE_HZ: Final = 2000.0
"""Fastest loop: its frames are half of what 1 Mbit/s carries."""

_PATIENCE_S: Final = 0.3
"""With which both ends wait for each other: a busy computer hurts nobody."""


def on_can(text: str, rate_hz: float) -> str:
    """The rig file of a new rig (see `new_rig_file`), on a bus.

    Args:
        text: The rig file.
        rate_hz: Of its loop.
    """
    rate = min(rate_hz, _RATE_HZ)
    driver = {"kind": "can", "interface": "socketcan", "channel": CHANNEL, "bitrate": 1_000_000}
    driver |= {"dbc": DBC, "node": "seod", "messages": {"Sensor": {"rate_hz": rate}}}
    places: dict[KeyPath, object] = {
        ("driver",): driver,
        ("loop", "rate_hz"): rate,
        ("sensors", "y", "channel"): "Sensor.y",
        ("outputs", "u", "channel"): "Valve.voltage",
        ("simulation", "plants", "plant", "input"): "Valve.voltage",
        ("simulation", "plants", "plant", "output"): "Sensor.y",
        ("simulation", "sensor_rate_hz"): rate,
        ("simulation", "watchdog_s"): _PATIENCE_S,
        ("guard", "stale"): _PATIENCE_S,
        ("guard", "rig_watchdog"): _PATIENCE_S,
    }
    return edited(text, places)


def dbc(config: RigConfig) -> str:
    """The DBC of its two messages, with the axis' ranges.

    Args:
        config: The rig as `new_rig_file` has it.
    """
    limits = next(iter(config.axes.values())).limits
    reach = 2.0 * max(abs(end) for end in limits.travel)
    return (
        _TEMPLATE.read_text("utf-8")
        .replace("<y_step>", f"{reach / 2**31:.10G}")
        .replace("<y_reach>", f"{reach:.9G}")
        .replace("<u_step>", f"{2.0 * limits.output / 2**31:.10G}")
        .replace("<u_reach>", f"{2.0 * limits.output:.9G}")
    )


def checked(text: str, folder: Path) -> str:
    """The text, if it is a rig file that works with the DBC in `folder`.

    Raises:
        ConfigErrors: It is none.
    """
    load_text(text, "the extended rig on CAN", folder)
    return text
