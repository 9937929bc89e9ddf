"""What every recording looks like from inside: groups of columns that share their rows, read block by block.

A CSV file is one group. A CAN log has a group for each message, an MDF file one for each channel group: their
rows come at times of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from seod.files.damage import plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]
    Values = NDArray[Any]
    """float64, or object where the column holds text."""

BLOCK_ROWS = 65_536
"""Rows that are in memory at once while a file is read through."""


_LONGEST = 500
"""Characters of a message: what a damaged file holds may be long."""


class ReadError(Exception):
    """A file cannot be read; the message names file, row and column as far as there are any."""

    def __init__(self, message: str) -> None:
        super().__init__(plain(message, _LONGEST))


def place(path: Path | str, row: int | None = None, column: str = "") -> str:
    """`run.csv: row 17: column 'y'`, for the beginning of a message."""
    parts = [str(path)]
    if row is not None:
        parts.append(f"row {row}")
    if column:
        parts.append(f"column {column!r}")
    return ": ".join(parts)


def needs_extra(path: Path | str, package: str, extra: str) -> ReadError:
    """The error for a format whose library is not installed."""
    return ReadError(f"{path}: this format needs {package}: pip install 'seod[{extra}]'")


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Attributes:
        name: As in the file, without its unit.
        unit: As in the file; "" where it tells none.
        text: Holds words, not numbers.
    """

    name: str
    unit: str = ""
    text: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """Columns that share their rows.

    Attributes:
        name: Message or channel group; "" where the file has but one.
        columns: In the order of the file.
        time: The column that holds the rows' time, where the format itself says so.
        main: Holds measured data, not notes about them.
    """

    name: str
    columns: tuple[Column, ...]
    time: str | None = None
    main: bool = True

    def column(self, name: str) -> Column | None:
        """The column of this name."""
        return next((column for column in self.columns if column.name == name), None)


@dataclass(frozen=True, slots=True)
class Block:
    """Some rows of a group.

    Attributes:
        group: Whose.
        values: Column -> its values in these rows.
        rows: By what a user finds each row again: line of a text file, else number from 1.
        done: Part of the file that has been read now, 0 to 1.
    """

    group: Group
    values: Mapping[str, Values]
    rows: Rows
    done: float


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that the reader of a format noticed, such as an end that was cut off."""

    kind: str
    message: str
    count: int = 1


class Source(Protocol):
    """An open recording.

    Attributes:
        path: Its file.
        format: Name of the format.
        groups: All that can be read.
        notes: What the file says about itself, as far as it was read.
        remarks: What was noticed so far; complete once all blocks were read.
    """

    path: Path
    format: str
    groups: tuple[Group, ...]
    remarks: list[Remark]

    @property
    def notes(self) -> Mapping[str, str]:
        """See above."""

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """Read through the file once.

        Args:
            wanted: Group -> its columns that are asked for.

        Yields:
            At most `BLOCK_ROWS` rows of one group; each group's rows in their order.

        Raises:
            ReadError: Something in it cannot be read.
        """
        ...

    def close(self) -> None:
        """Close the file."""
        ...


@dataclass
class Table:
    """A `Source` whose columns are all in memory."""

    path: Path
    format: str
    groups: tuple[Group, ...]
    arrays: Mapping[str, Mapping[str, Values]]
    notes: Mapping[str, str] = field(default_factory=dict)
    remarks: list[Remark] = field(default_factory=list)

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`."""
        for group in self.groups:
            names = wanted.get(group.name, ())
            length = max((len(self.arrays[group.name][name]) for name in names), default=0)
            for at in range(0, length, BLOCK_ROWS):
                end = min(at + BLOCK_ROWS, length)
                values = {name: self.arrays[group.name][name][at:end] for name in names}
                yield Block(group, values, np.arange(at + 1, end + 1), end / length)

    def close(self) -> None:
        """Nothing is open."""
