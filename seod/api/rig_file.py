"""A rig file: what it says, whether it can work, the same with other values."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from seod.config.check import check
from seod.config.edit import edited
from seod.config.load import load_rig, load_text
from seod.config.model import RigConfig
from seod.files.shipped import configs_dir
from seod.files.user_files import write_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from seod.config.axis import AxisConfig
    from seod.config.check import Report
    from seod.config.errors import KeyPath


class RigFile:
    """A rig file that was read and found right.

    Args:
        path: Where it is.

    Attributes:
        path: Where it is, or would be.
        text: Its text, comments and all.
        config: What it says, in SI units.

    Raises:
        ConfigErrors: All that is wrong with it, each with file, line and key.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        self.config: RigConfig = load_rig(self.path)
        self.text = self.path.read_text("utf-8-sig")

    @classmethod
    def from_text(cls, text: str, name: str = "rig.yaml", folder: str | PathLike[str] = ".") -> Self:
        """A rig file from its text; relative paths in it start from `folder`.

        Raises:
            ConfigErrors: All that is wrong with it.
        """
        made = cls.__new__(cls)
        made.path, made.text = Path(folder) / name, text
        made.config = load_text(text, name, Path(folder).resolve())
        return made

    @classmethod
    def shipped(cls, name: str = "virtual") -> Self:
        """One that comes with seod: `virtual`, `servo-virtual`, `seat-virtual`, `tail-virtual`, `can` ...

        Raises:
            ConfigErrors: There is none of that name.
        """
        return cls(configs_dir() / f"{name}.yaml")

    @property
    def rig(self) -> str:
        """Its name."""
        return self.config.rig

    @property
    def axes(self) -> Mapping[str, AxisConfig]:
        """By their names."""
        return self.config.axes

    def axis(self, name: str | None = None) -> str:
        """The axis meant: the only one where none is named.

        Raises:
            ValueError: There is none of that name, or a choice.
        """
        there = ", ".join(self.axes)
        if name is None and len(self.axes) > 1:
            raise ValueError(f"{self.path} has the axes {there}: choose one by --axis")
        if name is not None and name not in self.axes:
            raise ValueError(f"no axis {name!r}; {self.path} has {there}")
        return name or next(iter(self.axes))

    def check(self) -> Report:
        """What `seod check` says: load of its bus, refusals, warnings."""
        return check(self.config, self.path if self.path.is_file() else None)

    def with_values(self, values: Mapping[str, Any]) -> Self:
        """The same with other values; comments and order stay.

        Args:
            values: By their place: `{"axes.motor.relay.e_a": "400 mV"}`.

        Raises:
            ConfigErrors: What comes out is wrong.
        """
        paths: dict[KeyPath, Any] = {tuple(place.split(".")): value for place, value in values.items()}
        return self.from_text(edited(self.text, paths), self.path.name, self.path.parent)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write its text.

        Raises:
            OSError: It cannot be written.
        """
        write_text(Path(path), self.text)
        return Path(path)

    def summary(self) -> str:
        """As `seod check` prints it."""
        return str(self.check())

    def to_dict(self) -> dict[str, Any]:
        """All that it says, in SI units; JSON-able, without secrets."""
        return self.config.model_dump(mode="json")

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"

    def __repr__(self) -> str:
        return f"<RigFile {self.path}: {self.rig}, {', '.join(self.axes)}>"


def rig_of(config: RigFile | RigConfig | str | PathLike[str] | None) -> RigFile | None:
    """What was given as a rig file; None for none.

    Raises:
        ConfigErrors: It is wrong.
    """
    if config is None or isinstance(config, RigFile):
        return config
    if isinstance(config, RigConfig):
        made = RigFile.__new__(RigFile)
        made.path, made.text, made.config = Path(f"{config.rig}.yaml"), "", config
        return made
    return RigFile(config)
