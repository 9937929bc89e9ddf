"""MDF 3 and 4, by asammdf: a group for each channel group that has samples."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.data.source import BLOCK_ROWS, Block, Column, Group, Remark, needs_extra, place
from seod.files.damage import DamagedError, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from seod.data.source import Values


_HEAD_BYTES = 228
"""Identification and header of either version."""


class MdfSource:
    """An MDF file.

    Raises:
        ReadError: asammdf is missing.
        DamagedError: It is no such file.
    """

    format = "mdf"

    def __init__(self, path: Path) -> None:
        try:
            from asammdf import MDF  # noqa: PLC0415 - optional
        except ImportError as error:
            raise needs_extra(path, "asammdf", "mdf") from error
        self.path = path
        self.remarks: list[Remark] = []
        _check_head(path)
        self._file = path.open("rb")  # ours, for asammdf leaves it open where it fails
        self._indices: dict[str, tuple[int, dict[str, int]]] = {}
        try:
            self._mdf: Any = MDF(self._file)
            used = [k for k in range(len(self._mdf.groups)) if self._mdf.groups[k].channel_group.cycles_nr]
            self.groups: tuple[Group, ...] = tuple(self._group(index, len(used) > 1) for index in used)
        except BaseException:
            self._file.close()
            raise
        comment = _plain(self._mdf.header.comment)
        self.notes: Mapping[str, str] = {"comment": comment} if comment else {}

    def close(self) -> None:
        """Close the file."""
        self._mdf.close()
        self._file.close()

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; a group ends where it cannot be read any more."""
        rows = {name: self._length(name) for name in wanted}
        total, before = max(1, sum(rows.values())), 0
        for group in self.groups:
            for at in range(0, rows.get(group.name, 0), BLOCK_ROWS):
                count = min(BLOCK_ROWS, rows[group.name] - at)
                values = self._block(group, wanted[group.name], at, count)
                read = min(map(len, values.values()), default=0)
                if read:
                    whole = {name: each[:read] for name, each in values.items()}
                    yield Block(group, whole, np.arange(at + 1, at + 1 + read), (before + at + read) / total)
                if read < count:
                    break
            before += rows.get(group.name, 0)

    def _block(self, group: Group, names: Sequence[str], at: int, count: int) -> dict[str, Values]:
        """Rows of a group, fewer than `count` where the file is damaged, which is remarked."""
        values: dict[str, Values] = {}
        try:
            for name in names:
                with library():
                    values[name] = self._values(group, name, at, count)
        except DamagedError as error:
            self.remarks.append(
                Remark("damaged", f"{place(group.name, at + 1, name)}: cannot be read: {error}")
            )
            return {}
        short = min(map(len, values.values()), default=count)
        if short < count:
            self.remarks.append(Remark("damaged", f"{place(group.name, at + short)}: is the last one there"))
        return values

    def _length(self, name: str) -> int:
        return int(self._mdf.groups[self._indices[name][0]].channel_group.cycles_nr)

    def _group(self, index: int, several: bool) -> Group:
        group = self._mdf.groups[index]
        name = (getattr(group.channel_group, "acq_name", None) or f"group {index + 1}") if several else ""
        if name in self._indices:
            name = f"{name} ({index + 1})"
        channels = {channel.name: at for at, channel in enumerate(group.channels)}
        if len(channels) < len(group.channels):
            self.remarks.append(
                Remark("unread", f"{name}: of channels with the same name only the last is read")
            )
        self._indices[name] = (index, channels)
        master = self._mdf.masters_db.get(index)
        columns = tuple(self._column(index, channel, at) for channel, at in channels.items())
        readable = tuple(column for column in columns if column is not None)
        return Group(name, readable, None if master is None else group.channels[master].name)

    def _column(self, group: int, name: str, at: int) -> Column | None:
        try:
            with library():
                sample = self._mdf.get(group=group, index=at, record_offset=0, record_count=1)
        except DamagedError as error:
            self.remarks.append(Remark("damaged", f"{name}: cannot be read: {error}"))
            return None
        if sample.samples.ndim != 1 or sample.samples.dtype.kind not in "fiubSU":
            self.remarks.append(Remark("unread", f"{name}: neither numbers nor text"))
            return None
        return Column(name, sample.unit or "", sample.samples.dtype.kind in "SU")

    def _values(self, group: Group, name: str, at: int, count: int) -> Values:
        index, channels = self._indices[group.name]
        signal = self._mdf.get(group=index, index=channels[name], record_offset=at, record_count=count)
        if signal.samples.dtype.kind == "S":
            return np.array([each.decode(signal.encoding or "latin-1") for each in signal.samples], object)
        if signal.samples.dtype.kind == "U":
            return np.array(signal.samples, object)
        values = np.array(signal.samples, np.float64)
        if signal.invalidation_bits is not None:
            values[np.asarray(signal.invalidation_bits, bool)] = np.nan
        return values


def _check_head(path: Path) -> None:
    """Refuse what asammdf would take for something else.

    Raises:
        DamagedError: No header of either version.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if len(head) < _HEAD_BYTES or head[64:66] not in (b"##", b"HD"):
        raise DamagedError("its header is missing")


def _plain(comment: str) -> str:
    """The text of a comment that may be XML."""
    try:
        text = ET.fromstring(comment).findtext("TX") if comment.startswith("<") else comment  # noqa: S314
    except ET.ParseError:
        return comment
    return (text or "").strip()
