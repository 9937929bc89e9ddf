"""Blocks into an MDF file, by asammdf."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import ReadError, needs_extra
from seod.data.units import KNOWN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from seod.data.source import Block, Column, Group, Values

_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no place for, by its section 2.2."""


class MdfWriter:
    """MDF 4: a channel group for each group, its time as master; rows without a time are left out."""

    left_out = 0

    def __init__(self, path: Path, groups: Sequence[Group], notes: dict[str, str]) -> None:
        try:
            from asammdf import MDF, Signal  # noqa: PLC0415 - optional
        except ImportError as error:
            raise needs_extra(path, "asammdf", "mdf") from error
        self.left_out = 0
        self._path = path
        self._groups = {group.name: group for group in groups}
        self._signal: Callable[..., Any] = Signal
        self._numbers: dict[str, int] = {}
        self._mdf: Any = MDF(version="4.10")
        self._mdf.header.comment = _for_xml("; ".join(f"{key}: {value}" for key, value in notes.items()))

    def write(self, block: Block) -> None:
        """Append."""
        group = self._groups[block.group.name]
        master = group.column(group.time or "t") or next(
            (c for c in group.columns if c.name.endswith(".t")), None
        )
        if master is None:
            raise ReadError(
                f"{self._path}: MDF needs a time, no column is called t: `--columns t=NAME` says which"
            )
        times = block.values[master.name] * KNOWN.get(master.unit, ("", 1.0))[1]
        known = np.isfinite(times)
        self.left_out += int((~known).sum())
        others = [column for column in group.columns if column is not master]
        values = {column.name: _mdf_samples(block.values[column.name][known]) for column in others}
        times = times[known]
        if group.name in self._numbers:
            samples = [(values[column.name], None) for column in others]
            self._mdf.extend(self._numbers[group.name], [(times, None), *samples])
        elif len(times):
            self._begin(group, master, others, times, values)

    def _begin(
        self, group: Group, master: Column, others: list[Column], times: Values, values: dict[str, Values]
    ) -> None:
        signals = [
            self._signal(
                values[column.name],
                times,
                unit=column.unit,
                name=column.name,
                encoding="utf-8" if column.text else None,
                master_metadata=(master.name, 1),
            )
            for column in others
        ]
        name = group.name or "rows"
        self._numbers[group.name] = self._mdf.append(signals, acq_name=name, common_timebase=True)

    def close(self) -> None:
        """Complete the file."""
        try:
            self._mdf.save(self._path, overwrite=True)
        finally:
            self._mdf.close()


def _mdf_samples(values: Values) -> Values:
    if values.dtype != object:
        return values
    return np.array([str(value).encode() for value in values], "S")


def _for_xml(text: str) -> str:
    """The text with what XML cannot hold escaped: a comment of an MDF file is XML."""
    return _NOT_IN_XML.sub(lambda odd: repr(odd[0])[1:-1], text)
