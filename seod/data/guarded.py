"""A recording whose reader may fail at any block: what it gave before stays, and what it met is said."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from seod.data.source import ReadError, Remark
from seod.files.damage import DamagedError, bounded, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from seod.data.source import Block, Group, Source


class Guarded:
    """A `Source` around the reader of a format.

    Args:
        source: The reader.
        complaints: Where lines come of what its library complains of.
    """

    def __init__(self, source: Source, complaints: list[str]) -> None:
        self._source = source
        self._complaints = complaints
        self._size = source.path.stat().st_size
        self.path: Path = source.path
        self.format: str = source.format
        self.groups: tuple[Group, ...] = source.groups
        self.remarks: list[Remark] = source.remarks

    @property
    def notes(self) -> Mapping[str, str]:
        """What the file says about itself, as far as it was read."""
        return self._source.notes

    def blocks(self, wanted: Mapping[str, Sequence[str]]) -> Iterator[Block]:
        """As `Source`; ends where the reader cannot go on."""
        blocks = self._source.blocks(wanted)
        rows = 0
        try:
            while (block := self._next(blocks)) is not None:
                rows += len(block.rows)
                yield block
        except DamagedError as error:
            if not rows:
                raise ReadError(f"{self.path}: is damaged, and nothing in it can be read: {error}") from error
            self.remarks.append(Remark("damaged", f"what follows after {rows} rows cannot be read: {error}"))
        self.remarks += [Remark("damaged", said) for said in self._complaints]
        self._complaints.clear()

    def _next(self, blocks: Iterator[Block]) -> Block | None:
        with bounded(self._size), library(ReadError):
            return next(blocks, None)

    def close(self) -> None:
        """Close the file."""
        with suppress(DamagedError), library():
            self._source.close()
