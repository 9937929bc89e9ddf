"""A rig file on its way to a `RigConfig`: what the rules look at, however much of it is right."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from seod.config.errors import ConfigError, KeyPath, dotted
from seod.config.model import LoopConfig
from seod.config.sensors import SensorConfig, sensor_or_none
from seod.config.translate import at, show
from sim.config import SimulationConfig

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.base import Channel, Driver
    from seod.config.yaml_lines import Document

    SectionT = TypeVar("SectionT", bound=BaseModel)


@dataclass
class Draft:
    """The raw file and those parts of it that are valid by themselves.

    Attributes:
        file: Name for messages.
        directory: Folder that relative paths start from.
        document: The parsed file.
        driver: Driver class; None if its kind is not known.
        options: Its options; None if they are not valid.
        channels: What the driver offers, by name; None if that cannot be told.
    """

    file: str
    directory: Path
    document: Document
    driver: type[Driver] | None = None
    options: BaseModel | None = None
    channels: dict[str, Channel] | None = None
    _sections: dict[KeyPath, BaseModel | None] = field(default_factory=dict)

    def raw(self, *path: str | int) -> Any:
        """The value as written; None where there is none."""
        return at(self.document.value, path)

    def names(self, section: str) -> list[str]:
        """Names in `sensors`, `outputs` or `axes`, valid or not."""
        return self.keys(section)

    def keys(self, *path: str | int) -> list[str]:
        """Keys of the mapping at a path, valid or not; none where there is no mapping."""
        value = self.raw(*path)
        return list(value) if isinstance(value, dict) else []

    def text(self, *path: str | int) -> str | None:
        """The text at a path; None if something else, or nothing, is there."""
        value = self.raw(*path)
        return value if isinstance(value, str) else None

    def section(self, model: type[SectionT], *path: str | int) -> SectionT | None:
        """A section by itself: its defaults if left out, None if it is not valid or has to be there."""
        if path not in self._sections:
            value = self.raw(*path)
            self._sections[path] = validated(model, {} if value is None else value)
        found = self._sections[path]
        return found if isinstance(found, model) else None

    def sensor(self, name: str | None) -> SensorConfig | None:
        """A sensor by its name; None if it is not valid."""
        return sensor_or_none(json.dumps(self.raw("sensors", name or "")))

    @property
    def period(self) -> float | None:
        """Tick period [s]."""
        loop = self.section(LoopConfig, "loop")
        return 1.0 / loop.rate_hz if loop else None

    @property
    def simulation(self) -> SimulationConfig | None:
        """The simulated rig; None if there is none or it is not valid."""
        return self.section(SimulationConfig, "simulation")

    def error(self, path: KeyPath, message: str, right: str = "") -> ConfigError:
        """A mistake at a path."""
        return ConfigError(self.file, self.document.line(path), dotted(path), message, right)

    def wrong(self, path: KeyPath, message: str, right: str = "") -> ConfigError:
        """A mistake at a path, with the value that is written there."""
        value = self.raw(*path)
        return self.error(path, message if value is None else f"{message}, got {show(value)}", right)


def validated(model: type[SectionT], value: Any) -> SectionT | None:
    """The model made of a raw value; None if that is not valid."""
    try:
        return model.model_validate_json(json.dumps(value))
    except ValidationError:
        return None
